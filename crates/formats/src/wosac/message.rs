//! The messages of a submission. Fields that the challenge does not use are skipped.

use prost::Message;

#[derive(Message)]
pub(super) struct ScenarioRollouts {
    #[prost(string, tag = "1")]
    pub(super) scenario_id: String,
    #[prost(message, repeated, tag = "2")]
    pub(super) joint_scenes: Vec<JointScene>,
}

#[derive(Message)]
pub(super) struct JointScene {
    #[prost(message, repeated, tag = "1")]
    pub(super) simulated_trajectories: Vec<SimulatedTrajectory>,
}

#[derive(Message)]
pub(super) struct SimulatedTrajectory {
    #[prost(float, repeated, tag = "2")]
    pub(super) center_x: Vec<f32>,
    #[prost(float, repeated, tag = "3")]
    pub(super) center_y: Vec<f32>,
    #[prost(float, repeated, tag = "4")]
    pub(super) center_z: Vec<f32>,
    #[prost(float, repeated, tag = "5")]
    pub(super) heading: Vec<f32>,
    #[prost(int32, tag = "6")]
    pub(super) object_id: i32,
}

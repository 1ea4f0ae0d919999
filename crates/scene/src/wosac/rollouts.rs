//! The rollouts of a simulator for one scenario.

/// All rollouts of one scenario.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ScenarioRollouts {
    /// Id of the scenario.
    pub scenario_id: String,
    /// The rollouts, 32 in a submission.
    pub joint_scenes: Vec<JointScene>,
}

/// One rollout: the future of every simulated object, in any order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointScene {
    /// One trajectory per object.
    pub trajectories: Vec<ObjectTrajectory>,
}

/// The simulated future of an object. Arrays have 80 entries, for the frames 11 to 90.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectTrajectory {
    /// Id of the object's track.
    pub object_id: i32,
    /// Box centres, metres, world coordinates.
    pub x: Vec<f32>,
    /// Box centres, metres.
    pub y: Vec<f32>,
    /// Box centres, metres.
    pub z: Vec<f32>,
    /// Headings, radians counter-clockwise from the x axis; need not be wrapped.
    pub heading: Vec<f32>,
}

impl ObjectTrajectory {
    /// Returns the four arrays with the field names of the submission files.
    pub fn fields(&self) -> [(&'static str, &[f32]); 4] {
        [("center_x", &self.x), ("center_y", &self.y), ("center_z", &self.z), ("heading", &self.heading)]
    }
}

//! The description that every file of a submission carries.

use prost::Message;

use crate::error::Cause;

/// Code of the type of Sim Agents submissions.
const SIM_AGENTS_SUBMISSION: i32 = 1;

/// The fields of `SimAgentsChallengeSubmission` other than the rollouts. `None`: not set.
#[derive(Clone, PartialEq, Message)]
pub struct SubmissionMetadata {
    /// Code of the type of the submission, 1 for Sim Agents.
    #[prost(int32, optional, tag = "2")]
    pub submission_type: Option<i32>,
    /// Account of the submitter, an email address.
    #[prost(string, optional, tag = "3")]
    pub account_name: Option<String>,
    /// Name of the method in the leaderboard.
    #[prost(string, optional, tag = "4")]
    pub unique_method_name: Option<String>,
    /// Names of the authors.
    #[prost(string, repeated, tag = "5")]
    pub authors: Vec<String>,
    /// Affiliation of the authors.
    #[prost(string, optional, tag = "6")]
    pub affiliation: Option<String>,
    /// Description of the method.
    #[prost(string, optional, tag = "7")]
    pub description: Option<String>,
    /// Link to a paper or a page.
    #[prost(string, optional, tag = "8")]
    pub method_link: Option<String>,
    /// Whether the method uses lidar data.
    #[prost(bool, optional, tag = "9")]
    pub uses_lidar_data: Option<bool>,
    /// Whether the method uses camera data.
    #[prost(bool, optional, tag = "10")]
    pub uses_camera_data: Option<bool>,
    /// Whether the method uses public models that were trained before.
    #[prost(bool, optional, tag = "11")]
    pub uses_public_model_pretraining: Option<bool>,
    /// Number of parameters, such as `200K`.
    #[prost(string, optional, tag = "12")]
    pub num_model_parameters: Option<String>,
    /// Names of the public models.
    #[prost(string, repeated, tag = "13")]
    pub public_model_names: Vec<String>,
    /// Whether the submitter acknowledges that the simulation is closed-loop.
    #[prost(bool, optional, tag = "14")]
    pub acknowledge_complies_with_closed_loop_requirement: Option<bool>,
}

impl SubmissionMetadata {
    /// Checks that the fields which the server requires are set.
    ///
    /// # Errors
    /// The first field that is missing or has a value that the server refuses.
    pub fn check(&self) -> Result<(), Cause> {
        if self.submission_type != Some(SIM_AGENTS_SUBMISSION) {
            let found = self.submission_type.map_or("missing".into(), |code| code.to_string());
            return Err(Cause::value("submission_type", found, "1 (SIM_AGENTS_SUBMISSION)"));
        }
        let texts = [
            ("account_name", &self.account_name),
            ("unique_method_name", &self.unique_method_name),
            ("num_model_parameters", &self.num_model_parameters),
        ];
        if let Some((field, _)) = texts.iter().find(|(_, text)| text.as_deref().unwrap_or("").is_empty()) {
            return Err(Cause::value(*field, "missing", "a text, which the server requires"));
        }
        let flags = [
            ("uses_lidar_data", self.uses_lidar_data),
            ("uses_camera_data", self.uses_camera_data),
            ("uses_public_model_pretraining", self.uses_public_model_pretraining),
        ];
        if let Some((field, _)) = flags.iter().find(|(_, flag)| flag.is_none()) {
            return Err(Cause::value(*field, "missing", "true or false, which the server requires"));
        }
        match self.acknowledge_complies_with_closed_loop_requirement {
            Some(true) => Ok(()),
            found => {
                let found = found.map_or("missing".into(), |flag| flag.to_string());
                let field = "acknowledge_complies_with_closed_loop_requirement";
                Err(Cause::value(field, found, "true, which the server requires"))
            }
        }
    }
}

impl SubmissionMetadata {
    /// Returns the metadata of a method, with everything else that the server requires set to `false` or, for
    /// the acknowledgement, `true`.
    pub fn new(account: &str, method: &str, parameters: &str) -> Self {
        Self {
            submission_type: Some(SIM_AGENTS_SUBMISSION),
            account_name: Some(account.into()),
            unique_method_name: Some(method.into()),
            num_model_parameters: Some(parameters.into()),
            uses_lidar_data: Some(false),
            uses_camera_data: Some(false),
            uses_public_model_pretraining: Some(false),
            acknowledge_complies_with_closed_loop_requirement: Some(true),
            ..Self::default()
        }
    }
}

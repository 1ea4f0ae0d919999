//! The description that every file of a submission carries.

use crate::error::Cause;
use crate::wire::{Fields, Message, WireError};

/// Code of the type of Sim Agents submissions.
const SIM_AGENTS_SUBMISSION: i32 = 1;

/// The fields of `SimAgentsChallengeSubmission` other than the rollouts. `None`: not set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SubmissionMetadata {
    /// Code of the type of the submission, 1 for Sim Agents.
    pub submission_type: Option<i32>,
    /// Account of the submitter, an email address.
    pub account_name: Option<String>,
    /// Name of the method in the leaderboard.
    pub unique_method_name: Option<String>,
    /// Names of the authors.
    pub authors: Vec<String>,
    /// Affiliation of the authors.
    pub affiliation: Option<String>,
    /// Description of the method.
    pub description: Option<String>,
    /// Link to a paper or a page.
    pub method_link: Option<String>,
    /// Whether the method uses lidar data.
    pub uses_lidar_data: Option<bool>,
    /// Whether the method uses camera data.
    pub uses_camera_data: Option<bool>,
    /// Whether the method uses public models that were trained before.
    pub uses_public_model_pretraining: Option<bool>,
    /// Number of parameters, such as `200K`.
    pub num_model_parameters: Option<String>,
    /// Names of the public models.
    pub public_model_names: Vec<String>,
    /// Whether the submitter acknowledges that the simulation is closed-loop.
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

    /// Decodes the fields of a `SimAgentsChallengeSubmission` message.
    pub(super) fn decode(message: &[u8]) -> Result<Self, WireError> {
        let (mut metadata, mut fields) = (Self::default(), Fields::new(message));
        while let Some(key) = fields.key()? {
            match key.tag() {
                2 => metadata.submission_type = Some(fields.int32(key)?),
                3 => metadata.account_name = Some(fields.text(key)?.to_owned()),
                4 => metadata.unique_method_name = Some(fields.text(key)?.to_owned()),
                5 => metadata.authors.push(fields.text(key)?.to_owned()),
                6 => metadata.affiliation = Some(fields.text(key)?.to_owned()),
                7 => metadata.description = Some(fields.text(key)?.to_owned()),
                8 => metadata.method_link = Some(fields.text(key)?.to_owned()),
                9 => metadata.uses_lidar_data = Some(fields.flag(key)?),
                10 => metadata.uses_camera_data = Some(fields.flag(key)?),
                11 => metadata.uses_public_model_pretraining = Some(fields.flag(key)?),
                12 => metadata.num_model_parameters = Some(fields.text(key)?.to_owned()),
                13 => metadata.public_model_names.push(fields.text(key)?.to_owned()),
                14 => metadata.acknowledge_complies_with_closed_loop_requirement = Some(fields.flag(key)?),
                _ => drop(fields.skip(key)?),
            }
        }
        Ok(metadata)
    }

    /// Encodes the fields that are set, by ascending tags.
    pub(super) fn encode(&self) -> Vec<u8> {
        let mut message = Message::default();
        self.submission_type.iter().for_each(|code| message.int64(2, (*code).into()));
        self.account_name.iter().for_each(|text| message.bytes(3, text));
        self.unique_method_name.iter().for_each(|text| message.bytes(4, text));
        self.authors.iter().for_each(|text| message.bytes(5, text));
        self.affiliation.iter().for_each(|text| message.bytes(6, text));
        self.description.iter().for_each(|text| message.bytes(7, text));
        self.method_link.iter().for_each(|text| message.bytes(8, text));
        let flags = [self.uses_lidar_data, self.uses_camera_data, self.uses_public_model_pretraining];
        for (tag, flag) in (9..).zip(flags) {
            flag.iter().for_each(|flag| message.int64(tag, (*flag).into()));
        }
        self.num_model_parameters.iter().for_each(|text| message.bytes(12, text));
        self.public_model_names.iter().for_each(|text| message.bytes(13, text));
        let complies = self.acknowledge_complies_with_closed_loop_requirement;
        complies.iter().for_each(|flag| message.int64(14, (*flag).into()));
        message.into_bytes()
    }
}

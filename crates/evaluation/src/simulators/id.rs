//! The parts of a simulator's id.

use reactsim_models as models;
use reactsim_qp::Smoothing;

use crate::error::EvaluationError;

/// Begins the label in an id.
const LABEL: char = '@';

/// An id such as `ntp-reactive@mine+qp`: baseline, label of a variant of it, stage behind it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SimulatorId<'a> {
    /// Id of the baseline with the label, if there is one. Weights and parameters belong to it.
    pub variant: &'a str,
    /// Id of the baseline.
    pub baseline: &'a str,
    /// Label that tells variants of one baseline apart.
    pub label: Option<&'a str>,
    /// Stage behind the simulator.
    pub smoothing: Option<Smoothing>,
}

impl<'a> SimulatorId<'a> {
    /// Splits an id. Whether there is such a baseline is not checked.
    ///
    /// # Errors
    /// [`EvaluationError`] if the label is not a name.
    pub(crate) fn parse(id: &'a str) -> Result<Self, EvaluationError> {
        let (variant, smoothing) = match Smoothing::of_id(id) {
            Some((variant, smoothing)) => (variant, Some(smoothing)),
            None => (id, None),
        };
        // `idm@styles` is a baseline of its own.
        if models::find(variant).is_some() {
            return Ok(Self { variant, baseline: variant, label: None, smoothing });
        }
        let Some((baseline, label)) = variant.split_once(LABEL) else {
            return Ok(Self { variant, baseline: variant, label: None, smoothing });
        };
        let is_name = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if label.is_empty() || !label.chars().all(is_name) {
            return Err(EvaluationError::Refused(format!(
                "`{id}`: the label after `@` has letters, digits, `-` and `_`, as in ntp-reactive@mine"
            )));
        }
        Ok(Self { variant, baseline, label: Some(label), smoothing })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_split() {
        let id = SimulatorId::parse("ntp-reactive@mine+qp").unwrap();
        assert_eq!((id.variant, id.baseline, id.label), ("ntp-reactive@mine", "ntp-reactive", Some("mine")));
        assert_eq!(id.smoothing, Some(Smoothing::Full));
        let id = SimulatorId::parse("idm@styles+qp").unwrap();
        assert_eq!((id.baseline, id.label, id.smoothing), ("idm@styles", None, Some(Smoothing::Full)));
        let id = SimulatorId::parse("idm").unwrap();
        assert_eq!((id.variant, id.baseline, id.label, id.smoothing), ("idm", "idm", None, None));
    }

    #[test]
    fn labels_are_names() {
        for id in ["idm@", "idm@a.b", "idm@a@b", "idm@a+b", "idm@ä"] {
            let error = SimulatorId::parse(id).unwrap_err().to_string();
            assert!(
                error.contains(id) && error.contains("the label after `@` has letters, digits"),
                "{error}"
            );
        }
    }
}

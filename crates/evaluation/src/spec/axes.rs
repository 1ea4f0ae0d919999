//! Axes of studies: keys of a specification that have several values.

use std::fmt::Display;
use std::str::FromStr;

use clap::{Args, Command};
use reactsim_external::RunOutline;
use reactsim_rollout::Protocol;
use serde::{Deserialize, Serialize};

use super::file::{keys, names, unknown_key};
use super::{RolloutSpec, RunSpec, split_metric_option};
use crate::error::EvaluationError;

/// Keys that can be axes, in addition to those of [`RolloutSpec`]. Members of a study share scenarios and
/// external programs.
const KEYS: [&str; 7] = ["models", "av", "backend", "seed", "metric-option", "allow", "pose"];

/// A key of a specification, or a parameter of a simulator such as `idm.vehicle.headway`, with its values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Axis {
    /// The key.
    pub key: String,
    /// The values, as on the command line.
    pub values: Vec<String>,
}

/// A value of an axis.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AxisValue {
    /// The key.
    pub key: String,
    /// The value.
    pub value: String,
}

impl Axis {
    /// Creates an axis of values that are written by their texts.
    pub fn new<V: ToString>(key: &str, values: impl IntoIterator<Item = V>) -> Self {
        Self { key: key.to_owned(), values: values.into_iter().map(|value| value.to_string()).collect() }
    }
}

impl FromStr for Axis {
    type Err = String;

    /// Reads a text such as `replan=1hz,2hz`. The settings of a planner belong to its value:
    /// `av=planner:idm,tracker=perfect,log` has two. `av.planner=idm` is `av=planner:idm`, and `simulators`
    /// are `models`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (key, texts) = text
            .split_once('=')
            .ok_or_else(|| "expected KEY=VALUE,VALUE, such as replan=1hz,2hz".to_owned())?;
        let (key, prefix) = match key.trim() {
            "av.planner" => ("av", "planner:"),
            "simulators" => ("models", ""),
            key => (key, ""),
        };
        let mut axis = Self::new(key, [""; 0]);
        for value in texts.split(',').map(str::trim) {
            match axis.values.last_mut().filter(|_| axis.key == "av" && value.contains('=')) {
                Some(last) => *last = format!("{last},{value}"),
                None => axis.values.push(format!("{prefix}{value}")),
            }
        }
        Ok(axis)
    }
}

/// Refuses an axis, named by its key, or by key and value.
fn refuse(axis: impl Display, reason: impl Display) -> EvaluationError {
    EvaluationError::Refused(format!("axis {axis}: {reason}"))
}

impl RunSpec {
    /// Returns this specification with every combination of values of these axes, of which the last varies
    /// fastest.
    ///
    /// # Errors
    /// [`EvaluationError`] names an axis or value that is unknown, invalid, or there twice.
    pub fn product(&self, axes: &[Axis]) -> Result<Vec<(Self, Vec<AxisValue>)>, EvaluationError> {
        let mut all = vec![(self.clone(), Vec::new())];
        for (i, axis) in axes.iter().enumerate() {
            if axes[..i].iter().any(|earlier| earlier.key == axis.key) {
                return Err(refuse(&axis.key, "it is there twice"));
            }
            if axis.values.is_empty() {
                return Err(refuse(&axis.key, "it has no values"));
            }
            let alone: Vec<Self> =
                axis.values.iter().map(|value| self.with(&axis.key, value)).collect::<Result<_, _>>()?;
            if let Some((at, _)) = alone.iter().enumerate().find(|(at, spec)| alone[..*at].contains(spec)) {
                return Err(refuse(format!("{}={}", axis.key, axis.values[at]), "its value is there twice"));
            }
            let mut further = Vec::with_capacity(all.len() * axis.values.len());
            for (spec, point) in &all {
                for value in &axis.values {
                    let at = AxisValue { key: axis.key.clone(), value: value.clone() };
                    further.push((spec.with(&axis.key, value)?, [point.clone(), vec![at]].concat()));
                }
            }
            all = further;
        }
        let names_av = axes.iter().any(|axis| axis.key == "av");
        if names_av && all.iter().any(|(spec, _)| spec.rollout.protocol == Protocol::Realism) {
            let reason =
                "simulators move the AV with protocol=realism: leave out this axis, or realism of protocol";
            return Err(refuse("av", reason));
        }
        Ok(all)
    }

    /// Returns this specification with another value of a key, or of a parameter of a simulator.
    fn with(&self, key: &str, value: &str) -> Result<Self, EvaluationError> {
        let mut spec = self.clone();
        let known = names(&RolloutSpec::augment_args(Command::new("axes")));
        let known: Vec<String> = known.into_iter().chain(KEYS.map(str::to_owned)).collect();
        if !known.iter().any(|name| name == key) {
            if !key.contains('.') {
                let meant = format!("axes are {} and parameters of simulators", known.join(", "));
                if keys().iter().any(|name| name == key) {
                    let shared =
                        "it is the same for all members of a study, as are the scenarios and what is kept";
                    return Err(refuse(key, format!("{shared}; {meant}")));
                }
                return Err(refuse(key, unknown_key(key, &known, &meant)));
            }
            spec.subject.set.retain(|text| text.split_once('=').is_none_or(|(path, _)| path.trim() != key));
            spec.subject.set.push(format!("{key}={value}"));
            return Ok(spec);
        }
        if key == "metric-option" {
            let (name, _) = split_metric_option(value).map_err(|error| refuse(key, error.to_string()))?;
            let options = &mut spec.subject.metric_option;
            options.retain(|text| text.split_once('=').is_none_or(|(other, _)| other != name));
            options.push(value.to_owned());
            return Ok(spec);
        }
        let invalid = |error: clap::Error| {
            let reason = std::error::Error::source(&error).map_or_else(
                || error.to_string().lines().next().unwrap_or_default().to_owned(),
                ToString::to_string,
            );
            refuse(format!("{key}={value}"), reason)
        };
        let command = Self::augment_args_for_update(Command::new("axis").no_binary_name(true));
        let matches = command.try_get_matches_from([format!("--{key}={value}")]).map_err(invalid)?;
        clap::FromArgMatches::update_from_arg_matches(&mut spec, &matches).map_err(invalid)?;
        if spec.rollout.protocol == Protocol::Realism && key == "protocol" {
            // The simulator moves the AV.
            spec.subject.av = None;
        }
        Ok(spec)
    }

    /// Returns what external programs learn of runs with these specifications.
    pub fn outline<'a>(specs: impl IntoIterator<Item = &'a Self>) -> RunOutline {
        let mut outline = RunOutline { intervals: Vec::new(), protocols: Vec::new() };
        for RolloutSpec { replan, protocol, .. } in specs.into_iter().map(|spec| &spec.rollout) {
            if !outline.intervals.contains(&replan.steps()) {
                outline.intervals.push(replan.steps());
            }
            if !outline.protocols.contains(&protocol.name()) {
                outline.protocols.push(protocol.name());
            }
        }
        outline
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn product(axes: &[&str]) -> Result<Vec<(RunSpec, Vec<AxisValue>)>, EvaluationError> {
        let axes: Vec<Axis> = axes.iter().map(|axis| axis.parse().unwrap()).collect();
        RunSpec::default().product(&axes)
    }

    #[test]
    fn axes_give_every_combination() {
        let all = product(&["replan=1hz,5", "idm.vehicle.headway=1,1.5", "models=idm,idm@styles"]).unwrap();
        assert_eq!(all.len(), 8);
        let (spec, point) = &all[5];
        let values: Vec<&str> = point.iter().map(|at| at.value.as_str()).collect();
        assert_eq!(values, ["5", "1", "idm@styles"]);
        assert_eq!(
            (spec.rollout.replan.steps(), &spec.subject.models[..]),
            (5, &["idm@styles".to_owned()][..])
        );
        assert_eq!(spec.subject.set, ["idm.vehicle.headway=1"]);
        assert_eq!(product(&[]).unwrap(), [(RunSpec::default(), Vec::new())]);
        let outline = RunSpec::outline(all.iter().map(|(spec, _)| spec));
        assert_eq!((outline.intervals, outline.protocols), (vec![10, 5], vec!["reactive"]));
    }

    #[test]
    fn an_axis_of_a_metric_option_leaves_the_others() {
        let mut spec = RunSpec::default();
        spec.subject.metric_option = ["fault_order=waymax", "other=1"].map(str::to_owned).to_vec();
        let all = spec.product(&["metric-option=fault_order=nuplan,more=2".parse().unwrap()]).unwrap();
        let options: Vec<_> = all.iter().map(|(spec, _)| spec.subject.metric_option.join(" ")).collect();
        assert_eq!(options, ["other=1 fault_order=nuplan", "fault_order=waymax other=1 more=2"]);
    }

    #[test]
    fn settings_of_planners_belong_to_their_value() {
        let axis: Axis = "av=planner:idm,tracker=perfect,every=5,log,brake:4".parse().unwrap();
        assert_eq!(axis.values, ["planner:idm,tracker=perfect,every=5", "log", "brake:4"]);
        let options: Axis = "metric-option=fault_order=nuplan,fault_order=waymax".parse().unwrap();
        assert_eq!(options.values, ["fault_order=nuplan", "fault_order=waymax"]);
        assert!("replan".parse::<Axis>().is_err());
        let planners: Axis = "av.planner=idm,tracker=perfect,pdm-closed".parse().unwrap();
        assert_eq!(planners, "av=planner:idm,tracker=perfect,planner:pdm-closed".parse().unwrap());
        assert_eq!("simulators=idm,stop".parse(), "models=idm,stop".parse::<Axis>());
    }

    #[test]
    fn wrong_axes_are_named() {
        for (axes, message) in [
            (&["repln=1"][..], "axis repln: `repln` is not a key; did you mean `replan`?"),
            (&["limt=1,2"], "axis limt: `limt` is not a key; axes are smooth, "),
            (&["limit=1,2"], "axis limit: it is the same for all members of a study"),
            (&["replan=5,3hz"], "axis replan=3hz: `3hz` is not a replan interval"),
            (&["replan="], "axis replan=: "),
            (&["rollouts=0"], "axis rollouts=0: 0 is not in 1..=10000"),
            (&["seed=x"], "axis seed=x: "),
            (&["replan=5,2hz"], "axis replan=2hz: its value is there twice"),
            (&["seed=1", "seed=2"], "axis seed: it is there twice"),
            (
                &["av=log,brake:4", "protocol=reactive,realism"],
                "axis av: simulators move the AV with protocol=realism",
            ),
            (&["protocol=realism", "av=log"], "axis av: simulators move the AV with protocol=realism"),
            (&["metric-option=x"], "axis metric-option: metric-option `x`: write NAME=VALUE"),
        ] {
            let found = product(axes).unwrap_err().to_string();
            assert!(found.starts_with(message), "{axes:?}: {found}");
        }
    }
}

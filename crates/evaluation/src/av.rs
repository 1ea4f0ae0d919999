//! The AV policy of a run.

use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use reactsim_baseline::weights::PLANNER as DIFFUSION_PLANNER;
use reactsim_planning::av::PlannerChoice;
use reactsim_planning::tracking::Controller;
use reactsim_rollout::{ParseReplanError, ParseScriptError, Replan, Script};

use crate::error::AV_CHOICES;

/// Prefix of the planners.
pub(super) const PLANNER: &str = "planner:";

/// The planners, for error texts.
const PLANNERS: &str = "log, pdm-closed, idm, diffusion-planner, simulator:<id> or external:<name>";

/// The AV policy in the reactive protocol.
#[derive(Clone, Debug, PartialEq)]
pub enum AvChoice {
    /// The deviated trajectory that comes with the scenario or in a file of deviations.
    Deviated,
    /// The logged AV.
    Log,
    /// The deviated AV of the scenarios that have one, the logged AV of the others.
    DeviatedOrLog,
    /// A script.
    Scripted(Script),
    /// Deviated trajectories from this file.
    File(PathBuf),
    /// A planner, which is judged.
    Planned(PlannedAv),
}

/// An AV that is judged by the metrics of planners.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlannedAv {
    /// The planner.
    pub driver: AvDriver,
    /// The controller that follows its trajectories. Simulators have none: the AV takes the states that they
    /// plan.
    pub controller: Controller,
    /// Number of steps between two plans. By default one, as in nuPlan; for simulators five, as in the
    /// benchmark.
    pub every: Replan,
}

/// The planner of an AV.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AvDriver {
    /// The logged AV: the expert, which others are compared with.
    Log,
    /// A planner that plans from what it observes.
    Planner(PlannerChoice),
    /// The network that ships, along the lanes of the route.
    DiffusionPlanner,
    /// A simulator, by its id: it plans for all agents, and the AV follows its part of the plan.
    Simulator(String),
    /// A program that speaks the protocol for planners, by its name.
    External(String),
    /// A planner that the calling program provides, by its name.
    Own(String),
}

impl AvDriver {
    /// Returns the number of steps between two plans if nothing else is chosen.
    fn default_interval(&self) -> Replan {
        match self {
            Self::Simulator(_) => Replan::default(),
            Self::Log | Self::Planner(_) | Self::DiffusionPlanner | Self::External(_) | Self::Own(_) => {
                Replan::EVERY_STEP
            }
        }
    }
}

impl fmt::Display for AvDriver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Log => f.write_str("log"),
            Self::Planner(planner) => f.write_str(planner.id()),
            Self::DiffusionPlanner => f.write_str(DIFFUSION_PLANNER),
            Self::Simulator(id) => write!(f, "simulator:{id}"),
            Self::External(name) => write!(f, "external:{name}"),
            Self::Own(name) => write!(f, "own:{name}"),
        }
    }
}

/// The reason why a text does not name an AV policy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ParseAvError(String);

impl AvChoice {
    /// Returns whether the AV follows the deviated trajectories of scenarios that have one.
    pub(crate) const fn follows_deviations(&self) -> bool {
        matches!(self, Self::Deviated | Self::DeviatedOrLog | Self::File(_))
    }

    /// Returns whether the AV is judged by the metrics of planners.
    pub const fn is_judged(&self) -> bool {
        matches!(self, Self::Planned(_))
    }
}

impl PlannedAv {
    /// Returns whether a planner with this text is a program of the user.
    pub fn is_external(text: &str) -> bool {
        text.parse().is_ok_and(|planned: Self| matches!(planned.driver, AvDriver::External(_)))
    }
}

impl FromStr for PlannedAv {
    type Err = ParseAvError;

    /// Parses the id of a planner and its settings, such as `idm,tracker=perfect,every=5`.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let refuse = |text: String| Err(ParseAvError(text));
        let (id, settings) = text.split_once(',').unwrap_or((text, ""));
        let driver = match (id, PlannerChoice::from_id(id), id.split_once(':')) {
            ("log", ..) => AvDriver::Log,
            (DIFFUSION_PLANNER, ..) => AvDriver::DiffusionPlanner,
            (_, Some(planner), _) => AvDriver::Planner(planner),
            (_, _, Some(("simulator", id))) if !id.is_empty() => AvDriver::Simulator(id.to_owned()),
            (_, _, Some(("external", name))) if !name.is_empty() => AvDriver::External(name.to_owned()),
            _ => return refuse(format!("`{id}` is not a planner: choose {PLANNERS}")),
        };
        let mut planned =
            Self { every: driver.default_interval(), controller: Controller::LqrBicycle, driver };
        let wrong = |error: ParseReplanError| ParseAvError(error.to_string());
        let mut keys = BTreeSet::new();
        for setting in settings.split(',').filter(|setting| !setting.is_empty()) {
            if !keys.insert(setting.split('=').next()) {
                return refuse(format!("`{setting}` is a setting that is given twice; give it once"));
            }
            if planned.driver == AvDriver::Log {
                return refuse(format!(
                    "`planner:log` replays the log and has no settings, but `{setting}` is given; leave it \
                     out"
                ));
            }
            let is_simulator = matches!(planned.driver, AvDriver::Simulator(_));
            match setting.split_once('=') {
                Some(("tracker", _)) if is_simulator => {
                    return refuse(format!(
                        "the AV takes the states that a simulator plans, so `{setting}` has no use; leave it \
                         out"
                    ));
                }
                Some(("tracker", "lqr")) => planned.controller = Controller::LqrBicycle,
                Some(("tracker", "perfect")) => planned.controller = Controller::PerfectTracking,
                Some(("every", steps)) => planned.every = steps.parse().map_err(wrong)?,
                _ => {
                    let settings = "tracker=lqr, tracker=perfect or every=<steps>";
                    return refuse(format!("`{setting}` is not a setting of a planner: write {settings}"));
                }
            }
        }
        match &planned.driver {
            AvDriver::Planner(planner)
                if planner.plans_poses_only() && planned.controller == Controller::PerfectTracking =>
            {
                refuse(format!(
                    "`{}` plans poses without velocities, which tracker=perfect cannot follow; use \
                     tracker=lqr",
                    planner.id()
                ))
            }
            _ => Ok(planned),
        }
    }
}

impl fmt::Display for PlannedAv {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.driver.fmt(f)?;
        if self.controller == Controller::PerfectTracking {
            f.write_str(",tracker=perfect")?;
        }
        if self.every != self.driver.default_interval() {
            write!(f, ",every={}", self.every.steps())?;
        }
        Ok(())
    }
}

impl FromStr for AvChoice {
    type Err = ParseAvError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match text {
            "deviated" => Ok(Self::Deviated),
            "log" => Ok(Self::Log),
            "deviated-or-log" => Ok(Self::DeviatedOrLog),
            _ => match (text.strip_prefix("file:"), text.strip_prefix(PLANNER)) {
                (_, Some(planned)) => planned.parse().map(Self::Planned),
                (Some(""), _) => Err(ParseAvError("`file:` names no file: write `file:<path>`".to_owned())),
                (Some(path), _) => Ok(Self::File(path.into())),
                _ => text.parse().map(Self::Scripted).map_err(|error| {
                    ParseAvError(match error {
                        ParseScriptError::Unknown(text) => {
                            format!("`{text}` is not an AV policy: choose {AV_CHOICES}")
                        }
                        error => error.to_string(),
                    })
                }),
            },
        }
    }
}

impl fmt::Display for AvChoice {
    /// Writes the name used in files. The provenance identifies a file of deviations by its digest, not by
    /// its path.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Deviated | Self::File(_) => f.write_str("deviated"),
            Self::Log => f.write_str("log"),
            Self::DeviatedOrLog => f.write_str("deviated-or-log"),
            Self::Scripted(script) => script.fmt(f),
            Self::Planned(planned) => write!(f, "{PLANNER}{planned}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        let scripts = ["constant-velocity", "brake:4", "retime:1.6", "shift:-2"];
        let planners = [
            "planner:log",
            "planner:pdm-closed",
            "planner:idm,tracker=perfect",
            "planner:idm,every=5",
            "planner:diffusion-planner,every=5",
            "planner:simulator:idm@calm+qp",
            "planner:simulator:idm,every=1",
            "planner:external:mine,tracker=perfect,every=5",
        ];
        let all = ["deviated", "log", "deviated-or-log"].into_iter().chain(scripts).chain(planners);
        for text in all {
            assert_eq!(text.parse::<AvChoice>().unwrap().to_string(), text);
        }
        let spelled: AvChoice = "planner:idm,tracker=lqr,every=1steps".parse().unwrap();
        assert_eq!(spelled.to_string(), "planner:idm");
        assert_eq!("file:a/b:c.parquet".parse(), Ok(AvChoice::File("a/b:c.parquet".into())));
    }

    #[test]
    fn errors_name_the_fix() {
        let text = |t: &str| t.parse::<AvChoice>().unwrap_err().to_string();
        assert!(text("brake").contains("above 0 and at most 6 m/s²"));
        assert!(text("shift:inf").contains("from -5 to 5 m"));
        insta::assert_snapshot!(text("file:"), @"`file:` names no file: write `file:<path>`");
        assert!(text("swerve").contains("choose deviated, log"));
        let planners = "choose log, pdm-closed, idm, diffusion-planner, simulator:<id> or external:<name>";
        assert!(text("planner:pdm").contains(planners));
        assert!(text("planner:external:").contains("is not a planner"));
        assert!(text("planner:simulator:idm,tracker=lqr").contains("leave it out"));
        assert!(text("planner:idm,speed=3").contains("tracker=perfect"));
        assert!(text("planner:idm,every=1,every=5").contains("`every=5` is a setting that is given twice"));
        assert!(text("planner:idm,tracker=lqr,tracker=lqr").contains("given twice"));
        assert!(text("planner:idm,every=0").contains("1 to 80 steps"));
        assert!(text("planner:idm,every=81").contains("1 to 80 steps"));
        assert!(text("planner:pdm-closed,tracker=perfect").contains("use tracker=lqr"));
        assert!(text("planner:log,every=5").contains("leave it out"));
    }
}

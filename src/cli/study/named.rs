//! Studies with a name: their axes, and the options that give their values.

use std::path::Path;

use anyhow::{Context, bail};
use clap::{Subcommand, ValueEnum};

use super::{Design, SharedArgs};
use crate::evaluation::{AvChoice, AvDriver, Axis, PlannedAv, Source, StudyKind, SubjectSpec, are_deviated};
use crate::planning::tracking::Controller;
use crate::report::training_paths;
use crate::rollout::{Entering, Protocol, Replan};
use crate::training::kept_weights;

const REPLAN: &str = "\
Without --models, oracles are left out: their motion does not depend on the replan interval.";

const REALISM: &str = "\
--rollouts is the number of rollouts in the realism protocol, by default 32. With --keep-rollouts, \
the study also computes the realism metrics of the Sim Agents challenge.";

const REALISM_REACTIVITY: &str = "\
Simulators along trainings, as `train --keep-every` keeps them, in both protocols: the tables of \
`study realism`, and paths.svg, which has a line per training with realism on one axis and \
collisions with the AV and over-reaction on the other. --models adds others as points. --rollouts is \
the number of rollouts in each protocol, by default 32.

Example:
  reactsim train realism sensed.parquet --from ntp-reactive --keep-every 20 --out both
  reactsim study realism-reactivity --training both=both --out studies/paths";

const GUARDS: &str = "\
The parameters projection and keep_clear of a simulator's card are inverted, one at a time. The \
stage `qp` is added to simulators that accept it; `qp-regression` includes it and becomes \
`regression` without it. Every variant runs with AV look-ahead 1 and 0.";

const PLANNERS: &str = "\
Every planner drives the AV of every scenario under every simulator and is judged by nuPlan's \
closed-loop metrics. The tables show the score of each planner, its rank under each simulator, \
Kendall's tau between simulators, and which collisions exist because agents ignored the AV or \
vanish because they froze. The log always takes part: agents are compared with their motion \
around it. Scenarios with deviated AVs also run with these, for over-reaction.

Examples:
  reactsim study planners --models log-replay,idm,ntp-guarded --out studies/planners
  reactsim study planners logs/ --planners idm,pdm-closed,simulator:ntp-guarded --out studies/mine
  reactsim study planners --planner mine='python mine.py' --out studies/mine";

const ERRORS: &str = "\
The AV follows the log, so that agents have no reason to do anything else. The tables show the \
distance of agents from where the log has them, by class, by what they do in the log (stand, set \
off, turn, halt, follow, cross, drive freely), by speed, by distance from the AV and by time, and \
how far they are ahead of the log. A simulator whose agents are ahead where they turn takes its \
turns too fast.

Examples:
  reactsim study errors --models ntp-reactive,trajtok-small --out studies/errors
  reactsim study errors logs/ --models constant-velocity,ntp-guarded --out studies/mine";

/// Simulators of `study planners` if none are named.
const SIMULATORS: [&str; 3] = ["log-replay", "idm", "ntp-guarded"];
/// Rollouts of `study realism` in the realism protocol, as in the Sim Agents challenge.
const REALISM_ROLLOUTS: u32 = 32;

/// A study with a name.
#[derive(Debug, Subcommand)]
pub(super) enum NamedStudy {
    /// Replan interval: collisions with the AV and close calls by interval
    #[command(after_help = REPLAN)]
    Replan {
        /// Steps between two plans (1 to 80, of 0.1 s each), separated by commas, or rates such as 2hz
        #[arg(long, value_name = "STEPS", value_delimiter = ',', default_value = "1,2,5,10,20,40")]
        intervals: Vec<Replan>,
        #[command(flatten)]
        shared: SharedArgs,
    },
    /// Reactive against realism protocol: reaction, displacement, likelihood of the log
    #[command(after_help = REALISM)]
    Realism {
        /// Rollouts per scenario and simulator in the reactive protocol
        #[arg(long, default_value_t = 1, value_name = "R",
              value_parser = clap::value_parser!(u32).range(1..=10_000))]
        reactive_rollouts: u32,
        #[command(flatten)]
        shared: SharedArgs,
    },
    /// Networks along trainings: realism against reactions
    #[command(after_help = REALISM_REACTIVITY)]
    RealismReactivity {
        /// Name and folder of a training with kept networks; may be repeated
        #[arg(long, value_name = "NAME=FOLDER", required = true)]
        training: Vec<String>,
        /// Simulator that loads the networks
        #[arg(long, value_name = "ID", default_value = "ntp-reactive")]
        simulator: String,
        #[command(flatten)]
        shared: SharedArgs,
    },
    /// Ablation of the parts of simulators: projection, keeping clear, QP stage, AV look-ahead
    #[command(after_help = GUARDS)]
    Guards {
        #[command(flatten)]
        shared: SharedArgs,
    },
    /// Planners of the AV: score and rank under several simulators
    #[command(after_help = PLANNERS)]
    Planners {
        /// Planners, separated by commas: pdm-closed, idm, diffusion-planner, simulator:ID; external ones
        /// (--planner) are added
        #[arg(long, value_delimiter = ',', value_name = "IDS", default_value = "idm,pdm-closed")]
        planners: Vec<String>,
        /// Controller that follows the trajectories of planners
        #[arg(long, value_enum, default_value = "lqr")]
        tracker: Tracker,
        /// Steps between two plans of a planner; simulators that drive the AV plan every 5 steps
        #[arg(long, default_value = "1steps", value_name = "STEPS")]
        plan_every: Replan,
        #[command(flatten)]
        shared: SharedArgs,
    },
    /// Displacements from the log: by class, situation, speed, distance and time
    #[command(after_help = ERRORS)]
    Errors {
        #[command(flatten)]
        shared: SharedArgs,
    },
}

/// Name of a controller.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum Tracker {
    // No doc comments here: clap would list them, and the guide explains both.
    Lqr,
    Perfect,
}

impl NamedStudy {
    pub(super) fn shared(&self) -> &SharedArgs {
        match self {
            Self::Replan { shared, .. }
            | Self::Realism { shared, .. }
            | Self::RealismReactivity { shared, .. }
            | Self::Guards { shared }
            | Self::Planners { shared, .. }
            | Self::Errors { shared } => shared,
        }
    }

    /// Returns the kind, and the keys that are not taken from the command line, because the study sets them.
    fn kind(&self) -> (StudyKind, &'static [&'static str]) {
        match self {
            Self::Replan { .. } => (StudyKind::Replan, &["replan"]),
            Self::Realism { .. } => (StudyKind::Realism, &["protocol"]),
            Self::RealismReactivity { .. } => (StudyKind::Realism, &["protocol", "keep-rollouts"]),
            Self::Guards { .. } => (StudyKind::Guards, &["smooth", "protocol", "av-lookahead"]),
            Self::Planners { .. } => (StudyKind::Planners, &["av", "protocol"]),
            Self::Errors { .. } => (StudyKind::Errors, &["av", "protocol"]),
        }
    }

    /// Returns what the study varies on these scenarios.
    pub(super) fn design(&self, sources: &[Source]) -> anyhow::Result<Design> {
        let (given, (kind, set)) = (&self.shared().spec.given, self.kind());
        if let Some(key) = set.iter().find(|key| given.contains(&key.replace('-', "_"))) {
            let name = match self {
                Self::RealismReactivity { .. } => "realism-reactivity",
                _ => kind.name(),
            };
            bail!("--{key}: `study {name}` sets it: leave out --{key}");
        }
        let mut design =
            Design { kind, spec: self.shared().spec.value.clone(), axes: Vec::new(), realism_rollouts: None };
        let (subject, rollout) = (&mut design.spec.subject, &mut design.spec.rollout);
        if set.contains(&"protocol") {
            rollout.protocol = Protocol::Reactive;
        }
        match self {
            Self::Replan { intervals, .. } => {
                let mut intervals = intervals.clone();
                intervals.sort_by_key(|interval| interval.steps());
                design.axes.push(Axis::new("replan", intervals));
            }
            Self::Realism { reactive_rollouts, .. } => {
                design.both_protocols(given, Some(*reactive_rollouts))?;
            }
            Self::RealismReactivity { training, simulator, .. } => {
                add_networks(subject, training, simulator)?;
                design.spec.keep_rollouts = Some(true);
                design.both_protocols(given, None)?;
            }
            // The axes are the variants of the simulators, and whether agents see the AV one step ahead.
            Self::Guards { .. } => {}
            Self::Planners { planners, tracker, plan_every, .. } => {
                if subject.models.is_empty() && subject.external.external.is_empty() {
                    subject.models = SIMULATORS.map(str::to_owned).to_vec();
                }
                let external = subject.external.planner.iter().filter_map(|text| text.split_once('='));
                let external = external.map(|(name, _)| format!("external:{name}"));
                let mut avs = planned(planners, external, *tracker, *plan_every)?;
                avs.extend(are_deviated(sources).then_some(AvChoice::Deviated));
                // Whatever drives the AV, the same agents enter.
                if !subject.input.is_shipped() {
                    rollout.entering.get_or_insert(Entering::Log);
                }
                design.axes.push(Axis::new("av", avs));
                design.spec.keep_rollouts = Some(true);
            }
            Self::Errors { .. } => {
                subject.av = Some(AvChoice::Log);
                design.spec.keep_rollouts = Some(true);
            }
        }
        Ok(design)
    }
}

impl Design {
    /// Varies the protocol. `given` are the keys that the user has set; the realism protocol has their
    /// number of rollouts, and so has the reactive one without a number of its own.
    fn both_protocols(&mut self, given: &[String], reactive_rollouts: Option<u32>) -> anyhow::Result<()> {
        let rollouts = &mut self.spec.rollout.rollouts;
        let is_given = given.iter().any(|id| id == "rollouts") || *rollouts > 1;
        let realism_rollouts = if is_given { *rollouts } else { REALISM_ROLLOUTS };
        self.realism_rollouts = Some(realism_rollouts);
        *rollouts = reactive_rollouts.unwrap_or(realism_rollouts);
        if self.spec.keeps_rollouts() && self.spec.settings().entering == Entering::Log {
            bail!(
                "realism metrics are of the agents at the start: leave --keep-rollouts or --entering log out"
            );
        }
        self.axes.push(Axis::new("protocol", [Protocol::Reactive, Protocol::Realism]));
        Ok(())
    }
}

/// Adds the networks that these trainings (`NAME=FOLDER`) have kept, as variants of a simulator.
fn add_networks(subject: &mut SubjectSpec, trainings: &[String], simulator: &str) -> anyhow::Result<()> {
    for text in trainings {
        let is_label = |name: &str| name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c));
        let Some((name, folder)) =
            text.split_once('=').filter(|(name, _)| !name.is_empty() && is_label(name))
        else {
            bail!("--training {text}: expected NAME=FOLDER; the name has letters, digits, `-` and `_`");
        };
        let kept = kept_weights(Path::new(folder)).with_context(|| format!("--training {text}"))?;
        if kept.is_empty() {
            bail!("--training {text}: the folder has no kept networks: train with --keep-every");
        }
        for (step, path) in kept {
            let id = training_paths::network_id(simulator, name, step);
            subject.model_weights.push(format!("{id}={}", path.display()));
            subject.models.push(id);
        }
    }
    Ok(())
}

/// Returns the log and these planners, and the external ones that are not among them, with this tracker and
/// interval.
fn planned(
    planners: &[String],
    external: impl Iterator<Item = String>,
    tracker: Tracker,
    every: Replan,
) -> anyhow::Result<Vec<AvChoice>> {
    let mut all: Vec<PlannedAv> = vec!["log".parse()?];
    for id in planners {
        let planned: PlannedAv = id.parse()?;
        if planned.driver != AvDriver::Log {
            all.push(with_settings(planned, tracker, every)?);
        }
    }
    for id in external {
        let planned: PlannedAv = id.parse()?;
        if !all.iter().any(|given| given.driver == planned.driver) {
            all.push(with_settings(planned, tracker, every)?);
        }
    }
    Ok(all.into_iter().map(AvChoice::Planned).collect())
}

/// Sets the tracker and the interval of a planner. Simulators have neither.
fn with_settings(planned: PlannedAv, tracker: Tracker, every: Replan) -> anyhow::Result<PlannedAv> {
    if matches!(planned.driver, AvDriver::Simulator(_)) {
        return Ok(planned);
    }
    let controller = match tracker {
        Tracker::Lqr => Controller::LqrBicycle,
        Tracker::Perfect => Controller::PerfectTracking,
    };
    // Parsed again, for the check that the controller can follow the planner.
    Ok(PlannedAv { controller, every, ..planned }.to_string().parse()?)
}

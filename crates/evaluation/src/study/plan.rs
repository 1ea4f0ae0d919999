//! The plan of a study.

use std::mem;

use reactsim_formats::Partition;
use reactsim_rollout::{Protocol, Replan, Settings};

use super::guards::{self, Variant};
use super::{Member, Study, StudyKind};
use crate::av::{AvChoice, PlannedAv};
use crate::error::EvaluationError;
use crate::plan::{Plan, RunSettings};
use crate::simulators::{Adjustments, PlannedSimulator};
use crate::source::Source;
use crate::spec::{are_deviated, with_driver};

/// The plans of all members of a study. They share the scenarios, so there is one plan, in which
/// [`Self::select`] sets the settings and simulators of a member.
pub struct StudyPlan {
    study: Study,
    /// Settings of each member, and the index of its set of simulators.
    settings: Vec<(RunSettings, usize)>,
    /// Sets of simulators. The selected set is empty here because it is in the plan.
    sets: Vec<Vec<PlannedSimulator>>,
    selected: usize,
    plan: Plan,
}

impl StudyPlan {
    /// Plans the simulators of a plan, in its protocol, at several different replan intervals, in the given
    /// order.
    pub fn replan(plan: Plan, intervals: &[Replan]) -> Self {
        let protocol = plan.settings.rollout.protocol;
        let member = |replan: &Replan| {
            let steps = replan.steps();
            let member = Member {
                folder: format!("steps-{steps:02}"),
                label: every(steps),
                replan_steps: Some(steps),
                protocol: (protocol != Protocol::Reactive).then(|| protocol.name().to_owned()),
                ..Member::default()
            };
            let rollout = Settings { replan: *replan, ..plan.settings.rollout };
            (member, RunSettings { rollout, ..plan.settings.clone() })
        };
        let members = intervals.iter().map(member).collect();
        Self::of_one_set(StudyKind::Replan, members, plan)
    }

    /// Plans the simulators of a plan in the reactive protocol, and in the realism protocol with this number
    /// of rollouts.
    pub fn realism(plan: Plan, rollouts: u32) -> Self {
        let member = |protocol: Protocol, settings: RunSettings| {
            let member = Member {
                folder: protocol.name().to_owned(),
                label: format!("{} protocol", protocol.name()),
                protocol: Some(protocol.name().to_owned()),
                ..Member::default()
            };
            let rollout = Settings { protocol, ..settings.rollout };
            (member, RunSettings { rollout, ..settings })
        };
        let reactive = plan.settings.clone();
        let realism = RunSettings { av: AvChoice::Log, rollouts, ..reactive.clone() };
        let members = vec![member(Protocol::Reactive, reactive), member(Protocol::Realism, realism)];
        Self::of_one_set(StudyKind::Realism, members, plan)
    }

    /// Plans the unchanged simulators of a plan, and each variant with one component added or removed; all of
    /// them with and without observing the AV one step ahead. `adjustments` are those of the simulators of
    /// the plan.
    ///
    /// # Errors
    /// [`EvaluationError`] for a simulator that cannot be created.
    pub fn guards(plan: Plan, adjustments: &Adjustments) -> Result<Self, EvaluationError> {
        let mut variants = vec![Variant::as_is(&plan.simulators)];
        variants.extend(guards::variants(&plan.simulators, adjustments)?);
        let (mut members, mut settings) = (Vec::new(), Vec::new());
        for (set, variant) in variants.iter().enumerate() {
            for av_lookahead in [true, false] {
                members.push(variant.member(av_lookahead));
                let rollout = Settings { av_lookahead, ..plan.settings.rollout };
                settings.push((RunSettings { rollout, ..plan.settings.clone() }, set));
            }
        }
        let sets = variants.into_iter().map(|v| v.simulators).collect();
        let study = Study::new(StudyKind::Guards, members);
        Ok(Self { study, settings, sets, selected: 0, plan })
    }

    /// Plans the simulators of a plan with each of these planners driving the AV, and with the deviated AVs
    /// if the scenarios have them: what simulators do there without need tells whether their agents freeze.
    /// Rollouts are kept, since reasons of collisions are found in them. The drivers of the plan are those
    /// that the planners may name.
    ///
    /// # Errors
    /// [`EvaluationError`] for a planner that is not given, or a simulator that cannot drive.
    pub fn planners(mut plan: Plan, planners: &[PlannedAv]) -> Result<Self, EvaluationError> {
        plan.keep_rollouts = true;
        let mut members: Vec<(Member, RunSettings)> = Vec::new();
        for planned in planners {
            let av = AvChoice::Planned(planned.clone());
            plan.drivers = with_driver(&av, plan.drivers)?;
            let planner = planned.to_string();
            let mut folder: String =
                planner.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect();
            while members.iter().any(|(member, _)| member.folder == folder) {
                folder.push('-');
            }
            let member =
                Member { folder, label: planner.clone(), planner: Some(planner), ..Member::default() };
            members.push((member, RunSettings { av, ..plan.settings.clone() }));
        }
        if plan.deviations.is_some() || are_deviated(&plan.sources) {
            let member = Member {
                folder: "deviated".to_owned(),
                label: "deviated AVs, for over-reaction".to_owned(),
                ..Member::default()
            };
            members.push((member, RunSettings { av: AvChoice::Deviated, ..plan.settings.clone() }));
        }
        Ok(Self::of_one_set(StudyKind::Planners, members, plan))
    }

    /// Plans the simulators of a plan around AVs that follow the log. Rollouts are kept, since displacements are
    /// measured in them.
    pub fn errors(mut plan: Plan) -> Self {
        plan.keep_rollouts = true;
        let label = "AV as recorded".to_owned();
        let member = Member { folder: "log-av".to_owned(), label, ..Member::default() };
        let settings = RunSettings { av: AvChoice::Log, ..plan.settings.clone() };
        Self::of_one_set(StudyKind::Errors, vec![(member, settings)], plan)
    }

    fn of_one_set(kind: StudyKind, members: Vec<(Member, RunSettings)>, plan: Plan) -> Self {
        let (members, settings) = members.into_iter().map(|(m, s)| (m, (s, 0))).unzip();
        Self { study: Study::new(kind, members), settings, sets: vec![Vec::new()], selected: 0, plan }
    }

    /// Returns the study.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// Returns the scenario files, which all members share.
    pub fn sources(&self) -> &[Source] {
        &self.plan.sources
    }

    /// Restricts all members to a partition, for which the sources were opened.
    pub fn set_partition(&mut self, partition: Option<Partition>) {
        self.plan.partition = partition;
    }

    /// Switches to a member and returns its plan.
    pub fn select(&mut self, member: usize) -> &Plan {
        let (settings, set) = &self.settings[member];
        mem::swap(&mut self.plan.simulators, &mut self.sets[self.selected]);
        mem::swap(&mut self.plan.simulators, &mut self.sets[*set]);
        self.selected = *set;
        self.plan.settings = settings.clone();
        &self.plan
    }
}

/// Returns a replan interval in words, with its rate at 10 steps per second.
fn every(steps: usize) -> String {
    let rate = (1000.0 / steps as f64).round() / 100.0;
    match steps {
        1 => format!("every step ({rate} Hz)"),
        _ => format!("every {steps} steps ({rate} Hz)"),
    }
}

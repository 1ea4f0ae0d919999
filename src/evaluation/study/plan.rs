//! What a study runs.

use std::mem;

use super::guards::{self, Variant};
use super::{Member, Study, StudyKind};
use crate::evaluation::{Adjustments, AvChoice, EvaluationError, Plan, PlannedSimulator, RunSettings};
use crate::rollout::{Protocol, Replan, Settings};

/// The plans of all members of a study. They share the scenarios, so one plan is kept, into which [`Self::select`] puts what a member
/// has of its own.
pub struct StudyPlan {
    study: Study,
    /// Settings of each member, and which of the sets of simulators it has.
    settings: Vec<(RunSettings, usize)>,
    /// Sets of simulators; the selected one is empty here, for it is in the plan.
    sets: Vec<Vec<PlannedSimulator>>,
    selected: usize,
    plan: Plan,
}

impl StudyPlan {
    /// The simulators of a plan, in its protocol, at several replan intervals, in the order given; they differ.
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

    /// The simulators of a plan as it is, in the reactive protocol, and in the realism protocol with so many rollouts.
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

    /// The simulators of a plan as they are, and each without and with what can be taken from it or put to it; all of them with the AV
    /// seen a step ahead and not. `asked` is what the simulators of the plan were made with.
    ///
    /// # Errors
    /// [`EvaluationError`] for a simulator that can not be made.
    pub fn guards(plan: Plan, asked: &Adjustments) -> Result<Self, EvaluationError> {
        let mut variants = vec![Variant::as_is(&plan.simulators)];
        variants.extend(guards::variants(&plan.simulators, asked)?);
        let (mut members, mut settings) = (Vec::new(), Vec::new());
        for (set, variant) in variants.iter().enumerate() {
            for av_lookahead in [true, false] {
                members.push(variant.member(av_lookahead));
                let rollout = Settings { av_lookahead, ..plan.settings.rollout };
                settings.push((RunSettings { rollout, ..plan.settings.clone() }, set));
            }
        }
        let sets = variants.into_iter().map(|v| v.made).collect();
        let study = Study::new(StudyKind::Guards, members);
        Ok(Self { study, settings, sets, selected: 0, plan })
    }

    fn of_one_set(kind: StudyKind, members: Vec<(Member, RunSettings)>, plan: Plan) -> Self {
        let (members, settings) = members.into_iter().map(|(m, s)| (m, (s, 0))).unzip();
        Self { study: Study::new(kind, members), settings, sets: vec![Vec::new()], selected: 0, plan }
    }

    /// What the study consists of.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// The plan of a member.
    pub fn select(&mut self, member: usize) -> &Plan {
        let (settings, set) = &self.settings[member];
        mem::swap(&mut self.plan.simulators, &mut self.sets[self.selected]);
        mem::swap(&mut self.plan.simulators, &mut self.sets[*set]);
        self.selected = *set;
        self.plan.settings = settings.clone();
        &self.plan
    }
}

/// An interval in words, with its rate at 10 steps a second.
fn every(steps: usize) -> String {
    let rate = (1000.0 / steps as f64).round() / 100.0;
    match steps {
        1 => format!("every step ({rate} Hz)"),
        _ => format!("every {steps} steps ({rate} Hz)"),
    }
}

//! The plan of a study.

use std::mem;

use reactsim_metrics::Options;
use reactsim_qp::Smoothing;
use reactsim_rollout::Protocol;

use super::guards::{self, Variant};
use super::{Member, Study, StudyKind};
use crate::av::{AvChoice, AvDriver};
use crate::error::EvaluationError;
use crate::plan::Plan;
use crate::plan::of_spec::{RunParts, with_driver};
use crate::simulators::{PlannedSimulator, refuse_repeated};
use crate::source::Source;
use crate::spec::{AxisValue, ExternalPrograms, RunSpec, SubjectSpec};

/// The plans of all members of a study. They share the scenarios, so there is one plan, in which
/// [`Self::select`] sets the specification and the simulators of a member.
pub struct StudyPlan {
    study: Study,
    /// Specification of each member, its variants of the metrics, and the index of its set of simulators.
    specs: Vec<(RunSpec, Options, usize)>,
    /// Sets of simulators. The selected set is empty here because it is in the plan.
    sets: Vec<Vec<PlannedSimulator>>,
    selected: usize,
    plan: Plan,
}

/// A specification, and its values on the axes of the study.
pub type AxisPoint = (RunSpec, Vec<AxisValue>);

impl StudyPlan {
    /// Plans a member for each of these points, of which there is at least one. A study of kind `guards` has
    /// one point, and members for the variants of its simulators. `parts` are those of all members, without
    /// simulators; `programs` are their external ones.
    ///
    /// # Errors
    /// [`EvaluationError`] for a member that cannot be planned as a run of its own.
    pub fn new(
        kind: StudyKind,
        mut points: Vec<AxisPoint>,
        parts: RunParts,
        programs: &ExternalPrograms,
    ) -> Result<Self, EvaluationError> {
        let mut sets = Simulators { programs, sets: Vec::new() };
        if kind == StudyKind::Replan {
            sets.leave_out_oracles(&mut points)?;
        }
        let members = match kind {
            StudyKind::Guards => guarded(&points[0].0, &mut sets)?,
            _ => named(kind, points),
        };
        let is_reactive = |spec: &RunSpec| spec.rollout.protocol == Protocol::Reactive;
        let first = members.iter().position(|(_, spec)| is_reactive(spec)).unwrap_or_default();
        let mut plan = members[first].1.plan(parts)?;
        let av = plan.spec.subject.av.clone();
        let (mut study, mut specs) = (Vec::new(), Vec::new());
        for (member, mut spec) in members {
            spec.check()?;
            if is_reactive(&spec) && spec.subject.av.is_none() {
                spec.subject.av.clone_from(&av);
            }
            plan.drivers = with_driver(spec.subject.av.as_ref(), plan.drivers)?;
            keep_driver(&mut spec);
            let set = sets.of(&spec)?;
            specs.push((spec.clone(), spec.subject.options()?, set));
            study.push(member);
        }
        let mut sets: Vec<_> = sets.sets.into_iter().map(|(_, simulators)| simulators).collect();
        plan.simulators = mem::take(&mut sets[0]);
        Ok(Self { study: Study::new(kind, study), specs, sets, selected: 0, plan })
    }

    /// Returns the study.
    pub fn study(&self) -> &Study {
        &self.study
    }

    /// Returns the scenario files, which all members share.
    pub fn sources(&self) -> &[Source] {
        &self.plan.sources
    }

    /// Switches to a member and returns its plan.
    pub fn select(&mut self, member: usize) -> &Plan {
        let (spec, options, set) = &self.specs[member];
        mem::swap(&mut self.plan.simulators, &mut self.sets[self.selected]);
        mem::swap(&mut self.plan.simulators, &mut self.sets[*set]);
        self.selected = *set;
        (self.plan.spec, self.plan.options) = (spec.clone(), *options);
        &self.plan
    }
}

/// Simulators of the members, which share them where their specifications name the same ones.
struct Simulators<'a> {
    programs: &'a ExternalPrograms,
    sets: Vec<(RunSpec, Vec<PlannedSimulator>)>,
}

impl Simulators<'_> {
    /// Returns the index of the simulators of a specification.
    fn of(&mut self, spec: &RunSpec) -> Result<usize, EvaluationError> {
        let is_same = |(other, _): &(RunSpec, _)| other.has_simulators_of(spec);
        if let Some(set) = self.sets.iter().position(is_same) {
            return Ok(set);
        }
        let mut simulators = spec.baselines()?;
        simulators.extend(self.programs.planned(spec)?);
        refuse_repeated(simulators.iter().map(|simulator| simulator.id.as_str()))?;
        self.sets.push((spec.clone(), simulators));
        Ok(self.sets.len() - 1)
    }

    /// Names the default simulators in specifications that name none, without those that have the log's
    /// future: their motion does not depend on the replan interval, in which the specifications differ.
    fn leave_out_oracles(&mut self, points: &mut [AxisPoint]) -> Result<(), EvaluationError> {
        let first = &points[0].0;
        if !first.subject.models.is_empty() || !first.subject.external.external.is_empty() {
            return Ok(());
        }
        let set = self.of(first)?;
        let (named, simulators) = &mut self.sets[set];
        simulators.retain(|simulator| !simulator.controller.is_oracle());
        let id = |simulator: &PlannedSimulator| match Smoothing::of_id(&simulator.id) {
            Some((id, stage)) if Some(stage) == first.rollout.smooth.0 => id.to_owned(),
            _ => simulator.id.clone(),
        };
        named.subject.models = simulators.iter().map(id).collect();
        points.iter_mut().for_each(|(spec, _)| spec.subject.models.clone_from(&named.subject.models));
        Ok(())
    }
}

/// Removes external planners that do not drive the AV of a member: a run of its own refuses them.
fn keep_driver(spec: &mut RunSpec) {
    let SubjectSpec { av, external, .. } = &mut spec.subject;
    external.planner.retain(|text| {
        let driver = text.split_once('=').map(|(name, _)| AvDriver::External(name.to_owned()));
        matches!(av, Some(AvChoice::Planned(planned)) if Some(&planned.driver) == driver.as_ref())
    });
}

/// Returns the members of a study whose simulators are changed: unchanged, and each variant with one
/// component added or removed; all of them with and without observing the AV one step ahead.
fn guarded(spec: &RunSpec, sets: &mut Simulators<'_>) -> Result<Vec<(Member, RunSpec)>, EvaluationError> {
    let set = sets.of(spec)?;
    let simulators = &sets.sets[set].1;
    let mut variants = vec![Variant::as_is(simulators, spec)];
    variants.extend(guards::variants(simulators, spec)?);
    let mut members = Vec::new();
    for variant in variants {
        for av_lookahead in [1, 0] {
            let mut spec = variant.spec.clone();
            spec.rollout.av_lookahead = av_lookahead;
            members.push((variant.member(av_lookahead == 1), spec));
        }
    }
    Ok(members)
}

/// Returns the members of a study at these points, with different folders.
fn named(kind: StudyKind, points: Vec<AxisPoint>) -> Vec<(Member, RunSpec)> {
    let mut members: Vec<(Member, RunSpec)> = Vec::with_capacity(points.len());
    for (spec, point) in points {
        let mut member = member(kind, &spec, point);
        while members.iter().any(|(other, _)| other.folder == member.folder) {
            member.folder.push('-');
        }
        members.push((member, spec));
    }
    members
}

/// Returns the member of a study with this specification.
fn member(kind: StudyKind, spec: &RunSpec, axes: Vec<AxisValue>) -> Member {
    let (steps, protocol) = (spec.rollout.replan.steps(), spec.rollout.protocol.name().to_owned());
    match (kind, &spec.subject.av) {
        (StudyKind::Replan, _) => Member {
            folder: format!("steps-{steps:02}"),
            label: every(steps),
            replan_steps: Some(steps),
            protocol: Some(protocol).filter(|protocol| protocol != Protocol::Reactive.name()),
            ..Member::default()
        },
        (StudyKind::Realism, _) => Member {
            folder: protocol.clone(),
            label: format!("{protocol} protocol"),
            protocol: Some(protocol),
            ..Member::default()
        },
        (StudyKind::Planners, Some(AvChoice::Planned(planned))) => Member {
            folder: folder_name(&planned.to_string()),
            label: planned.to_string(),
            planner: Some(planned.to_string()),
            ..Member::default()
        },
        (StudyKind::Planners, _) => Member {
            folder: "deviated".to_owned(),
            label: "deviated AVs, for over-reaction".to_owned(),
            ..Member::default()
        },
        (StudyKind::Errors, _) => {
            Member { folder: "log-av".to_owned(), label: "AV as recorded".to_owned(), ..Member::default() }
        }
        (StudyKind::Axes | StudyKind::Guards, _) => {
            let texts: Vec<String> = axes.iter().map(|at| format!("{} {}", at.key, at.value)).collect();
            let names: Vec<String> = texts.iter().map(|text| folder_name(text)).collect();
            Member { folder: names.join("_"), label: texts.join(", "), axes, ..Member::default() }
        }
    }
}

/// Returns a text with the characters of names of folders.
fn folder_name(text: &str) -> String {
    text.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).collect()
}

/// Returns a replan interval in words, with its rate at 10 steps per second.
fn every(steps: usize) -> String {
    let rate = (1000.0 / steps as f64).round() / 100.0;
    match steps {
        1 => format!("every step ({rate} Hz)"),
        _ => format!("every {steps} steps ({rate} Hz)"),
    }
}

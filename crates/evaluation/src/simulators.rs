//! The simulators of a run, with their parameters and weights.

pub(crate) mod mix;
pub(crate) mod access;
pub(crate) mod id;
pub(crate) mod record;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use reactsim_baseline::{Baseline, Card, ModelError, WeightsFile};
use reactsim_external::{ExternalSimulator, Processes};
use reactsim_files::{name_of, read_regular};
use reactsim_models as models;
use reactsim_models::MODELS;
use reactsim_nn::{Backend, check_backend};
use reactsim_qp as qp;
use reactsim_qp::Smoothing;
use reactsim_rollout::{Controller, Entering, Mix, MixMember};

use crate::error::EvaluationError;
use crate::simulators::id::SimulatorId;
use crate::simulators::mix::{MixId, joined};
use crate::simulators::record::{ExternalRecord, SimulatorRecord, WeightsRecord};

/// A simulator that is ready to run.
pub struct PlannedSimulator {
    /// Id of the baseline and, if any, label of the variant and id of the stage behind it:
    /// `ntp-reactive@mine+qp`. Id of a mix: `mix:idm=0.5+ntp-guarded=0.5`.
    pub id: String,
    /// Name in tables.
    pub title: String,
    /// Text of its card and, if any, of the card of the stage behind it.
    pub card: String,
    /// Parameters that differ from the card, by dotted path, in TOML notation.
    pub parameters: BTreeMap<String, String>,
    /// Weights, if the simulator has any.
    pub weights: Option<WeightsRecord>,
    /// Simulators of a mix, with their parameters and weights; otherwise empty.
    pub members: Vec<SimulatorRecord>,
    /// Backend of its network, if it has one.
    pub backend: Option<Backend>,
    /// The external program that it is, if it is one.
    pub external: Option<ExternalRecord>,
    /// The simulator.
    pub controller: Controller,
    /// Its processes, if it is an external program.
    pub(super) processes: Option<Processes>,
}

/// Requested changes to simulators, beyond their cards and the weights that ship.
#[derive(Clone, Debug, Default)]
pub struct Adjustments {
    /// Files of weights, by id.
    pub weights: Vec<(String, WeightsFile)>,
    /// Parameters: id, dotted path, value in TOML notation.
    pub parameters: Vec<(String, String, String)>,
    /// A stage to put behind every simulator that is not an oracle.
    pub smoothing: Option<Smoothing>,
    /// Backend of the networks.
    pub backend: Backend,
}

impl Adjustments {
    /// Returns the ids of the simulators that are changed.
    pub fn ids(&self) -> impl Iterator<Item = &str> {
        let weights = self.weights.iter().map(|(id, _)| id.as_str());
        weights.chain(self.parameters.iter().map(|(id, _, _)| id.as_str()))
    }
}

/// A simulator, and the stage behind it.
struct SelectedSimulator {
    id: String,
    /// Id without the stage.
    variant: String,
    kind: SelectedKind,
    smoothing: Option<Smoothing>,
}

/// What a [`SelectedSimulator`] is.
enum SelectedKind {
    /// A baseline, or the variant of it with this label.
    Baseline(&'static Baseline, Option<String>),
    /// A mix of simulators, which are in the order of [`MixId::members`].
    Mix(MixId, Vec<SelectedSimulator>),
}

impl SelectedSimulator {
    /// Returns whether `id` is its id, with or without the stage, or that of a member.
    fn is_named(&self, id: &str) -> bool {
        let is_member = match &self.kind {
            SelectedKind::Baseline(..) => false,
            SelectedKind::Mix(_, members) => members.iter().any(|member| member.is_named(id)),
        };
        is_member || self.id == id || self.variant == id
    }

    /// Returns the id of its baseline, for messages.
    fn baseline_id(&self) -> &'static str {
        match &self.kind {
            SelectedKind::Baseline(baseline, _) => baseline.id,
            SelectedKind::Mix(..) => "mix",
        }
    }

    /// Returns whether a stage can follow it; none has been chosen yet.
    fn takes_stage(&self) -> bool {
        self.smoothing.is_none()
            && match &self.kind {
                SelectedKind::Baseline(baseline, _) => baseline.takes_stage,
                SelectedKind::Mix(_, members) => members.iter().all(Self::takes_stage),
            }
    }
}

/// Weights and parameters of the simulators of a run.
struct Changes<'a> {
    /// Files of weights, by id.
    weights: BTreeMap<&'a str, &'a WeightsFile>,
    /// Values of parameters, by id and dotted path.
    parameters: BTreeMap<(&'a str, &'a str), &'a str>,
    backend: Backend,
}

/// Name of the baselines that run if none are named.
const DEFAULT: &str = "default";
/// Name of all baselines that have their weights.
const ALL: &str = "all";

impl PlannedSimulator {
    /// Returns its record for the provenance.
    pub(crate) fn record(&self, entering: Entering) -> SimulatorRecord {
        SimulatorRecord {
            id: self.id.clone(),
            title: self.title.clone(),
            oracle: self.controller.is_oracle(),
            card: blake3::hash(self.card.as_bytes()).to_hex().to_string(),
            parameters: self.parameters.clone(),
            weights: self.weights.clone(),
            members: self.members.clone(),
            external: self.external.clone().zip(self.batch(entering)).map(|(mut external, batch)| {
                external.batch = batch;
                external
            }),
        }
    }

    /// Creates simulators by their ids; if `ids` is empty, those that run by default. `default` stands for
    /// the same ones, `all` for all baselines that have their weights.
    ///
    /// # Errors
    /// [`EvaluationError`] names an unknown or repeated id, a card that cannot be read, or a baseline without
    /// weights.
    pub fn by_ids(ids: &[String]) -> Result<Vec<Self>, EvaluationError> {
        Self::adjusted(ids, &Adjustments::default())
    }

    /// Like [`Self::by_ids`], with the requested weights and parameters. If `ids` is empty, baselines whose
    /// weights do not ship are included if their weights are given, and so are variants (`idm@calm`) with
    /// weights or parameters of their own.
    ///
    /// # Errors
    /// Also names weights or parameters that are repeated, are for a simulator that does not run, cannot be
    /// read, or do not fit.
    pub fn adjusted(ids: &[String], adjustments: &Adjustments) -> Result<Vec<Self>, EvaluationError> {
        let all = select(&joined(ids), adjustments)?;
        let runs = |id: &str| {
            if MixId::parse(id)?.is_some() {
                return Err(EvaluationError::Refused(format!(
                    "`{id}`: a mix has no parameters or weights: give those of a member, by its id"
                )));
            }
            if !all.iter().any(|selected| selected.is_named(id)) {
                named(id)?;
                return Err(EvaluationError::not_run(id));
            }
            Ok(())
        };
        let mut weights: BTreeMap<&str, &WeightsFile> = BTreeMap::new();
        for (id, file) in &adjustments.weights {
            runs(id)?;
            if weights.insert(id, file).is_some() {
                return Err(EvaluationError::Refused(format!("the simulator `{id}` is given weights twice")));
            }
        }
        let mut changes: BTreeMap<(&str, &str), &str> = BTreeMap::new();
        for (id, key, value) in &adjustments.parameters {
            runs(id)?;
            if changes.insert((id, key), value).is_some() {
                let text = format!("the parameter `{key}` of `{id}` is set twice");
                return Err(EvaluationError::Refused(text));
            }
        }
        let changes = Changes { weights, parameters: changes, backend: adjustments.backend };
        all.iter().map(|selected| Self::make(selected, &changes)).collect()
    }

    /// Creates the entry of a simulator that is not a baseline. Its id is also its title.
    pub fn own(id: impl Into<String>, controller: Controller) -> Self {
        let id = id.into();
        Self {
            title: id.clone(),
            id,
            card: String::new(),
            parameters: BTreeMap::new(),
            weights: None,
            members: Vec::new(),
            backend: None,
            external: None,
            controller,
            processes: None,
        }
    }

    /// Creates the entry of an external simulator, with a stage behind it if requested.
    ///
    /// # Errors
    /// [`EvaluationError`] if a baseline has its name.
    pub fn external(
        simulator: ExternalSimulator,
        smoothing: Option<Smoothing>,
    ) -> Result<Self, EvaluationError> {
        let mut id = simulator.processes().name().to_owned();
        if named(&id).is_ok() {
            return Err(EvaluationError::repeated(&id));
        }
        let (mut title, mut card) = (id.clone(), String::new());
        let external = ExternalRecord::of(simulator.processes(), simulator.batch());
        let processes = Some(simulator.processes().clone());
        let mut controller = Controller::Fair(Box::new(simulator));
        if let Some(smoothing) = smoothing {
            controller = smoothing.behind("external", controller)?;
            (title, id) = (format!("{title} + {}", smoothing.name()), smoothing.id(&id));
            card.push_str(qp::CARD);
        }
        Ok(Self { title, card, external: Some(external), processes, ..Self::own(id, controller) })
    }

    /// Returns the number of scenarios of a file that are always rolled out together: the batch of an
    /// external simulator. It is 1 where agents enter, because its episodes begin and end together.
    pub(super) fn batch(&self, entering: Entering) -> Option<usize> {
        let external = self.external.as_ref()?;
        Some(if entering == Entering::Off { external.batch } else { 1 })
    }

    /// Returns the reason why its processes were given up, if they were.
    pub(super) fn given_up(&self) -> Option<String> {
        self.processes.as_ref()?.given_up()
    }

    fn make(selected: &SelectedSimulator, changes: &Changes<'_>) -> Result<Self, EvaluationError> {
        let mut made = match &selected.kind {
            SelectedKind::Baseline(baseline, label) => {
                Self::baseline(selected, baseline, label.as_deref(), changes)?
            }
            SelectedKind::Mix(mix, members) => {
                if selected.smoothing.is_some()
                    && let Some(member) = members.iter().find(|member| !member.takes_stage())
                {
                    return Err(ModelError::TakesNoStage { id: member.baseline_id() }.into());
                }
                let members = members.iter().map(|member| Self::make(member, changes));
                Self::mix(&selected.id, mix, members.collect::<Result<_, _>>()?)?
            }
        };
        if let Some(smoothing) = selected.smoothing {
            made.title = format!("{} + {}", made.title, smoothing.name());
            made.controller = smoothing.behind(selected.baseline_id(), made.controller)?;
            made.card.push_str(qp::CARD);
        }
        Ok(made)
    }

    /// Creates a baseline, without the stage behind it.
    fn baseline(
        selected: &SelectedSimulator,
        baseline: &'static Baseline,
        label: Option<&str>,
        changes: &Changes<'_>,
    ) -> Result<Self, EvaluationError> {
        let id = baseline.id;
        if selected.smoothing.is_some() && !baseline.takes_stage {
            return Err(ModelError::TakesNoStage { id }.into());
        }
        let mut setup = baseline.setup()?;
        setup.backend = changes.backend;
        // Adjustments of a variant also apply to it with a stage, unless the id with the stage has its own.
        let ids = [selected.variant.as_str(), selected.id.as_str()];
        let mut values: BTreeMap<&str, &str> = BTreeMap::new();
        for id in ids {
            let own = changes.parameters.iter().filter(|((of, _), _)| *of == id);
            values.extend(own.map(|((_, key), value)| (*key, *value)));
        }
        let mut parameters = BTreeMap::new();
        for (key, value) in values {
            parameters.insert(key.to_owned(), setup.parameters.set(key, value)?);
        }
        if let Some(file) = ids.iter().rev().find_map(|id| changes.weights.get(id)) {
            if !baseline.needs_weights {
                let text = format!("the simulator `{id}` has no weights: omit the file {}", file.name);
                return Err(EvaluationError::Refused(text));
            }
            file.check(id)?;
            setup.weights = Some((*file).clone());
        }
        if baseline.needs_weights {
            setup.weights()?;
        }
        let weights = setup.weights.as_ref().map(WeightsRecord::of);
        let backend = weights.is_some().then_some(setup.backend);
        let mut title = Card::read(id, baseline.card)?.title;
        if let Some(mark) = mark(id, label, setup.weights.as_ref())? {
            title = format!("{title} ({mark})");
        }
        if backend.is_some() {
            check_backend(setup.backend)?;
        }
        Ok(Self {
            title,
            card: baseline.card.to_owned(),
            parameters,
            weights,
            backend,
            ..Self::own(selected.id.clone(), (baseline.make)(setup)?)
        })
    }

    /// Creates a mix of simulators, without the stage behind it.
    fn mix(id: &str, mix: &MixId, members: Vec<Self>) -> Result<Self, EvaluationError> {
        let refuse = |reason: String| EvaluationError::Refused(format!("`{id}`: {reason}"));
        let records: Vec<SimulatorRecord> =
            members.iter().map(|member| member.record(Entering::Off)).collect();
        let title = |id: &str| records.iter().find(|member| member.id == id).map_or("", |m| m.title.as_str());
        let title = mix.title(title);
        let card = members.iter().map(|member| member.card.as_str()).collect();
        let backend = members.iter().find_map(|member| member.backend);
        let mut movers = Vec::new();
        for Self { id, controller, .. } in members {
            let Controller::Fair(simulator) = controller else {
                let reason = format!("`{id}` observes the logged future and cannot be part of a mix");
                return Err(refuse(reason));
            };
            let share = mix.shares.iter().find(|(of, _)| *of == id).map_or(0.0, |(_, share)| *share);
            let kinds = mix.classes.iter().filter(|(_, of)| *of == id).map(|(kind, _)| *kind).collect();
            movers.push(MixMember { simulator, share, kinds });
        }
        let mix = Mix::new(movers).ok_or_else(|| refuse("its shares are invalid".to_owned()))?;
        let controller = Controller::Fair(Box::new(mix));
        Ok(Self { title, card, backend, members: records, ..Self::own(id, controller) })
    }
}

/// Reads a file of weights.
///
/// # Errors
/// [`EvaluationError::Read`] names the file.
pub fn weights_file(path: &Path) -> Result<WeightsFile, EvaluationError> {
    let name = name_of(path);
    let bytes =
        read_regular(path).map_err(|source| EvaluationError::Read { path: path.to_owned(), source })?;
    Ok(WeightsFile::new(name, bytes))
}

/// Returns what tells a simulator apart from the known one in tables: its label, or else the name of weights
/// that the manifest does not list, be they new or a damaged copy.
fn mark(
    id: &str,
    label: Option<&str>,
    weights: Option<&WeightsFile>,
) -> Result<Option<String>, EvaluationError> {
    if let Some(label) = label {
        return Ok(Some(label.to_owned()));
    }
    let Some(file) = weights else { return Ok(None) };
    if file.is_listed(id)? {
        return Ok(None);
    }
    Ok(Path::new(&file.name).file_stem().map(|stem| stem.to_string_lossy().into_owned()))
}

/// Returns the simulators to run.
fn select(ids: &[String], adjustments: &Adjustments) -> Result<Vec<SelectedSimulator>, EvaluationError> {
    let mut all: Vec<SelectedSimulator> = Vec::new();
    let has_weights = |b: &Baseline| adjustments.weights.iter().any(|(id, _)| id == b.id);
    if ids.is_empty() {
        let complete = MODELS.iter().filter(|b| b.is_complete() && b.by_default || has_weights(b));
        let adjusted = adjustments.weights.iter().map(|(id, _)| id);
        let adjusted: Vec<&String> =
            adjusted.chain(adjustments.parameters.iter().map(|(id, ..)| id)).collect();
        for baseline in complete {
            all.push(named(baseline.id)?);
            for id in &adjusted {
                let is_variant = SimulatorId::parse(id)?;
                let is_variant = is_variant.baseline == baseline.id && is_variant.label.is_some();
                if is_variant && !all.iter().any(|selected| selected.id == **id) {
                    all.push(named(id)?);
                }
            }
        }
    }
    for id in ids {
        match id.as_str() {
            DEFAULT | ALL => {
                let listed = |b: &&Baseline| b.is_complete() && (b.by_default || id == ALL) || has_weights(b);
                let listed = MODELS.iter().filter(listed).map(|b| named(b.id));
                all.extend(listed.collect::<Result<Vec<_>, _>>()?);
            }
            id => all.push(named(id)?),
        }
    }
    if let Some(smoothing) = adjustments.smoothing {
        for selected in all.iter_mut().filter(|selected| selected.takes_stage()) {
            selected.id = smoothing.id(&selected.variant);
            selected.smoothing = Some(smoothing);
        }
    }
    refuse_repeated(all.iter().map(|selected| selected.id.as_str()))?;
    Ok(all)
}

/// Refuses a list of ids of simulators that has one of them twice.
pub(crate) fn refuse_repeated<'a>(ids: impl Iterator<Item = &'a str>) -> Result<(), EvaluationError> {
    let mut known = BTreeSet::new();
    for id in ids {
        if !known.insert(id) {
            return Err(EvaluationError::repeated(id));
        }
    }
    Ok(())
}

/// Returns the simulator that an id names.
fn named(id: &str) -> Result<SelectedSimulator, EvaluationError> {
    let unknown = |id: &str, text: String| {
        let known = MODELS.iter().map(|m| m.id).collect::<Vec<_>>().join(", ");
        EvaluationError::UnknownSimulator { id: id.to_owned(), text: format!("{text}; there are: {known}") }
    };
    if let Some(mix) = MixId::parse(id)? {
        let of_mix = |error| match error {
            EvaluationError::UnknownSimulator { id: of, .. } => {
                let text = format!("`{id}`: there is no baseline `{of}`, and members of a mix are baselines");
                unknown(&of, text)
            }
            error => error,
        };
        let members = mix.members().into_iter().map(|id| named(id).map_err(of_mix));
        let members = members.collect::<Result<_, _>>()?;
        let (id, smoothing) = (mix.to_string(), mix.smoothing);
        let variant = MixId { smoothing: None, ..mix.clone() }.to_string();
        return Ok(SelectedSimulator { id, variant, kind: SelectedKind::Mix(mix, members), smoothing });
    }
    let SimulatorId { variant, baseline, label, smoothing } = SimulatorId::parse(id)?;
    let baseline = models::find(baseline);
    let baseline = baseline.ok_or_else(|| unknown(id, format!("there is no simulator `{id}`")))?;
    let kind = SelectedKind::Baseline(baseline, label.map(str::to_owned));
    Ok(SelectedSimulator { id: id.to_owned(), variant: variant.to_owned(), kind, smoothing })
}

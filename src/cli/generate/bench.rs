//! `reactsim generate --preset bench`: scenarios with deviated AVs, and a second file with the
//! candidates and certificates.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::job::{GeneratedFiles, Job};
use crate::cli::output::say;
use crate::curation::benchmark::{
    ANY_CATEGORY, ANY_DIFFICULTY, ANY_GROUP, MISSING, PATIENCE, Recipe, TriedScenario,
};
use crate::curation::{CandidateSource, CurationProvenance, CurationSettings, InputFile, SOURCES, store};
use crate::evaluation::{FileRecord, program_version};
use crate::formats::FormatError;
use crate::formats::native::Writer;
use crate::generation::{GenerationSettings, Generator, VERSION};
use crate::scene::Length;

/// Largest number of scenarios that are tried in vain, per requested scenario: a few scenarios are not worth
/// a long search.
const PATIENCE_PER_SCENARIO: u64 = 20;

/// Source of the candidates.
pub(super) const SOURCE: &dyn CandidateSource = SOURCES[0];

/// Returns the path of the file of candidates for a file of scenarios.
fn deviations_path(out: &Path) -> PathBuf {
    out.with_extension("deviations.parquet")
}

/// Generates a benchmark. Scenarios that were `tried` before, if any, come first: their number, and their
/// outcomes.
pub(super) fn bench(
    job: Job<'_>,
    tried: (u64, impl Iterator<Item = Result<Result<TriedScenario, String>, FormatError>>),
) -> anyhow::Result<GeneratedFiles> {
    let Job { settings, wanted, jobs, out, progress, stop } = job;
    let generator = Generator::new(settings.clone())?;
    let deviations_path = deviations_path(out);
    let (mut scenarios, mut deviations) = (Writer::create(out)?, store::Writer::create(&deviations_path)?);
    let groups: Vec<String> = settings.map_types().iter().map(|m| m.source()).collect();
    let curation = curation_settings(settings);
    let recipe = Recipe {
        wanted: u64::from(wanted),
        groups: &groups,
        source: SOURCE,
        settings: &curation,
        patience: PATIENCE.min(PATIENCE_PER_SCENARIO * u64::from(wanted)),
        jobs,
    };
    progress.set_total(Some(wanted as usize));
    let mut written = 0;
    let provenance = recipe.run(
        tried,
        |number| generator.scenario(number),
        provenance(settings, wanted),
        |entry| {
            scenarios.write(&entry.scenario)?;
            deviations.write(&entry.record)?;
            written += 1;
            Ok(())
        },
        progress,
        stop,
    );
    let mut provenance = provenance?;
    let (interrupted, failed) = (provenance.interrupted, provenance.failures.len());
    progress.suspend(|| warn_of_unfilled_quotas(&provenance, wanted, written, groups.len()));
    let mut files = vec![out.to_owned(), deviations_path];
    if written > 0 {
        if interrupted {
            files[0] = scenarios.finish_part()?;
        } else {
            scenarios.finish()?;
        }
        let FileRecord { name, blake3: digest, .. } = FileRecord::of(&files[0], "native")?;
        provenance.inputs = vec![InputFile { name, digest }];
        if interrupted {
            files[1] = deviations.finish_part(&provenance)?;
        } else {
            deviations.finish(&provenance)?;
        }
    }
    let unfilled = provenance.settings.contains_key(MISSING);
    Ok(GeneratedFiles { files, written, failed, unfilled, interrupted })
}

/// Returns the settings that determine the deviated AVs.
pub(super) fn curation_settings(settings: &GenerationSettings) -> CurationSettings {
    CurationSettings { seed: settings.seed, scenes: false, ..CurationSettings::default() }
}

/// Returns what is known about a benchmark before it is generated.
pub(super) fn provenance(settings: &GenerationSettings, wanted: u32) -> CurationProvenance {
    CurationProvenance {
        version: program_version().to_owned(),
        settings: named(settings, wanted),
        ..CurationProvenance::default()
    }
}

/// Prints what a small or rare benchmark lacks.
fn warn_of_unfilled_quotas(provenance: &CurationProvenance, wanted: u32, written: usize, groups: usize) {
    if (wanted as usize) < groups {
        say(format_args!("warning: {wanted} scenarios cannot hold all of {groups} map types"));
    }
    let relaxed = [(ANY_DIFFICULTY, "difficulty"), (ANY_CATEGORY, "category"), (ANY_GROUP, "map type")];
    for (key, what) in relaxed {
        if let Some(places) = provenance.settings.get(key) {
            say(format_args!(
                "warning: {places} of {wanted} scenarios may be of any {what}: too few were found"
            ));
        }
    }
    if let Some(missing) = provenance.settings.get(MISSING) {
        say(format_args!(
            "warning: {written} of {wanted} scenarios were found; still missing: {missing}; \
             try another seed or other map types"
        ));
    }
}

/// Returns all settings by name. The commit is left out: the same generator writes the same bytes.
fn named(settings: &GenerationSettings, wanted: u32) -> BTreeMap<String, String> {
    let curation = curation_settings(settings);
    let mut named = curation.named();
    let mut set = |name: &str, value: String| named.insert(name.to_owned(), value);
    set("source", SOURCE.id().to_owned());
    set("scenes", curation.scenes.to_string());
    set("generator", VERSION.to_string());
    set("generation.preset", settings.preset.name().to_owned());
    set("generation.count", wanted.to_string());
    set("generation.seed", settings.seed.to_string());
    if !settings.maps.is_empty() {
        set("generation.maps", settings.maps.join(","));
    }
    if let Some(density) = settings.density {
        set("generation.density", density.to_string());
    }
    if settings.length != Length::BENCHMARK {
        set("generation.history", settings.length.history.to_string());
        set("generation.future", settings.length.future.to_string());
    }
    named
}

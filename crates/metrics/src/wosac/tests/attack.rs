//! Changed submissions: every one is refused with an error or scored with results in range, without panic.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use flate2::read::GzDecoder;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use reactsim_formats::wosac::{SubmissionCheck, SubmissionMetadata, SubmissionReader, SubmissionWriter};
use reactsim_scene::wosac::WosacLog;

use super::super::{Config, Scorer};
use super::fixture;

/// Number of changed submissions in the quick test and in the full one.
const QUICK: u64 = 60;
const FULL: u64 = 1000;

/// Outcomes of all changed submissions.
#[derive(Debug, Default)]
struct Outcomes {
    errors: u32,
    scored: u32,
}

#[test]
fn changed_submissions_are_refused_or_scored() {
    attack(QUICK);
}

#[test]
#[ignore = "takes a minute"]
fn attack_many_changed_submissions() {
    attack(FULL);
}

fn attack(count: u64) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tar.gz");
    let scenarios: Vec<_> = (0..3).map(|seed| fixture::scenario(seed, 4, 32, [500.0, -500.0])).collect();
    let logs: Vec<WosacLog> = scenarios.iter().map(|(log, _)| log.clone()).collect();
    let metadata = SubmissionMetadata::new("a@example.org", "method", "0");
    let mut writer = SubmissionWriter::create(&path, "method", 2, &metadata).unwrap();
    for (i, (_, rollouts)) in scenarios.iter().enumerate() {
        writer.write(rollouts).unwrap();
        if i == 1 {
            writer.finish_shard().unwrap();
        }
    }
    writer.finish().unwrap();
    let compressed = fs::read(&path).unwrap();
    let mut plain = Vec::new();
    GzDecoder::new(File::open(&path).unwrap()).read_to_end(&mut plain).unwrap();

    let mut untouched = Outcomes::default();
    run(&path, &logs, &mut untouched);
    assert_eq!((untouched.errors, untouched.scored), (0, 3));
    let mut outcomes = Outcomes::default();
    for seed in 0..count {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        // Most changes are made inside the compression, where the checksum of the compression does not find
        // them.
        let is_compressed = rng.random_bool(0.1);
        let mut content = if is_compressed { compressed.clone() } else { plain.clone() };
        change(&mut content, &mut rng);
        let path = folder.path().join(if is_compressed { "changed.tar.gz" } else { "changed.tar" });
        fs::write(&path, &content).unwrap();
        run(&path, &logs, &mut outcomes);
    }
    assert!(outcomes.errors > 0 && outcomes.scored > 0, "{outcomes:?}");
}

/// Reads, validates and scores a submission.
fn run(path: &Path, logs: &[WosacLog], outcomes: &mut Outcomes) {
    let reader = match SubmissionReader::open(path) {
        Ok(reader) => reader,
        Err(error) => {
            assert!(!error.to_string().is_empty());
            outcomes.errors += 1;
            return;
        }
    };
    let mut check = SubmissionCheck::default();
    for submitted in reader {
        let submitted = match submitted {
            Ok(submitted) => submitted,
            Err(error) => {
                assert!(error.to_string().contains("changed.tar"), "{error}");
                outcomes.errors += 1;
                continue;
            }
        };
        // If the id itself was changed, rollouts are compared with the first log.
        let found = logs.iter().find(|log| log.scenario_id == submitted.rollouts.scenario_id);
        let log = found.unwrap_or(&logs[0]);
        if let Err(error) = check.check(&submitted, log) {
            assert!(error.to_string().contains("record"), "{error}");
            outcomes.errors += 1;
            continue;
        }
        let scorer = Scorer::new(log).unwrap();
        for metrics in scorer.score(&submitted.rollouts, &Config::ALL).unwrap() {
            for (name, value) in metrics.fields() {
                let Some(value) = value else { continue };
                let is_displacement = name.ends_with("displacement_error");
                let limit = if is_displacement { 1e6 } else { 1.0 + 1e-6 };
                assert!((0.0..=limit).contains(&value), "{name} is {value}");
            }
        }
        outcomes.scored += 1;
    }
}

fn change(content: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    for _ in 0..rng.random_range(1..4) {
        if content.len() < 2 {
            return;
        }
        // Half of the changes hit the beginning, where headers are.
        let end = if rng.random_bool(0.5) { content.len() } else { content.len().min(2048) };
        let at = rng.random_range(0..end);
        match rng.random_range(0..7) {
            0 => content[at] ^= 1 << rng.random_range(0..8),
            1 => content[at] = rng.random(),
            2 => content.truncate(at),
            3 => {
                let length = rng.random_range(1..4096).min(content.len() - at);
                drop(content.drain(at..at + length));
            }
            4 => {
                let length = rng.random_range(1..4096).min(content.len() - at);
                let copy = content[at..at + length].to_vec();
                drop(content.splice(at..at, copy));
            }
            5 => {
                let special = [f32::NAN, f32::INFINITY, -0.0, 1e30, 1e-40, 49_000.0];
                let value = special[rng.random_range(0..special.len())].to_le_bytes();
                let at = at.min(content.len() - 4.min(content.len()));
                for (byte, new) in content[at..].iter_mut().zip(value) {
                    *byte = new;
                }
            }
            _ => {
                let length = rng.random_range(1..64).min(content.len() - at);
                let fill: u8 = if rng.random_bool(0.5) { 0 } else { 0xff };
                content[at..at + length].fill(fill);
            }
        }
    }
}

//! Scenario filters of nuPlan's devkit (`scenario_filter/*.yaml`), with its rules (version 1.2.2).

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parking_lot::Mutex;
use rayon::prelude::*;

use super::index::LogIndex;
use super::token::Token;
use super::window::fits;
use super::yaml::{Node, Scalar, entries};
use crate::error::{Cause, FormatError};
use crate::format::read_whole;
use crate::frames::{self, LengthChoice};

/// The class that a filter states.
const TARGET: &str = "nuplan.planning.scenario_builder.scenario_filter.ScenarioFilter";
/// Type of frames without a tag.
const UNTAGGED: &str = "unknown";
/// Start of a value that another file of the devkit contains, such as `${splitter.log_splits.val}`.
const INTERPOLATION: &str = "${";
/// Maximum size of a filter in bytes: a million tokens.
const MAX_SIZE: u64 = 32 << 20;
/// Number of filters whose choice is kept: a run opens its inputs several times, and all logs are read.
const CACHE_SIZE: usize = 4;

/// What a filter selects.
#[derive(Debug, Default)]
struct Filter {
    types: Option<BTreeSet<String>>,
    tokens: Option<BTreeSet<Token>>,
    log_names: Option<BTreeSet<String>>,
    map_names: Option<BTreeSet<String>>,
    per_type: Option<usize>,
    total: Option<Limit>,
    threshold_s: Option<f64>,
    needs_goal: bool,
    shuffle: bool,
}

#[derive(Clone, Copy, Debug)]
enum Limit {
    Number(usize),
    Share(f64),
}

/// Frames chosen by a filter.
#[derive(Debug)]
pub(super) struct Chosen {
    /// Logs with chosen frames, and logs that cannot be read, whose errors then appear.
    pub(super) logs: Vec<PathBuf>,
    /// Tokens of the frames, sorted.
    pub(super) tokens: Vec<Token>,
    /// Tokens or logs of the filter that are not among the logs.
    pub(super) absent: Vec<Absent>,
}

/// A key of a filter with what of it is not among the logs.
pub(super) type Absent = (String, String);

/// A frame that may be chosen.
#[derive(Clone, Copy)]
struct Candidate {
    timestamp: i64,
    token: Token,
    log: usize,
    /// Whether the log has the rows of its window, which may end after the devkit's scenes.
    fits: bool,
}

type ByType = BTreeMap<String, Vec<Candidate>>;
/// Candidates of a log with their types, and tokens of the filter that it has.
type Candidates = (Vec<(String, Candidate)>, Vec<Token>);

/// Content of a filter, logs and length of windows, with what was chosen.
type Known = (Vec<u8>, Vec<PathBuf>, LengthChoice, Arc<Chosen>);

static CACHE: Mutex<Vec<Known>> = Mutex::new(Vec::new());

/// Returns the frames of these logs that a filter chooses, as far as windows of this length fit.
///
/// # Errors
/// [`FormatError`] names the key that cannot be read, or that cannot be expressed here.
pub(super) fn choose(
    path: &Path,
    logs: &[PathBuf],
    length: LengthChoice,
) -> Result<Arc<Chosen>, FormatError> {
    let refuse = |cause| FormatError::file(path, cause);
    let content = read_whole(path, MAX_SIZE, "a scenario filter of at most 32 MiB")?;
    let is_known = |known: &&Known| known.0 == content && known.1 == logs && known.2 == length;
    if let Some((.., chosen)) = CACHE.lock().iter().find(is_known) {
        return Ok(Arc::clone(chosen));
    }
    let filter = Filter::parse(&content).map_err(refuse)?;
    let chosen = Arc::new(filter.choose(logs, length).map_err(refuse)?);
    let mut cache = CACHE.lock();
    if cache.len() >= CACHE_SIZE {
        cache.remove(0);
    }
    cache.push((content, logs.to_vec(), length, Arc::clone(&chosen)));
    Ok(chosen)
}

impl Filter {
    fn parse(content: &[u8]) -> Result<Self, Cause> {
        let text = std::str::from_utf8(content).map_err(|e| Cause::Undecodable(e.to_string()))?;
        let mut filter = Self::default();
        let mut other_logs = None;
        for (key, node) in entries(text).map_err(Cause::Undecodable)? {
            let key = key.as_str();
            if node.is_null() {
                continue;
            }
            match key {
                "_target_" if node.text() == Some(TARGET) => {}
                "_target_" => {
                    let expected = format!(
                        "`{TARGET}`; filters of other classes modify scenarios, or choose by other keys"
                    );
                    return Err(Cause::value(key, node, expected));
                }
                // The length of scenarios is an option here; the others apply only together with refused
                // keys.
                "_convert_"
                | "expand_scenarios"
                | "speed_noise_tolerance"
                | "fraction_in_token_set_threshold" => {}
                "scenario_types" => filter.types = Some(names(key, &node)?),
                "scenario_tokens" => filter.tokens = Some(tokens(key, &node)?),
                "log_names" if node.text().is_some_and(|text| text.starts_with(INTERPOLATION)) => {
                    other_logs = Some(node);
                }
                "log_names" => filter.log_names = Some(names(key, &node)?),
                "map_names" => filter.map_names = Some(names(key, &node)?),
                "num_scenarios_per_type" => filter.per_type = Some(number(key, &node)?),
                "limit_total_scenarios" => filter.total = Some(limit(key, &node)?),
                "timestamp_threshold_s" => filter.threshold_s = Some(seconds(key, &node)?),
                "remove_invalid_goals" => filter.needs_goal = flag(key, &node)?,
                "shuffle" => filter.shuffle = flag(key, &node)?,
                "ego_displacement_minimum_m"
                | "ego_start_speed_threshold"
                | "ego_stop_speed_threshold"
                | "token_set_path" => {
                    let expected = "null: the devkit judges its own window of 15 s or 20 s, not that of the \
                                    scenario";
                    return Err(Cause::value(key, node, expected));
                }
                "ego_route_radius" => {
                    let expected = "null: routes of scenarios are not compared with the map here";
                    return Err(Cause::value(key, node, expected));
                }
                _ => {
                    let expected = "a key of the devkit's ScenarioFilter; remove it if it does not select";
                    return Err(Cause::value(key, node, expected));
                }
            }
        }
        if let (Some(node), None) = (other_logs, &filter.tokens) {
            let expected = "a list of logs, or null and the logs of the split alone: the list is in another \
                            file of the devkit; only with `scenario_tokens` it is not needed";
            return Err(Cause::value("log_names", node, expected));
        }
        Ok(filter)
    }

    fn choose(&self, logs: &[PathBuf], length: LengthChoice) -> Result<Chosen, Cause> {
        let mut absent_tokens = self.tokens.clone().unwrap_or_default();
        let mut absent_logs = self.log_names.clone().unwrap_or_default();
        let (mut by_type, mut used) = (ByType::new(), BTreeSet::new());
        let name = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let is_wanted = |path: &PathBuf| self.log_names.as_ref().is_none_or(|n| n.contains(&name(path)));
        let read = |(log, path): (usize, &PathBuf)| {
            let index = is_wanted(path).then(|| LogIndex::read(path, self.needs_goal));
            index.map(|index| index.map(|index| self.candidates(&index, log, length)).map_err(|_| log))
        };
        // Of each log only what may be chosen is kept.
        let read: Vec<Option<Result<Candidates, usize>>> = logs.par_iter().enumerate().map(read).collect();
        for found in read.into_iter().flatten() {
            match found {
                Ok((named, tokens)) => {
                    for token in tokens {
                        absent_tokens.remove(&token);
                    }
                    named.into_iter().for_each(|(name, one)| by_type.entry(name).or_default().push(one));
                }
                Err(log) => {
                    used.insert(log);
                }
            }
        }
        for path in logs {
            absent_logs.remove(&name(path));
        }
        if let Some(number) = self.per_type {
            for (name, list) in &mut by_type {
                *list = self.sample("num_scenarios_per_type", name, list, number)?;
            }
        }
        if let Some(limit) = self.total {
            by_type = self.limited(limit, by_type)?;
        }
        if let Some(threshold) = self.threshold_s {
            by_type.values_mut().for_each(|list| thin_out(list, threshold));
        }
        let chosen = by_type.into_values().flatten();
        let (chosen, short): (Vec<Candidate>, Vec<Candidate>) = chosen.partition(|candidate| candidate.fits);
        used.extend(chosen.iter().map(|candidate| candidate.log));
        let mut tokens: Vec<Token> = chosen.iter().map(|candidate| candidate.token).collect();
        tokens.sort();
        let lacks = |key: &str, all: usize, absent: Vec<String>| {
            let first = absent.first()?;
            Some((key.to_owned(), format!("{} of {all}, the first `{first}`", absent.len())))
        };
        let [before, after] = [length.history() - 1, length.least_future()].map(frames::seconds);
        let all_chosen = chosen.len() + short.len();
        let count = |all: Option<usize>| all.unwrap_or_default();
        let absent = [
            lacks(
                "scenario_tokens",
                count(self.tokens.as_ref().map(BTreeSet::len)),
                absent_tokens.iter().map(Token::to_string).collect(),
            ),
            lacks(
                "log_names",
                count(self.log_names.as_ref().map(BTreeSet::len)),
                absent_logs.into_iter().collect(),
            ),
            lacks(
                &format!("the window of chosen frames, from {before} s before to {after} s after them,"),
                all_chosen,
                short.iter().map(|candidate| candidate.token.to_string()).collect(),
            ),
        ];
        Ok(Chosen {
            logs: used.into_iter().map(|log| logs[log].clone()).collect(),
            tokens,
            absent: absent.into_iter().flatten().collect(),
        })
    }

    /// Returns the frames of a log that the filter allows, each with the last of its allowed types, and those
    /// of its tokens that the log has.
    fn candidates(&self, index: &LogIndex, log: usize, length: LengthChoice) -> Candidates {
        let is_other_map = self.map_names.as_ref().is_some_and(|names| !names.contains(&index.map_name));
        let (mut candidates, mut found) = (Vec::new(), Vec::new());
        for (row, &(timestamp, token, scene)) in index.sweeps.iter().enumerate() {
            match &self.tokens {
                Some(tokens) if tokens.contains(&token) => found.push(token),
                Some(_) => continue,
                None => {}
            }
            let is_start = index.inner.contains(&scene) && (!self.needs_goal || index.has_goal(scene));
            if is_other_map || !is_start {
                continue;
            }
            let tags = index.tags.get(&token).map(Vec::as_slice).unwrap_or_default();
            let allowed = tags.iter().filter(|tag| self.types.as_ref().is_none_or(|t| t.contains(*tag)));
            let name = match allowed.max() {
                Some(name) => name.clone(),
                None if self.types.is_none() => UNTAGGED.to_owned(),
                None => continue,
            };
            let fits = fits(index.sweeps.len(), row, length);
            candidates.push((name, Candidate { timestamp, token, log, fits }));
        }
        (candidates, found)
    }

    /// Takes a number of frames at equal intervals. A random choice is refused, unless all are taken.
    fn sample(
        &self,
        key: &str,
        what: &str,
        list: &[Candidate],
        number: usize,
    ) -> Result<Vec<Candidate>, Cause> {
        if self.shuffle && number < list.len() {
            let found = format!("true, so that `{key}` draws {number} of {} of `{what}`", list.len());
            let expected = "false, or the drawn `scenario_tokens`: the draw depends on the state of the \
                            devkit's random generator";
            return Err(Cause::value("shuffle", found, expected));
        }
        let step = (list.len() / number.max(1)).max(1);
        Ok(list.iter().copied().step_by(step).take(number).collect())
    }

    /// Removes frames beyond the limit: those without a tag first.
    fn limited(&self, limit: Limit, mut by_type: ByType) -> Result<ByType, Cause> {
        let total: usize = by_type.values().map(Vec::len).sum();
        let number = match limit {
            Limit::Number(number) if number >= total => return Ok(by_type),
            Limit::Number(number) => number,
            Limit::Share(share) => (share * total as f64).ceil() as usize,
        };
        const KEY: &str = "limit_total_scenarios";
        if let Some(untagged) = by_type.get_mut(UNTAGGED) {
            let excess = total - number;
            if excess < untagged.len() {
                *untagged = self.sample(KEY, UNTAGGED, untagged, untagged.len() - excess)?;
                return Ok(by_type);
            }
            by_type.remove(UNTAGGED);
        }
        let named = |(name, list): (String, Vec<Candidate>)| list.into_iter().map(move |c| (c, name.clone()));
        let mut types: BTreeMap<Token, String> = BTreeMap::new();
        let mut all = Vec::new();
        for (candidate, name) in by_type.into_iter().flat_map(named) {
            types.insert(candidate.token, name);
            all.push(candidate);
        }
        all.sort_by_key(|candidate| candidate.token);
        let mut kept = ByType::new();
        for candidate in self.sample(KEY, "all types", &all, number)? {
            if let Some(name) = types.get(&candidate.token) {
                kept.entry(name.clone()).or_default().push(candidate);
            }
        }
        Ok(kept)
    }
}

/// Removes frames that follow the last one that is kept within the threshold in seconds.
fn thin_out(list: &mut Vec<Candidate>, threshold: f64) {
    list.sort_by_key(|candidate| candidate.timestamp);
    let mut next = f64::NEG_INFINITY;
    list.retain(|candidate| {
        let now = candidate.timestamp as f64 * 1e-6;
        let is_kept = now >= next;
        if is_kept {
            next = now + threshold;
        }
        is_kept
    });
}

fn items<'a>(key: &str, node: &'a Node) -> Result<&'a [Scalar], Cause> {
    match node {
        Node::List(items) if !items.is_empty() => Ok(items),
        _ => Err(Cause::value(key, node, "a list of at least one text, or null")),
    }
}

fn names(key: &str, node: &Node) -> Result<BTreeSet<String>, Cause> {
    Ok(items(key, node)?.iter().map(|item| item.text.clone()).collect())
}

fn tokens(key: &str, node: &Node) -> Result<BTreeSet<Token>, Cause> {
    let token = |item: &Scalar| {
        let expected = "16 hexadecimal digits, the token of a row of `lidar_pc`; more digits mean a scenario \
                        that another program modifies, such as those of interPlan";
        Token::parse(&item.text).ok_or_else(|| Cause::value(key, format!("`{}`", item.text), expected))
    };
    items(key, node)?.iter().map(token).collect()
}

fn number(key: &str, node: &Node) -> Result<usize, Cause> {
    let number = node.plain().and_then(|text| text.replace('_', "").parse().ok());
    number.filter(|n| *n > 0).ok_or_else(|| Cause::value(key, node, "a whole number above 0, or null"))
}

fn real(node: &Node) -> Option<f64> {
    node.plain()?.parse::<f64>().ok().filter(|value| value.is_finite())
}

fn seconds(key: &str, node: &Node) -> Result<f64, Cause> {
    let value = real(node).filter(|value| *value >= 0.0);
    value.ok_or_else(|| Cause::value(key, node, "seconds, 0 or more, or null"))
}

fn limit(key: &str, node: &Node) -> Result<Limit, Cause> {
    if let Ok(number) = number(key, node) {
        return Ok(Limit::Number(number));
    }
    let share = real(node).filter(|share| *share > 0.0 && *share < 1.0);
    let expected = "a whole number above 0, a share between 0.0 and 1.0, or null";
    share.map(Limit::Share).ok_or_else(|| Cause::value(key, node, expected))
}

fn flag(key: &str, node: &Node) -> Result<bool, Cause> {
    match node.plain() {
        Some("true" | "True" | "TRUE") => Ok(true),
        Some("false" | "False" | "FALSE") => Ok(false),
        _ => Err(Cause::value(key, node, "true or false")),
    }
}

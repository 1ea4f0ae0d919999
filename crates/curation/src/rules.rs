//! Rule-based candidates: the logged path at another speed, a lateral shift from the logged path, or
//! another route over the lane graph.
//!
//! Every stream belongs to one of these three families. Candidates are drawn from it until one disturbs
//! a vehicle under log replay and breaks no rule that is cheap to check, or until a number of draws is
//! exhausted: then the first draw that breaks no rule is proposed, or the first of all. So the proposals
//! are those of a driver who gets in the way, not of one who drives alone, and the filters still judge
//! them.

mod along_lanes;
mod directional;
mod gaps;
mod lateral;
mod limits;
mod longitudinal;
mod routes;
mod survey;

use rand::RngExt;

pub use self::along_lanes::LaneRoutes;
use self::survey::Survey;
use super::replay::Touch;
use super::{CandidateSource, NoProposal, Proposal};
use reactsim_rollout::Stream;
use reactsim_scene::{AgentKind, AgentState, Deviation, Scenario};

/// The rule-based source.
#[derive(Debug)]
pub struct Rules;

/// Largest number of draws from one stream; another route gets twice as many.
const MAX_DRAWS: usize = 20;
/// Number of draws of one kind of speed profile before others are tried.
const SAME_KIND_DRAWS: usize = 12;
/// Last step at which a contact is too early for anybody to avoid.
const TOO_EARLY_STEP: usize = 8;
/// Steps after a contact that are enough to observe its outcome.
const OUTCOME_STEPS: usize = 15;
/// Smallest ADE to the log at which a draw is another trajectory, metres.
const MIN_ADE: f64 = 2.0;
/// Distance from the logged path beyond which the AV is off it, metres.
const OFF_PATH_DISTANCE: f64 = 1.0;
/// Speed threshold, m/s: an agent slower than this, and slower than the AV, does not count as pressured
/// when the AV hits it.
const SLOW_SPEED: f64 = 2.0;

/// Result of one draw.
struct Draft {
    maneuver: String,
    future: Vec<AgentState>,
}

impl CandidateSource for Rules {
    fn id(&self) -> &'static str {
        "rules"
    }

    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>> {
        let survey = match Survey::new(scenario) {
            Ok(survey) => survey,
            Err(error) => return streams.iter().map(|_| Err(NoProposal(error.to_string()))).collect(),
        };
        let families = families(&survey);
        let each = streams.iter_mut().enumerate().map(|(i, stream)| {
            let family = families.get(i % families.len().max(1)).copied();
            propose(&survey, family.ok_or_else(|| NoProposal("the AV can go nowhere".into()))?, stream)
        });
        each.collect()
    }
}

/// Returns the families in turn; those that the scene does not permit give their turns to the others.
///
/// The logged path at another speed pressures somebody nearly everywhere, and so it has the fewest
/// turns.
fn families(survey: &Survey<'_>) -> Vec<Deviation> {
    use Deviation::{Directional, Lateral, Longitudinal};
    let is_possible = |family: &Deviation| match family {
        Longitudinal => true,
        Lateral => survey.is_moving() || survey.can_pull_out(),
        Directional => !survey.branches.is_empty(),
    };
    [Longitudinal, Lateral, Directional, Directional, Lateral].into_iter().filter(is_possible).collect()
}

fn propose(survey: &Survey<'_>, family: Deviation, stream: &mut Stream) -> Result<Proposal, NoProposal> {
    let mut best: Option<(u8, Draft)> = None;
    let mut reason = String::new();
    let kind = longitudinal::kind(stream);
    // Another route meets others at few places and times: a suitable draw takes longer to find.
    let draws = if family == Deviation::Directional { 2 * MAX_DRAWS } else { MAX_DRAWS };
    for attempt in 0..draws {
        let draft = match family {
            Deviation::Longitudinal => {
                longitudinal::draw(survey, (attempt < SAME_KIND_DRAWS).then_some(kind), stream)
            }
            Deviation::Lateral => lateral::draw(survey, stream),
            Deviation::Directional => directional::draw(survey, stream),
        };
        let draft = match draft {
            Ok(draft) => draft,
            Err(why) => {
                reason = why;
                continue;
            }
        };
        // A draw that could not improve on the best one needs no closer look.
        let rank = rank(survey, family, &draft);
        if best.as_ref().is_none_or(|b| b.0 < rank) {
            let rank = if breaks_rules(survey, &draft) { 0 } else { rank };
            if best.as_ref().is_none_or(|b| b.0 < rank) {
                best = Some((rank, draft));
            }
        }
        let rank = best.as_ref().map_or(0, |b| b.0);
        if rank == BEST_RANK {
            break;
        }
    }
    match best {
        Some((_, Draft { maneuver, future })) => Ok(Proposal { intent: Some(family), maneuver, future }),
        None => Err(NoProposal(reason)),
    }
}

/// Rank of a draw that is proposed at once.
const BEST_RANK: u8 = 4;

/// Returns the usefulness of a draw, 0 to 4:
///
/// - 4: a vehicle collides by its own fault, in time and well away from the log;
/// - 3: a vehicle collides by its own fault;
/// - 2: the AV touches somebody;
/// - 1: no contact;
/// - 0: a contact that no driver would cause.
fn rank(survey: &Survey<'_>, family: Deviation, draft: &Draft) -> u8 {
    let touches = survey.replay.touches(&draft.future);
    if touches.iter().any(is_implausible) {
        return 0;
    }
    // A draw of another family must be off the logged path at the contact, not before.
    let in_family = |step: usize| {
        family == Deviation::Longitudinal
            || survey.distance_to_logged(&draft.future[step - 1]) > OFF_PATH_DISTANCE
    };
    let is_in_time = |step: usize| step + OUTCOME_STEPS <= survey.steps();
    match touches.iter().filter(|t| t.at_fault).map(|t| t.step).min() {
        Some(step) if is_in_time(step) && in_family(step) && survey.ade(&draft.future) >= MIN_ADE => {
            BEST_RANK
        }
        Some(_) => 3,
        None if !touches.is_empty() => 2,
        None => 1,
    }
}

/// Returns whether a draw exceeds the grip, leaves the road or runs a red light.
fn breaks_rules(survey: &Survey<'_>, draft: &Draft) -> bool {
    !survey.has_grip(&draft.future)
        || !survey.is_on_road(&draft.future)
        || survey.runs_red_light(&draft.future)
}

/// Returns whether no driver would cause a contact: it is early, with a pedestrian or cyclist, or by
/// hitting a vehicle that is slow or ahead.
fn is_implausible(touch: &Touch) -> bool {
    touch.step <= TOO_EARLY_STEP
        || touch.kind != Some(AgentKind::Vehicle)
        || touch.is_standing()
        || touch.is_crawling()
        || touch.is_rear_end()
        || touch.is_head_on()
        || touch.is_driven_into(SLOW_SPEED)
}

/// Draws one of several choices, with weights.
fn pick<'t, T>(stream: &mut Stream, choices: &'t [(f64, T)]) -> Option<&'t T> {
    let total: f64 = choices.iter().map(|c| c.0).sum();
    let mut left = stream.random_range(0.0..1.0) * total;
    for (weight, choice) in choices {
        left -= weight;
        if left < 0.0 {
            return Some(choice);
        }
    }
    choices.last().map(|c| &c.1)
}

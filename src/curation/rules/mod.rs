//! Candidates by rules: the logged way at another speed, beside the logged way, or another way over the lane graph.
//!
//! Every stream belongs to one of the three families. It is drawn from until a draw disturbs a vehicle that replays its log and breaks
//! no rule that is quick to check, or until a number of draws is used up: then the first draw that breaks no rule is proposed, or the
//! first of all. So the proposals are those of a driver who gets in the way, not of one who drives alone, and the filters still judge.

mod directional;
mod gaps;
mod lateral;
mod longitudinal;
mod routes;
mod survey;

use rand::RngExt;

use self::survey::Survey;
use super::replay::Touch;
use super::{CandidateSource, NoProposal, Proposal};
use crate::rollout::Stream;
use crate::scene::{AgentKind, AgentState, Deviation, Scenario};

/// The source by rules.
#[derive(Debug)]
pub struct Rules;

/// Draws from one stream at most; twice as many for another way.
const DRAWS: usize = 20;
/// Draws of one speed profile before any other is tried.
const OF_ITS_KIND: usize = 12;
/// A contact up to this step is none that anybody could avoid.
const TOO_EARLY: usize = 8;
/// A contact up to this step leaves time to see how it goes on.
const IN_TIME: usize = 65;
/// ADE to the log from which on a draw is another trajectory, metres.
const AWAY: f64 = 2.0;
/// Beside the logged way from this distance on, metres.
const OFF_WAY: f64 = 1.0;
/// Who moves slower than this, and than the AV, is not pressed by being driven into, m/s.
const SLOW: f64 = 2.0;

/// What one draw gives.
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

/// The families in turn; those for which the scene has no room give their turns to the others. The logged way at another speed presses
/// somebody nearly everywhere, and so has the fewest turns.
fn families(survey: &Survey<'_>) -> Vec<Deviation> {
    use Deviation::{Directional, Lateral, Longitudinal};
    let room = |family: &Deviation| match family {
        Longitudinal => true,
        Lateral => survey.moves() || survey.stands_aside(),
        Directional => !survey.branches.is_empty(),
    };
    [Longitudinal, Lateral, Directional, Directional, Lateral].into_iter().filter(room).collect()
}

fn propose(survey: &Survey<'_>, family: Deviation, stream: &mut Stream) -> Result<Proposal, NoProposal> {
    let mut best: Option<(u8, Draft)> = None;
    let mut reason = String::new();
    let kind = longitudinal::kind(stream);
    // Another way meets others at few places and times: it takes longer to find one.
    let draws = if family == Deviation::Directional { 2 * DRAWS } else { DRAWS };
    for attempt in 0..draws {
        let draft = match family {
            Deviation::Longitudinal => {
                longitudinal::draw(survey, (attempt < OF_ITS_KIND).then_some(kind), stream)
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
        // What could not be better than what there is need not be looked at more closely.
        let rank = rank(survey, family, &draft);
        if best.as_ref().is_none_or(|b| b.0 < rank) {
            let rank = if breaks_rules(survey, &draft) { 0 } else { rank };
            if best.as_ref().is_none_or(|b| b.0 < rank) {
                best = Some((rank, draft));
            }
        }
        let rank = best.as_ref().map_or(0, |b| b.0);
        if rank == PRESSES {
            break;
        }
    }
    match best {
        Some((_, Draft { maneuver, future })) => Ok(Proposal { intent: Some(family), maneuver, future }),
        None => Err(NoProposal(reason)),
    }
}

/// Rank of a draw that is proposed at once.
const PRESSES: u8 = 4;

/// How useful a draw is that breaks no rule: 4 makes somebody collide by its own fault, in time and well away from the log; 3 makes
/// somebody collide so; 2 touches somebody; 1 does not; 0 makes a contact that no driver would make.
fn rank(survey: &Survey<'_>, family: Deviation, draft: &Draft) -> u8 {
    let touches = survey.replay.touches(&draft.future);
    if touches.iter().any(breaks) {
        return 0;
    }
    // Who is off the logged way for its own sake meets others there, not before.
    let in_family = |step: usize| {
        family == Deviation::Longitudinal || survey.beside_way(&draft.future[step - 1]) > OFF_WAY
    };
    match touches.iter().filter(|t| t.at_fault).map(|t| t.step).min() {
        Some(step) if step <= IN_TIME && in_family(step) && survey.ade(&draft.future) >= AWAY => PRESSES,
        Some(_) => 3,
        None if !touches.is_empty() => 2,
        None => 1,
    }
}

/// Whether a draw swerves, leaves the road or runs a red light.
fn breaks_rules(survey: &Survey<'_>, draft: &Draft) -> bool {
    !survey.grips(&draft.future) || !survey.on_road(&draft.future) || survey.runs_red(&draft.future)
}

/// Whether a contact is one that no driver would make: early, with somebody on foot or on a bicycle, or by driving into what is slow
/// or goes ahead.
fn breaks(touch: &Touch) -> bool {
    touch.step <= TOO_EARLY
        || touch.kind != Some(AgentKind::Vehicle)
        || touch.is_standing()
        || touch.is_crawling()
        || touch.is_rear_end()
        || touch.is_head_on()
        || touch.is_driven_into(SLOW)
}

/// Uniform in a range.
fn between(stream: &mut Stream, low: f64, high: f64) -> f64 {
    stream.random_range(low..high)
}

/// One of several, with weights.
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

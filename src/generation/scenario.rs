//! From settings and a number to a scenario: a map, traffic on it, one of its drivers as the AV.

use super::maps::MapType;
use super::traffic::Recording;
use super::{Draw, GenerationError, GenerationSettings, Layout, Preset, traffic};
use crate::geometry::{rounded_distance, wrap};
use crate::rollout::{Purpose, Stream, stream};
use crate::scene::{
    CURRENT, DT, FRAMES, Frame, HISTORY, LightParts, LoggedAgent, MAX_AGENTS, Scenario, ScenarioParts,
};

/// How often maps and traffic are drawn until a driver can be the AV, and nobody has an accident or passes a red light.
const ATTEMPTS: u32 = 40;
/// Agents who stay farther than this from the AV are not recorded, as a sensor would not see them, metres.
const RANGE: f64 = 75.0;
/// Boxes nearer than this are in contact, metres: what rounding may add to.
const CONTACT: f64 = 0.01;
/// Corners are rounded as in the metrics.
const ROUNDING: f64 = 0.7;
/// Others nearer than this make a driver likely to be the AV, metres.
const NEAR: f64 = 40.0;
/// Beyond this distance from the middle of the map drivers are seldom the AV, metres.
const MIDDLE: f64 = 60.0;
/// Who turns by more than this is more often the AV, radians: recordings are made on purpose where something happens.
const TURN: f64 = 0.5;
/// The AV of a benchmark gets at least so far, metres.
const MOVES: f64 = 10.0;
/// Positions, headings and velocities are rounded to multiples of these (powers of two): finer than any sensor, and files stay small.
const POSITION_STEP: f64 = 1.0 / 8192.0;
const HEADING_STEP: f64 = 1.0 / 16384.0;
const VELOCITY_STEP: f64 = 1.0 / 4096.0;

/// Makes the scenario of this number.
pub(super) fn generate(settings: &GenerationSettings, number: u64) -> Result<Scenario, GenerationError> {
    let id = settings.id(number);
    for attempt in 0..ATTEMPTS {
        let mut rng = stream(settings.seed, &id, attempt, Purpose::Map);
        let (kind, layout) = draw_layout(settings, number, &mut rng);
        let density = settings.density.unwrap_or_else(|| draw_density(settings.preset, &mut rng));
        let mut rng = stream(settings.seed, &id, attempt, Purpose::Traffic);
        let recording = traffic::record(&layout, density, &mut rng);
        if let Some(av) = choose_av(settings.preset, &recording, &mut rng) {
            let kept = kept(&recording, av);
            let lawful = !kept.iter().any(|i| recording.offenders.contains(i));
            if lawful && is_free_of_contacts(&recording, &kept) {
                return Ok(Scenario::assemble(parts(id, kind, layout, &recording, &kept))?);
            }
        }
    }
    Err(GenerationError::Fruitless { id, attempts: ATTEMPTS })
}

/// Benchmarks take the map types in turn, so that all are there; training sets by weight.
fn draw_layout(settings: &GenerationSettings, number: u64, rng: &mut Stream) -> (&'static MapType, Layout) {
    let allowed = settings.map_types();
    let which = match settings.preset {
        Preset::Bench => (number % allowed.len() as u64) as usize,
        Preset::Train => rng.weighted(&allowed.iter().map(|m| m.weight).collect::<Vec<_>>()),
    };
    (allowed[which], allowed[which].layout(rng))
}

/// From next to nobody to a queue that grows; benchmarks are never empty.
fn draw_density(preset: Preset, rng: &mut Stream) -> f64 {
    match preset {
        Preset::Bench => rng.uniform(0.5, 1.5),
        Preset::Train => rng.uniform(0.1, 1.6),
    }
}

/// The driver who is the AV, of those who may be. It is more likely somebody in the middle of the map, where junctions are, and somebody
/// with others around, as recordings are made where there is traffic; in benchmarks always somebody who moves.
fn choose_av(preset: Preset, recording: &Recording, rng: &mut Stream) -> Option<usize> {
    let weight = |&i: &usize| {
        let track = &recording.agents[i].1;
        let (Some(now), Some(last)) = (track[CURRENT], track[FRAMES - 1]) else { return 0.0 };
        let way = (last.position() - now.position()).norm();
        let near = |t: &[Frame]| t[CURRENT].is_some_and(|s| (s.position() - now.position()).norm() < NEAR);
        let others = recording.agents.iter().filter(|(_, t)| near(t)).count().saturating_sub(1) as f64;
        let middle = 1.0
            / (1.0 + {
                let d = now.position().norm_squared() / (MIDDLE * MIDDLE);
                d * d
            });
        let turned = wrap(last.heading - track[0].map_or(last.heading, |s| s.heading)).abs() > TURN;
        let sets_off = last.speed() > now.speed() + 3.0;
        let lively = if turned { 4.0 } else { 1.0 } * if sets_off { 1.5 } else { 1.0 };
        match preset {
            Preset::Bench if way < MOVES => 0.0,
            Preset::Bench => others * middle * lively,
            Preset::Train => (1.0 + others) * middle * lively,
        }
    };
    let weights: Vec<f64> = recording.drivers.iter().map(weight).collect();
    if weights.iter().sum::<f64>() > 0.0 { Some(recording.drivers[rng.weighted(&weights)]) } else { None }
}

fn parts(id: String, kind: &MapType, layout: Layout, recording: &Recording, kept: &[usize]) -> ScenarioParts {
    let lights = layout.signals.iter().zip(&recording.lights);
    ScenarioParts {
        id,
        source: kind.source(),
        origin: None,
        timestamps: (0..FRAMES).map(|f| f as f64 * DT).collect(),
        av: 0,
        agents: kept.iter().map(|&i| rounded(&recording.agents[i])).collect(),
        lights: lights
            .map(|(plan, states)| LightParts {
                lane: plan.lane.clone(),
                stop_point: plan.stop_point,
                states: states.iter().copied().map(Some).collect(),
            })
            .collect(),
        map: layout.map,
        ..ScenarioParts::default()
    }
}

/// The AV, then who comes near it: of those present now the nearest who can take part, and those who come later.
fn kept(recording: &Recording, av: usize) -> Vec<usize> {
    let position = |i: usize, f: usize| recording.agents[i].1[f].map(|s| s.position());
    let distance = |i: usize, f: usize| Some((position(i, f)? - position(av, f)?).norm());
    let nearest = |i: usize| (0..FRAMES).filter_map(|f| distance(i, f)).fold(f64::INFINITY, f64::min);
    let others = (0..recording.agents.len()).filter(|&i| i != av && nearest(i) <= RANGE);
    let (mut now, mut later): (Vec<usize>, Vec<usize>) =
        others.partition(|&i| recording.agents[i].1[CURRENT].is_some());
    now.sort_by(|&a, &b| {
        let key = |i| distance(i, CURRENT).unwrap_or(f64::INFINITY);
        key(a).total_cmp(&key(b)).then(a.cmp(&b))
    });
    now.truncate(MAX_AGENTS - 1);
    later.retain(|&i| recording.agents[i].1[HISTORY..].iter().any(Option::is_some));
    [vec![av], now, later].concat()
}

/// Whether nobody touches anybody. Accidents happen in this traffic as in the real one, but logs with them are of no use as a reference.
fn is_free_of_contacts(recording: &Recording, kept: &[usize]) -> bool {
    let agents: Vec<_> = kept.iter().map(|&i| &recording.agents[i]).collect();
    let stands = |track: &[Frame]| track[0].is_some() && track[0] == track[FRAMES - 1];
    let still: Vec<bool> = agents.iter().map(|a| stands(&a.1)).collect();
    for i in 0..agents.len() {
        for j in 0..i {
            let reach =
                0.5 * (agents[i].0.length + agents[i].0.width + agents[j].0.length + agents[j].0.width);
            let touch = |f: usize| {
                let (Some(a), Some(b)) = (agents[i].1[f], agents[j].1[f]) else { return false };
                (a.position() - b.position()).norm_squared() < reach * reach
                    && rounded_distance(&a.footprint(&agents[i].0), &b.footprint(&agents[j].0), ROUNDING)
                        <= CONTACT
            };
            let frames = if still[i] && still[j] { 1 } else { FRAMES };
            if (0..frames).any(touch) {
                return false;
            }
        }
    }
    true
}

fn rounded((agent, track): &(crate::scene::Agent, Vec<Frame>)) -> LoggedAgent {
    let to = |value: f64, step: f64| (value / step).round() * step;
    let round = |state: &Frame| {
        state.map(|mut s| {
            (s.x, s.y) = (to(s.x, POSITION_STEP), to(s.y, POSITION_STEP));
            s.heading = to(s.heading, HEADING_STEP);
            (s.vx, s.vy) = (to(s.vx, VELOCITY_STEP), to(s.vy, VELOCITY_STEP));
            s
        })
    };
    LoggedAgent { agent: agent.clone(), track: track.iter().map(round).collect() }
}

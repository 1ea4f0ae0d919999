//! Generation of a scenario from settings and a number: a map, traffic on it, and one of its drivers as the
//! AV.

use reactsim_geometry::{rounded_distance, wrap};
use reactsim_rollout::{Purpose, Stream, stream};
use reactsim_scene::{Agent, DT, Frame, LightParts, LoggedAgent, MAX_AGENTS, Scenario, ScenarioParts};

use super::heights::on_different_levels;
use super::maps::MapType;
use super::maps::build::mph;
use super::traffic::Recording;
use super::{Draw, GenerationError, GenerationSettings, Layout, Preset, sensor, traffic};

/// Maximum number of draws of map and traffic until a driver can be the AV and nobody has an accident or
/// runs a red light.
const MAX_ATTEMPTS: u32 = 40;
/// Sensor range, metres: agents that stay farther than this from the AV are not recorded.
const SENSOR_RANGE: f64 = 75.0;
/// Distance between boxes, metres, up to which they count as touching, to allow for rounding.
const CONTACT_DISTANCE: f64 = 0.01;
/// Corner rounding of boxes, as in the collision metrics.
const CORNER_ROUNDING: f64 = 0.7;
/// Distance, metres, within which agents around a driver make the driver a likely AV.
const NEAR_DISTANCE: f64 = 40.0;
/// Distance from the middle of the map, metres, beyond which drivers are seldom chosen as the AV.
const CENTRAL_DISTANCE: f64 = 60.0;
/// Heading change, radians, above which a driver is chosen as the AV more often: recordings are made on
/// purpose where something happens.
const TURN_ANGLE: f64 = 0.5;
/// Minimum displacement of the AV of a benchmark, metres.
const MIN_DISPLACEMENT: f64 = 10.0;
/// Weights of speed limits that are raised by 0, 5 and 10 mph.
const RAISE_WEIGHTS: [f64; 3] = [0.25, 0.35, 0.4];
/// Speed limits of streets, m/s: 25 to 45 mph. Aisles of car parks and motorways have others.
const STREET_LIMITS: std::ops::Range<f64> = mph(25.0)..mph(45.0);
/// Resolution of positions, metres: a power of two, finer than any sensor, which keeps files small.
const POSITION_STEP: f64 = 1.0 / 8192.0;
/// Resolution of heights, metres: like that of positions.
const HEIGHT_STEP: f64 = POSITION_STEP;
/// Resolution of headings, radians: a power of two, like that of positions.
const HEADING_STEP: f64 = 1.0 / 16384.0;
/// Resolution of velocities, m/s: a power of two, like that of positions.
const VELOCITY_STEP: f64 = 1.0 / 4096.0;

pub(super) fn generate(settings: &GenerationSettings, number: u64) -> Result<Scenario, GenerationError> {
    let id = settings.id(number);
    for attempt in 0..MAX_ATTEMPTS {
        let mut rng = stream(settings.seed, &id, attempt, Purpose::Map);
        let (kind, layout) = draw_layout(settings, number, &mut rng);
        let density = settings.density.unwrap_or_else(|| draw_density(settings.preset, &mut rng));
        let mut rng = stream(settings.seed, &id, attempt, Purpose::Traffic);
        let recording =
            traffic::record(&layout, density, settings.preset.manner(), settings.length, &mut rng);
        if let Some(av) = choose_av(settings.preset, &recording, &mut rng) {
            let selected = select_agents(&recording, av);
            let lawful = !selected.iter().any(|i| recording.offenders.contains(i));
            if lawful && is_free_of_contacts(&recording, &selected) {
                let mut parts = parts(id, kind, layout, &recording, &selected);
                if settings.preset == Preset::Sensed {
                    sensor::record(&mut parts, &mut rng);
                }
                parts.agents.iter_mut().for_each(round);
                return Ok(Scenario::assemble(parts)?);
            }
        }
    }
    Err(GenerationError(format!(
        "{id}: no accident-free traffic with a driver who can be the AV in {MAX_ATTEMPTS} attempts; allow more \
         map types, another density or fewer frames"
    )))
}

/// Draws the map: benchmarks take the map types in turn, so that all occur; training sets draw them by
/// weight.
fn draw_layout(settings: &GenerationSettings, number: u64, rng: &mut Stream) -> (&'static MapType, Layout) {
    let allowed = settings.map_types();
    let which = match settings.preset {
        Preset::Bench => (number % allowed.len() as u64) as usize,
        Preset::Train => rng.weighted(&allowed.iter().map(|m| m.weight).collect::<Vec<_>>()),
        Preset::Sensed => rng.weighted(&allowed.iter().map(|m| m.sensed_weight).collect::<Vec<_>>()),
    };
    let mut layout = allowed[which].layout(rng);
    if settings.preset == Preset::Sensed {
        raise_limits(&mut layout, rng);
    }
    (allowed[which], layout)
}

/// Raises the speed limits of streets by up to 10 mph, to at most 45 mph. Half of the vehicles of recordings
/// that are on lanes with a known limit are on roads of 45 mph.
fn raise_limits(layout: &mut Layout, rng: &mut Stream) {
    let raise = mph([0.0, 5.0, 10.0][rng.weighted(&RAISE_WEIGHTS)]);
    for lane in &mut layout.map.lanes {
        if let Some(limit) = lane.speed_limit.as_mut().filter(|limit| STREET_LIMITS.contains(limit)) {
            *limit = (*limit + raise).min(STREET_LIMITS.end);
        }
    }
}

/// Draws the traffic density, from almost nobody to a growing queue; benchmarks are never empty.
fn draw_density(preset: Preset, rng: &mut Stream) -> f64 {
    match preset {
        Preset::Bench => rng.uniform(0.5, 1.5),
        Preset::Train => rng.uniform(0.1, 1.6),
        Preset::Sensed => rng.uniform(0.2, 2.0),
    }
}

/// Chooses the AV among the eligible drivers. Drivers in the middle of the map, where junctions are, and
/// drivers with others around them are more likely, since recordings are made where there is traffic. In
/// benchmarks the AV always moves.
fn choose_av(preset: Preset, recording: &Recording, rng: &mut Stream) -> Option<usize> {
    let (current, end) = (recording.length.current(), recording.length.frames() - 1);
    let weight = |&i: &usize| {
        let track = &recording.agents[i].1;
        let (Some(now), Some(last)) = (track[current], track[end]) else { return 0.0 };
        let displacement = (last.position() - now.position()).norm();
        let near =
            |t: &[Frame]| t[current].is_some_and(|s| (s.position() - now.position()).norm() < NEAR_DISTANCE);
        let others = recording.agents.iter().filter(|(_, t)| near(t)).count().saturating_sub(1) as f64;
        let middle = 1.0
            / (1.0 + {
                let d = now.position().norm_squared() / (CENTRAL_DISTANCE * CENTRAL_DISTANCE);
                d * d
            });
        let turned = wrap(last.heading - track[0].map_or(last.heading, |s| s.heading)).abs() > TURN_ANGLE;
        let sets_off = last.speed() > now.speed() + 3.0;
        let lively = if turned { 4.0 } else { 1.0 } * if sets_off { 1.5 } else { 1.0 };
        match preset {
            Preset::Bench if displacement < MIN_DISPLACEMENT => 0.0,
            Preset::Bench => others * middle * lively,
            Preset::Train | Preset::Sensed => (1.0 + others) * middle * lively,
        }
    };
    let weights: Vec<f64> = recording.drivers.iter().map(weight).collect();
    if weights.iter().sum::<f64>() > 0.0 { Some(recording.drivers[rng.weighted(&weights)]) } else { None }
}

fn parts(
    id: String,
    kind: &MapType,
    layout: Layout,
    recording: &Recording,
    selected: &[usize],
) -> ScenarioParts {
    let lights = layout.signals.iter().zip(&recording.lights);
    ScenarioParts {
        id,
        source: kind.source(),
        origin: None,
        length: recording.length,
        timestamps: (0..recording.length.frames()).map(|f| f as f64 * DT).collect(),
        av: 0,
        agents: selected.iter().map(|&i| logged(&recording.agents[i], &recording.heights[i])).collect(),
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

/// Selects the agents of the scenario: the AV, the nearest agents that are present at the current frame and
/// can take part, and agents that appear later.
fn select_agents(recording: &Recording, av: usize) -> Vec<usize> {
    let (length, current) = (recording.length, recording.length.current());
    let position = |i: usize, f: usize| recording.agents[i].1[f].map(|s| s.position());
    let distance = |i: usize, f: usize| Some((position(i, f)? - position(av, f)?).norm());
    let nearest =
        |i: usize| (0..length.frames()).filter_map(|f| distance(i, f)).fold(f64::INFINITY, f64::min);
    let others = (0..recording.agents.len()).filter(|&i| i != av && nearest(i) <= SENSOR_RANGE);
    let (mut now, mut later): (Vec<usize>, Vec<usize>) =
        others.partition(|&i| recording.agents[i].1[current].is_some());
    now.sort_by(|&a, &b| {
        let key = |i| distance(i, current).unwrap_or(f64::INFINITY);
        key(a).total_cmp(&key(b)).then(a.cmp(&b))
    });
    now.truncate(MAX_AGENTS - 1);
    later.retain(|&i| recording.agents[i].1[length.history..].iter().any(Option::is_some));
    [vec![av], now, later].concat()
}

/// Whether no agents on one level touch each other. Accidents occur in this traffic as in real traffic, but
/// logs with accidents cannot serve as a reference.
fn is_free_of_contacts(recording: &Recording, selected: &[usize]) -> bool {
    let agents: Vec<_> = selected.iter().map(|&i| &recording.agents[i]).collect();
    let is_still = |track: &[Frame]| track[0].is_some() && track[0] == track[track.len() - 1];
    let still: Vec<bool> = agents.iter().map(|a| is_still(&a.1)).collect();
    let height = |agent: usize, f: usize| recording.heights[selected[agent]].get(f).copied().flatten();
    for i in 0..agents.len() {
        for j in 0..i {
            let reach =
                0.5 * (agents[i].0.length + agents[i].0.width + agents[j].0.length + agents[j].0.width);
            let touch = |f: usize| {
                let (Some(a), Some(b)) = (agents[i].1[f], agents[j].1[f]) else { return false };
                (a.position() - b.position()).norm_squared() < reach * reach
                    && rounded_distance(
                        &a.footprint(&agents[i].0),
                        &b.footprint(&agents[j].0),
                        CORNER_ROUNDING,
                    ) <= CONTACT_DISTANCE
                    && !on_different_levels(height(i, f), height(j, f), (a.position() - b.position()).norm())
            };
            let frames = if still[i] && still[j] { 1 } else { recording.length.frames() };
            if (0..frames).any(touch) {
                return false;
            }
        }
    }
    true
}

fn logged((agent, track): &(Agent, Vec<Frame>), heights: &[Option<f64>]) -> LoggedAgent {
    LoggedAgent { agent: agent.clone(), track: track.clone(), heights: heights.to_vec() }
}

/// Rounds states and heights to their resolutions.
fn round(agent: &mut LoggedAgent) {
    let to = |value: f64, step: f64| (value / step).round() * step;
    for s in agent.track.iter_mut().flatten() {
        (s.x, s.y) = (to(s.x, POSITION_STEP), to(s.y, POSITION_STEP));
        s.heading = to(s.heading, HEADING_STEP);
        (s.vx, s.vy) = (to(s.vx, VELOCITY_STEP), to(s.vy, VELOCITY_STEP));
    }
    for z in agent.heights.iter_mut().flatten() {
        *z = to(*z, HEIGHT_STEP);
    }
}

#[cfg(test)]
mod tests;

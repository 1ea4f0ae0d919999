//! Displacements from the log, by what agents do in it.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_geometry::{Vec2, direction, into_frame, wrap};
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{AgentKind, DT, Frame, Scenario};
use serde::{Deserialize, Serialize};

use super::read_study;
use crate::error::EvaluationError;
use crate::folder::finished_run::FinishedRun;
use crate::folder::{read_json, write_json};
use crate::source::Source;
use crate::statistics::{MIN_FOR_INTERVAL, RESAMPLES, below, interval};

/// Name of the file with the displacements of a study of errors.
pub const LOG_ERRORS: &str = "errors.json";

/// Speed below which an agent stands, m/s.
const STANDING_SPEED: f64 = 0.5;
/// Distance from its present position that a standing agent does not exceed, metres.
const STANDING_DISTANCE: f64 = 1.0;
/// Change of the heading from which an agent turns, radians: 30 degrees.
const TURN: f64 = std::f64::consts::FRAC_PI_6;
/// Largest distance of a leader, metres, and largest time to its position at the present speed, seconds.
const LEADER_DISTANCE: f64 = 40.0;
const LEADER_TIME: f64 = 4.0;
/// Largest distance of a leader from the course of its follower, metres.
const LEADER_OFFSET: f64 = 2.0;
/// Difference of headings up to which two agents move in the same direction, radians: 45 degrees.
const SAME_DIRECTION: f64 = std::f64::consts::FRAC_PI_4;
/// Largest distance of two agents whose ways cross, metres, and largest time between their passages, seconds.
const CROSSING_DISTANCE: f64 = 3.0;
const CROSSING_TIME: f64 = 3.0;
/// Times at which displacements are listed, seconds.
const TIMES: [usize; 4] = [1, 2, 4, 8];

/// Displacements of simulated agents from the log, with an AV that follows the log.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogErrors {
    /// The simulators, in the order of the run.
    pub simulators: Vec<SimulatorErrors>,
}

/// Displacements of the agents of one simulator.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SimulatorErrors {
    /// Id of the simulator.
    pub id: String,
    /// Groups of agents, by everything that agents are grouped by. Groups without agents are left out.
    pub groups: Vec<ErrorGroup>,
}

/// Displacements of a group of agents.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ErrorGroup {
    /// The property of agents that the groups differ in: `all`, `class`, `situation`, `speed`, `distance` or
    /// `time`.
    pub by: String,
    /// Name of the group, such as `turns`.
    pub group: String,
    /// Number of agents, over all scenarios and rollouts.
    pub agents: usize,
    /// Mean over agents of the mean distance from the log, metres; at that time in groups by time.
    pub displacement: f64,
    /// 2.5 % percentile of the displacement over resampled scenarios; `None` with fewer than 5 scenarios.
    pub low: Option<f64>,
    /// 97.5 % percentile.
    pub high: Option<f64>,
    /// Mean offset along the logged heading, metres: positive where agents are ahead of the log.
    pub ahead: f64,
    /// Mean distance across the logged heading, metres.
    pub aside: f64,
    /// Part of the displacements of all agents, from 0 to 1; `None` in groups by time.
    pub share: Option<f64>,
}

/// Motion of an agent in the log: the first of these that describes it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Situation {
    /// It stands until the end.
    Stands,
    /// It stands now and moves later.
    SetsOff,
    /// Its heading changes by more than 30 degrees.
    Turns,
    /// It moves now and stands at the end.
    Halts,
    /// Another agent is ahead of it, at most 4 s and 40 m away, and moves in its direction.
    Follows,
    /// Its way crosses that of another agent, and one passes within 3 s of the other.
    Crosses,
    /// None of these.
    DrivesFreely,
}

impl Situation {
    const fn name(self) -> &'static str {
        match self {
            Self::Stands => "stands",
            Self::SetsOff => "sets off",
            Self::Turns => "turns",
            Self::Halts => "halts",
            Self::Follows => "follows",
            Self::Crosses => "crosses",
            Self::DrivesFreely => "drives freely",
        }
    }

    /// Classifies an agent that is present now, at frame `current`. `tracks` are the logged frames of all
    /// agents.
    fn of(tracks: &[Vec<Frame>], slot: usize, current: usize) -> Option<Self> {
        let now = tracks[slot][current]?;
        let later = || tracks[slot][current + 1..].iter().flatten();
        let stays = later().all(|s| (s.position() - now.position()).norm() < STANDING_DISTANCE);
        let speed = speed(&tracks[slot], current);
        if speed < STANDING_SPEED {
            return Some(if stays { Self::Stands } else { Self::SetsOff });
        }
        // Headings of agents that hardly move are noise.
        let moved = later().filter(|s| (s.position() - now.position()).norm() >= STANDING_DISTANCE);
        let turns = moved.map(|s| wrap(s.heading - now.heading).abs()).fold(0.0, f64::max) > TURN;
        let last = (current..tracks[slot].len()).rev().find(|&f| tracks[slot][f].is_some())?;
        Some(if turns {
            Self::Turns
        } else if self::speed(&tracks[slot], last) < STANDING_SPEED {
            Self::Halts
        } else if has_leader(tracks, slot, current, speed) {
            Self::Follows
        } else if crosses(tracks, slot, current) {
            Self::Crosses
        } else {
            Self::DrivesFreely
        })
    }
}

/// Returns the speed of an agent at a frame at which it is present, m/s, from its position half a second before
/// or after: differences of neighbouring frames are noise in recordings.
fn speed(track: &[Frame], frame: usize) -> f64 {
    const SPAN: usize = 5;
    let at = |f: usize| track.get(f).copied().flatten();
    let Some(here) = at(frame) else { return 0.0 };
    match frame.checked_sub(SPAN).and_then(at).or(at(frame + SPAN)) {
        Some(other) => (here.position() - other.position()).norm() / (DT * SPAN as f64),
        None => here.velocity().map_or(0.0, |v| v.norm()),
    }
}

fn has_leader(tracks: &[Vec<Frame>], slot: usize, current: usize, speed: f64) -> bool {
    let Some(now) = tracks[slot][current] else { return false };
    let reach = LEADER_DISTANCE.min(LEADER_TIME * speed);
    tracks.iter().enumerate().filter(|(other, _)| *other != slot).any(|(_, track)| {
        track[current].is_some_and(|other| {
            let at = into_frame(direction(now.heading), other.position() - now.position());
            let is_ahead = at.x > 0.0 && at.x < reach && at.y.abs() < LEADER_OFFSET;
            is_ahead && wrap(other.heading - now.heading).abs() < SAME_DIRECTION
        })
    })
}

fn crosses(tracks: &[Vec<Frame>], slot: usize, current: usize) -> bool {
    let count = tracks[slot].len();
    let span = (CROSSING_TIME / DT) as usize;
    // Every half second: agents do not jump over each other's way in that time.
    let frames = |from: usize, to: usize| (from..to.min(count)).step_by(5);
    let state = |agent: usize, f: usize| tracks[agent][f];
    let meets = |other: usize, f: usize| {
        let Some(own) = state(slot, f) else { return false };
        frames(f.saturating_sub(span).max(current), f + span + 1).any(|g| {
            state(other, g).is_some_and(|their| {
                let is_near = (their.position() - own.position()).norm() < CROSSING_DISTANCE;
                let angle = wrap(their.heading - own.heading).abs();
                is_near && angle > SAME_DIRECTION && angle < std::f64::consts::PI - SAME_DIRECTION
            })
        })
    };
    let mut others = (0..tracks.len()).filter(|&other| other != slot);
    others.any(|other| frames(current, count).any(|f| meets(other, f)))
}

/// Property by which agents are grouped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Property {
    All,
    Class,
    Situation,
    Speed,
    Distance,
    Time,
}

impl Property {
    const fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Class => "class",
            Self::Situation => "situation",
            Self::Speed => "speed",
            Self::Distance => "distance",
            Self::Time => "time",
        }
    }
}

/// Key of a group: the property, the place of the group among all groups by this property, and its name.
type Key = (Property, usize, String);

/// Returns the groups of an agent, but for those by time.
fn groups(scenario: &Scenario, tracks: &[Vec<Frame>], slot: usize) -> Option<Vec<Key>> {
    let current = scenario.start.current();
    let now = tracks[slot][current]?;
    let situation = Situation::of(tracks, slot, current)?;
    let class = match scenario.start.agents[slot].kind {
        AgentKind::Vehicle => (0, "vehicle"),
        AgentKind::Pedestrian => (1, "pedestrian"),
        AgentKind::Cyclist => (2, "cyclist"),
        AgentKind::Other => (3, "other"),
    };
    let speed = match speed(&tracks[slot], current) {
        v if v < STANDING_SPEED => (0, "below 0.5 m/s"),
        v if v < 5.0 => (1, "0.5 to 5 m/s"),
        v if v < 10.0 => (2, "5 to 10 m/s"),
        _ => (3, "10 m/s and more"),
    };
    let av = tracks[0][current].map_or(f64::NAN, |av| (av.position() - now.position()).norm());
    let distance = match av {
        d if d < 20.0 => Some((0, "within 20 m")),
        d if d < 50.0 => Some((1, "20 to 50 m")),
        d if d >= 50.0 => Some((2, "50 m and more")),
        _ => None,
    };
    let mut keys = vec![(Property::All, 0, "all".to_owned())];
    keys.push((Property::Class, class.0, class.1.to_owned()));
    keys.push((Property::Situation, situation as usize, situation.name().to_owned()));
    keys.push((Property::Speed, speed.0, speed.1.to_owned()));
    keys.extend(distance.map(|(i, name)| (Property::Distance, i, name.to_owned())));
    Some(keys)
}

/// Sums over the agents of one scenario in one group.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    agents: usize,
    displacement: f64,
    ahead: f64,
    aside: f64,
}

impl Sums {
    /// Adds an agent with these mean errors.
    fn add(&mut self, [displacement, ahead, aside]: [f64; 3]) {
        self.agents += 1;
        self.displacement += displacement;
        self.ahead += ahead;
        self.aside += aside;
    }
}

/// Returns distance, offset along the heading and distance across it, metres, of a state from the logged one.
fn error(logged: Frame, rolled: Frame) -> Option<[f64; 3]> {
    let (logged, rolled) = logged.zip(rolled)?;
    let offset: Vec2 = rolled.position() - logged.position();
    let local = into_frame(direction(logged.heading), offset);
    Some([offset.norm(), local.x, local.y.abs()])
}

/// A logged scene: the frames of all agents, and the groups of those that are simulated, by slot.
struct LoggedGroups {
    /// The current frame.
    current: usize,
    tracks: Vec<Vec<Frame>>,
    keys: Vec<(usize, Vec<Key>)>,
}

impl LoggedGroups {
    fn of(scenario: &Scenario) -> Self {
        let agents = scenario.start.agents.len();
        let tracks: Vec<Vec<Frame>> = (0..agents).map(|slot| scenario.logged(slot)).collect();
        let of_slot = |slot: usize| Some((slot, groups(scenario, &tracks, slot)?));
        let keys = (1..agents).filter_map(of_slot).collect();
        Self { current: scenario.start.current(), tracks, keys }
    }
}

/// Sums of all groups of one simulator, by scenario.
#[derive(Debug, Default)]
struct Collected {
    groups: BTreeMap<Key, Vec<Sums>>,
}

impl Collected {
    /// Adds the rollouts of one scenario: `[rollouts][agents][frames]`.
    fn add(&mut self, logged: &LoggedGroups, rollouts: &[Vec<Vec<Frame>>]) {
        let mut here: BTreeMap<Key, Sums> = BTreeMap::new();
        for (slot, keys) in &logged.keys {
            for tracks in rollouts {
                let both = || logged.tracks[*slot].iter().zip(&tracks[*slot]).map(|(l, r)| error(*l, *r));
                let errors: Vec<[f64; 3]> = both().skip(logged.current + 1).flatten().collect();
                if errors.is_empty() {
                    continue;
                }
                let mean = |i: usize| errors.iter().map(|e| e[i]).sum::<f64>() / errors.len() as f64;
                let means = [mean(0), mean(1), mean(2)];
                keys.iter().for_each(|key| here.entry(key.clone()).or_default().add(means));
                for seconds in TIMES {
                    if let Some(error) = both().nth(logged.current + 10 * seconds).flatten() {
                        here.entry((Property::Time, seconds, format!("after {seconds} s")))
                            .or_default()
                            .add(error);
                    }
                }
            }
        }
        for (key, sums) in here {
            self.groups.entry(key).or_default().push(sums);
        }
    }

    fn finish(self, id: &str, seed: u64) -> SimulatorErrors {
        let total = |sums: &[Sums]| sums.iter().map(|s| s.displacement).sum::<f64>();
        let all = self.groups.iter().find(|((by, ..), _)| *by == Property::All);
        let all = all.map_or(0.0, |(_, sums)| total(sums));
        let group = |((by, _, group), sums): (Key, Vec<Sums>)| {
            let agents: usize = sums.iter().map(|s| s.agents).sum();
            let mean = |of: fn(&Sums) -> f64| sums.iter().map(of).sum::<f64>() / agents as f64;
            let (low, high) = displacement_interval(&sums, seed, &format!("{} {group}", by.name())).unzip();
            ErrorGroup {
                by: by.name().to_owned(),
                agents,
                displacement: mean(|s| s.displacement),
                low,
                high,
                ahead: mean(|s| s.ahead),
                aside: mean(|s| s.aside),
                share: (by != Property::Time && all > 0.0).then(|| total(&sums) / all),
                group,
            }
        };
        SimulatorErrors { id: id.to_owned(), groups: self.groups.into_iter().map(group).collect() }
    }
}

/// Returns the 95 % interval of the mean displacement over resampled scenarios; `None` with too few of them.
fn displacement_interval(sums: &[Sums], seed: u64, group: &str) -> Option<(f64, f64)> {
    if sums.len() < MIN_FOR_INTERVAL {
        return None;
    }
    let mut random = stream(seed, group, 0, Purpose::Bootstrap);
    let resampled = (0..RESAMPLES).map(|_| {
        let (mut displacement, mut agents) = (0.0, 0);
        for _ in sums {
            let drawn = &sums[below(&mut random, sums.len())];
            displacement += drawn.displacement;
            agents += drawn.agents;
        }
        displacement / agents as f64
    });
    interval(resampled.collect())
}

impl LogErrors {
    /// Computes the displacements of a finished study of kind `errors` from its rollouts. `sources` are its
    /// scenarios.
    ///
    /// # Errors
    /// [`EvaluationError`] if the run of the study or a scenario file cannot be read.
    pub fn of_study(folder: &Path, sources: &[Source]) -> Result<Self, EvaluationError> {
        let study = read_study(folder)?;
        let Some(member) = study.members.first() else { return Ok(Self { simulators: Vec::new() }) };
        let run = FinishedRun::open(&folder.join(&member.folder))?;
        let settings = &run.summary().provenance.run.settings;
        let ids = run.tally().simulators.clone();
        let mut collected: Vec<Collected> = ids.iter().map(|_| Collected::default()).collect();
        for source in sources {
            // Records that cannot be read are failures of the run.
            for scenario in source.scenarios()?.flatten() {
                let logged = LoggedGroups::of(&scenario);
                for (simulator, collected) in collected.iter_mut().enumerate() {
                    let mut rollouts = Vec::new();
                    for rollout in 0..settings.rollouts {
                        rollouts.extend(run.tracks(&scenario, simulator, rollout)?);
                    }
                    collected.add(&logged, &rollouts);
                }
            }
        }
        let finish = |(collected, id): (Collected, &String)| collected.finish(id, settings.seed);
        Ok(Self { simulators: collected.into_iter().zip(&ids).map(finish).collect() })
    }

    /// Writes the displacements into the folder of a study.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be written.
    pub fn write(&self, study: &Path) -> Result<(), EvaluationError> {
        write_json(&study.join(LOG_ERRORS), self)
    }

    /// Reads the displacements in the folder of a study; `None` if there are none.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read or is damaged.
    pub fn read(study: &Path) -> Result<Option<Self>, EvaluationError> {
        read_json(&study.join(LOG_ERRORS))
    }
}

#[cfg(test)]
mod tests {
    use reactsim_scene::AgentState;

    use super::*;

    /// A track with these positions and headings at frames.
    fn track(state: impl Fn(f64) -> (f64, f64, f64)) -> Vec<Frame> {
        let at = |f: usize| {
            let (x, y, heading) = state(DT * f as f64 - 1.0);
            Some(AgentState { x, y, heading, vx: 0.0, vy: 0.0 })
        };
        (0..91).map(at).collect()
    }

    #[test]
    fn situations_are_told_from_the_log() {
        let of = |tracks: &[Vec<Frame>]| Situation::of(tracks, 0, 10).unwrap();
        let straight = |speed: f64, x: f64, y: f64| track(move |t| (x + speed * t, y, 0.0));
        assert_eq!(of(&[straight(0.0, 0.0, 0.0)]), Situation::Stands);
        assert_eq!(of(&[track(|t| ((t - 2.0).max(0.0) * 3.0, 0.0, 0.0))]), Situation::SetsOff);
        assert_eq!(of(&[track(|t| (5.0 * t, 0.0, 0.2 * t))]), Situation::Turns);
        assert_eq!(of(&[track(|t| (5.0 * t.min(3.0), 0.0, 0.0))]), Situation::Halts);
        let free = straight(10.0, 0.0, 0.0);
        assert_eq!(of(std::slice::from_ref(&free)), Situation::DrivesFreely);
        assert_eq!(of(&[free.clone(), straight(10.0, 20.0, 0.5)]), Situation::Follows);
        assert_eq!(of(&[free.clone(), straight(10.0, 20.0, 3.5)]), Situation::DrivesFreely);
        let up = |late: f64| track(move |t| (40.0, 8.0 * (t - 4.0 - late), std::f64::consts::FRAC_PI_2));
        assert_eq!(of(&[free.clone(), up(1.0)]), Situation::Crosses);
        assert_eq!(of(&[free, up(-30.0)]), Situation::DrivesFreely);
    }

    #[test]
    fn offsets_are_along_and_across_the_logged_heading() {
        let up = AgentState { x: 1.0, y: 2.0, heading: std::f64::consts::FRAC_PI_2, vx: 0.0, vy: 0.0 };
        let [distance, ahead, aside] = error(Some(up), Some(AgentState { x: 5.0, y: -1.0, ..up })).unwrap();
        assert!((distance - 5.0).abs() < 1e-12 && (ahead + 3.0).abs() < 1e-12 && (aside - 4.0).abs() < 1e-12);
        assert_eq!(error(None, Some(up)), None);
    }

    #[test]
    fn shares_add_up_and_intervals_contain_the_mean() {
        let mut collected = Collected::default();
        for scenario in 0..6 {
            for (property, place, group, displacement) in [
                (Property::All, 0, "all", 2.0),
                (Property::Class, 0, "vehicle", 2.0 + f64::from(scenario)),
                (Property::Class, 1, "cyclist", 1.0),
            ] {
                let sums = Sums { agents: 2, displacement, ahead: -1.0, aside: 0.5 };
                collected.groups.entry((property, place, group.to_owned())).or_default().push(sums);
            }
        }
        let found = collected.finish("idm", 0);
        let group = |name: &str| found.groups.iter().find(|g| g.group == name).unwrap();
        let vehicle = group("vehicle");
        assert_eq!((vehicle.agents, vehicle.displacement, vehicle.ahead), (12, 2.25, -0.5));
        assert!(vehicle.low.unwrap() < 2.25 && vehicle.high.unwrap() > 2.25);
        assert_eq!(group("cyclist").share, Some(0.5));
        assert_eq!((group("all").low, group("all").high), (Some(1.0), Some(1.0)));
    }
}

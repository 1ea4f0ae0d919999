//! Properties of a scenario that affect how its results are read.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use reactsim_geometry::rounded_distance;

use super::velocities::{REPLACED, seconds_before};
use super::{AgentKind, Scenario, VelocityContradiction, levels};

/// A property of a scenario, with the number of its occurrences.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    /// Number of occurrences, at least 1.
    pub count: u32,
    /// The first occurrence, if it has a place, e.g. `0.30 s before frame 41`.
    pub detail: Option<String>,
}

/// Notes by id, e.g. `vehicles-off-road`.
pub type Notes = BTreeMap<&'static str, Note>;

/// A property that is noted if it occurs. `find` gets a scenario, and per agent whether it is off the road at
/// the current frame.
struct NoteKind {
    id: &'static str,
    /// Text for one occurrence.
    one: &'static str,
    /// Text for several occurrences, or for several scenarios; `{}` stands for the number.
    many: &'static str,
    find: fn(&Scenario, &[bool]) -> Option<Note>,
}

const KINDS: &[NoteKind] = &[
    NoteKind {
        id: "irregular-clock",
        one: "1 time step is not 0.1 s",
        many: "{} time steps are not 0.1 s",
        find: |scenario, _| irregular_steps(scenario),
    },
    NoteKind {
        id: "velocity-unknown",
        one: "1 agent has an unknown velocity at the current frame",
        many: "{} agents have an unknown velocity at the current frame",
        find: |scenario, _| {
            let agents = scenario.start.agents.iter().enumerate();
            // Objects that stay at one place need no velocity.
            let agents = agents.filter(|(_, agent)| agent.kind != AgentKind::Other);
            count(agents.filter(|(i, _)| scenario.start.now(*i).velocity().is_none()).count())
        },
    },
    NoteKind {
        id: "unknown-types",
        one: "1 agent is of a type that is not known, and is an object that nobody simulates",
        many: "{} agents are of types that are not known, and are objects that nobody simulates",
        find: |scenario, _| repaired(scenario, UNKNOWN_TYPE),
    },
    NoteKind {
        id: "earlier-frame",
        one: "the AV is not recorded for long enough after the default current frame; an earlier one is taken",
        many: "the AV is not recorded for long enough after the default current frame; an earlier one is taken",
        find: |scenario, _| moved(scenario, EARLIER_FRAME, "before"),
    },
    NoteKind {
        id: "later-frame",
        one: "fewer frames than requested come before the default current frame; a later one is taken",
        many: "fewer frames than requested come before the default current frame; a later one is taken",
        find: |scenario, _| moved(scenario, LATER_FRAME, "after"),
    },
    NoteKind {
        id: "velocity-contradicts",
        one: "1 agent has velocities that contradict its positions",
        many: "{} agents have velocities that contradict their positions",
        find: |scenario, _| contradicting_velocities(scenario),
    },
    NoteKind {
        id: "contradictory-heights",
        one: "1 height contradicts the ground around it and is not used",
        many: "{} heights contradict the ground around them and are not used",
        find: |scenario, _| repaired(scenario, levels::OUTLIERS),
    },
    NoteKind {
        id: "heights-not-used",
        one: "the height of 1 agent contradicts the map, so that no heights are used: roads above one another meet",
        many: "the heights of {} agents contradict the map, so that no heights are used: roads above one another \
               meet",
        find: |scenario, _| repaired(scenario, levels::NO_AGREEMENT),
    },
    NoteKind {
        id: "no-drivable-area",
        one: "the map has no drivable area, so nobody is judged off the road",
        many: "the map has no drivable area, so nobody is judged off the road",
        find: |scenario, _| count(usize::from(!scenario.start.road().has_drivable_area())),
    },
    NoteKind {
        id: "reversed-edges",
        one: "most vehicles on lanes start off the road: the drivable side of road edges must be the left one",
        many: "most vehicles on lanes start off the road: the drivable side of road edges must be the left one",
        find: reversed_edges,
    },
    NoteKind {
        id: "av-off-road",
        one: "the AV starts off the road",
        many: "the AV starts off the road",
        find: |_, off_road| count(usize::from(off_road[0])),
    },
    NoteKind {
        id: "vehicles-off-road",
        one: "1 moving vehicle starts off the road and is not judged there",
        many: "{} moving vehicles start off the road and are not judged there",
        find: |scenario, off_road| {
            let agents = 1..off_road.len();
            // Cars are parked next to the road everywhere.
            let moves = |i: usize| scenario.start.now(i).speed() > STANDSTILL_SPEED;
            count(agents.filter(|&i| is_vehicle(scenario, i) && moves(i) && off_road[i]).count())
        },
    },
    NoteKind {
        id: "nobody-on-road",
        one: "no vehicle starts on the road, so nobody is judged off the road",
        many: "no vehicle starts on the road, so nobody is judged off the road",
        find: |scenario, off_road| {
            let mut vehicles = (1..off_road.len()).filter(|&i| is_vehicle(scenario, i)).peekable();
            let found = vehicles.peek().is_some() && vehicles.all(|i| off_road[i]);
            count(usize::from(found))
        },
    },
    NoteKind {
        id: "overlapping-agents",
        one: "1 agent overlaps another one at the current frame (towed, or boxes that are too large); the metric \
              option exclude_initial_overlap leaves such pairs out",
        many: "{} agents overlap another one at the current frame (towed, or boxes that are too large); the \
               metric option exclude_initial_overlap leaves such pairs out",
        find: |scenario, _| count(overlapping_agents(scenario)),
    },
];

/// Beginning of the name of the repair that counts agents of one unknown type.
const UNKNOWN_TYPE: &str = "agents of the unknown type ";
/// Name of the repair that counts frames between the current frame and the default one.
pub const EARLIER_FRAME: &str = "frames by which the current frame is before the default one";
/// Name of the repair that counts frames between the default current frame and the current frame.
pub const LATER_FRAME: &str = "frames by which the current frame is after the default one";

/// Longest name of a type in a repair, characters.
const LONGEST_TYPE: usize = 40;

/// Returns the name of the repair that counts agents of a type that a reader does not know.
pub fn unknown_type(name: &str) -> String {
    let name: String = name.chars().take(LONGEST_TYPE).collect();
    format!("{UNKNOWN_TYPE}`{}`, taken as other objects", name.escape_debug())
}

/// Returns a note about the repairs whose names begin so, with the rest of the first name, if there is some.
fn repaired(scenario: &Scenario, name: &str) -> Option<Note> {
    let mut found =
        scenario.repairs.iter().filter_map(|(what, n)| Some((what.strip_prefix(name)?, *n))).peekable();
    let detail = found.peek()?.0.split(',').next().filter(|rest| !rest.is_empty()).map(str::to_owned);
    Some(Note { count: found.map(|(_, n)| n).sum(), detail })
}

/// Returns the note of a current frame that is not the default one, from the repair that counts the frames
/// between them.
fn moved(scenario: &Scenario, name: &str, direction: &str) -> Option<Note> {
    let frames = repaired(scenario, name)?.count;
    let noun = if frames == 1 { "frame" } else { "frames" };
    Some(Note { count: 1, detail: Some(format!("{frames} {noun} {direction} it")) })
}

/// Speed up to which a vehicle counts as standing, m/s.
const STANDSTILL_SPEED: f64 = 0.5;

/// Times from a frame to the next that are taken for 0.1 s, seconds: those that the reader of nuPlan logs
/// accepts.
const REGULAR_STEPS: RangeInclusive<f64> = 0.05..=0.15;

/// Corner rounding of boxes, the default of the collision metrics.
const CORNER_ROUNDING: f64 = 0.7;

/// Returns the number of agents, including the AV, in pairs with a vehicle that overlap at the current frame.
fn overlapping_agents(scenario: &Scenario) -> usize {
    let agents = &scenario.start.agents;
    let boxes: Vec<_> = (0..agents.len()).map(|i| scenario.start.now(i).footprint(&agents[i])).collect();
    let road = scenario.start.road();
    let place = |i: usize| (boxes[i].center, scenario.start.height_now(i));
    let overlap = |i: usize, j: usize| {
        let kinds = [agents[i].kind, agents[j].kind];
        kinds.contains(&AgentKind::Vehicle)
            && !kinds.contains(&AgentKind::Other)
            && agents[i].has_extent()
            && agents[j].has_extent()
            && (boxes[i].center - boxes[j].center).norm() <= boxes[i].radius() + boxes[j].radius()
            && !road.is_apart(place(i), place(j))
            && rounded_distance(&boxes[i], &boxes[j], CORNER_ROUNDING) < 0.0
    };
    let in_pair = |i: usize| (0..agents.len()).any(|j| i != j && overlap(i, j));
    (0..agents.len()).filter(|&i| in_pair(i)).count()
}

impl Scenario {
    /// Returns the notes of this scenario, by id. Most scenarios have no notes. They are computed at the
    /// first call.
    pub fn notes(&self) -> &Notes {
        self.notes.get_or_init(|| {
            let off_road = off_road(self);
            KINDS.iter().filter_map(|kind| Some((kind.id, (kind.find)(self, &off_road)?))).collect()
        })
    }
}

/// Returns the text of a note with a number of occurrences in one or several scenarios.
pub fn note_text(id: &str, count: u64) -> String {
    match KINDS.iter().find(|kind| kind.id == id) {
        Some(kind) if count == 1 => kind.one.to_owned(),
        Some(kind) => kind.many.replace("{}", &count.to_string()),
        None => format!("{count} {id}"),
    }
}

fn count(n: usize) -> Option<Note> {
    (n > 0).then_some(Note { count: n as u32, detail: None })
}

fn irregular_steps(scenario: &Scenario) -> Option<Note> {
    let steps = scenario.timestamps.windows(2).map(|pair| pair[1] - pair[0]).enumerate();
    let irregular: Vec<(usize, f64)> = steps.filter(|(_, step)| !REGULAR_STEPS.contains(step)).collect();
    let (before, step) = irregular.first()?;
    let detail = Some(format!("{step:.2} s before frame {}", before + 1));
    Some(Note { count: irregular.len() as u32, detail })
}

/// Notes velocities that contradict positions: those replaced at assembly, and those that are kept.
fn contradicting_velocities(scenario: &Scenario) -> Option<Note> {
    let repairs = scenario.repairs.iter();
    let replaced = repairs.filter_map(|(what, n)| Some((*n, what.strip_prefix(REPLACED)?.to_owned())));
    let tracks: Vec<_> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    let step = |frame| seconds_before(&scenario.timestamps, frame);
    let kept = VelocityContradiction::find(tracks.iter().map(Vec::as_slice), step).map(|found| {
        let first = &scenario.start.agents[found.agents[0]].id;
        (
            found.agents.len() as u32,
            format!("kept velocities, the first of agent `{first}`: {}", found.likely),
        )
    });
    let (counts, details): (Vec<u32>, Vec<String>) = replaced.chain(kept).unzip();
    (!counts.is_empty()).then(|| Note { count: counts.iter().sum(), detail: Some(details.join("; ")) })
}

fn is_vehicle(scenario: &Scenario, agent: usize) -> bool {
    scenario.start.agents[agent].kind == AgentKind::Vehicle
}

/// Returns per agent whether it is off the road at the current frame; false if the map records no drivable
/// area.
fn off_road(scenario: &Scenario) -> Vec<bool> {
    let start = &scenario.start;
    let mut nearest = None;
    let is_off = |agent| {
        let road = start.road_at(agent);
        road.drivable(start.now(agent).position(), &mut nearest) == Some(false)
    };
    (0..start.agents.len()).map(is_off).collect()
}

/// Notes road edges that contradict the lanes: most vehicles on lanes are off the road.
fn reversed_edges(scenario: &Scenario, is_off_road: &[bool]) -> Option<Note> {
    let road = scenario.start.road();
    if scenario.start.map.drivable_area.is_some() || !road.has_drivable_area() {
        return None;
    }
    let mut hits = Vec::new();
    let (mut on_lanes, mut off_road) = (0_u32, 0_u32);
    for agent in (0..scenario.start.agents.len()).filter(|&i| is_vehicle(scenario, i)) {
        road.lanes_at(scenario.start.now(agent).position(), &mut hits);
        if !hits.is_empty() {
            on_lanes += 1;
            off_road += u32::from(is_off_road[agent]);
        }
    }
    (2 * off_road > on_lanes).then_some(Note { count: 1, detail: None })
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;
    use crate::{
        Agent, AgentState, CURRENT, DT, FRAMES, LaneParts, LoggedAgent, MapParts, RoadEdge, RoadEdgeKind,
        ScenarioParts, SceneError, Surface,
    };

    /// Returns vehicles that move at these positions, the AV first, on a road along the x axis whose edges
    /// are 3 m from its middle. `reversed` edges have the drivable side on the right.
    fn scenario(
        positions: &[(f64, f64)],
        reversed: bool,
        change: impl FnOnce(&mut ScenarioParts),
    ) -> Scenario {
        assemble(positions, reversed, change).unwrap()
    }

    fn assemble(
        positions: &[(f64, f64)],
        reversed: bool,
        change: impl FnOnce(&mut ScenarioParts),
    ) -> Result<Scenario, SceneError> {
        let agents = positions.iter().enumerate().map(|(i, &(x, y))| LoggedAgent {
            agent: Agent { id: i.to_string(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 },
            track: (0..FRAMES)
                .map(|f| {
                    let x = x + 5.0 * DT * (f as f64 - CURRENT as f64);
                    Some(AgentState { x, y, heading: 0.0, vx: 5.0, vy: 0.0 })
                })
                .collect(),
            heights: Vec::new(),
        });
        let edge = |y: f64| {
            let x = if (y < 0.0) == reversed { 500.0 } else { -500.0 };
            RoadEdge { kind: RoadEdgeKind::Boundary, points: vec![Vec2::new(x, y), Vec2::new(-x, y)] }
        };
        let lane = LaneParts {
            id: "lane".into(),
            points: vec![Vec2::new(-500.0, 0.0), Vec2::new(500.0, 0.0)],
            ..LaneParts::default()
        };
        let map =
            MapParts { lanes: vec![lane], road_edges: vec![edge(-3.0), edge(3.0)], ..MapParts::default() };
        let mut parts = ScenarioParts {
            id: "made".into(),
            origin: Some(Vec2::zeros()),
            agents: agents.collect(),
            map,
            ..ScenarioParts::default()
        };
        change(&mut parts);
        Scenario::assemble(parts)
    }

    fn found(scenario: &Scenario) -> Vec<(&'static str, u32)> {
        scenario.notes().iter().map(|(id, note)| (*id, note.count)).collect()
    }

    #[test]
    fn texts_fit_their_counts() {
        assert_eq!(
            note_text("vehicles-off-road", 1),
            "1 moving vehicle starts off the road and is not judged there"
        );
        assert_eq!(
            note_text("vehicles-off-road", 5),
            "5 moving vehicles start off the road and are not judged there"
        );
        assert_eq!(note_text("av-off-road", 3), "the AV starts off the road");
        assert_eq!(note_text("of-a-newer-version", 2), "2 of-a-newer-version");
    }

    #[test]
    fn vehicles_off_the_road_are_counted() {
        let all_on = [(0.0, 0.0), (20.0, 1.0), (40.0, 0.0)];
        assert_eq!(found(&scenario(&all_on, false, |_| ())), []);
        let beside = [(0.0, 0.0), (20.0, 0.0), (40.0, 9.0), (60.0, 9.0)];
        assert_eq!(found(&scenario(&beside, false, |_| ())), [("vehicles-off-road", 2)]);
        let standing = scenario(&beside, false, |parts| {
            let now = parts.agents[3].track[CURRENT].map(|state| AgentState { vx: 0.0, ..state });
            parts.agents[3].track.fill(now);
        });
        assert_eq!(found(&standing), [("vehicles-off-road", 1)]);
        let av_parked = [(0.0, -9.0), (20.0, 0.0)];
        assert_eq!(found(&scenario(&av_parked, false, |_| ())), [("av-off-road", 1)]);
        let no_edges = scenario(&beside, false, |parts| parts.map.road_edges.clear());
        assert_eq!(found(&no_edges), [("no-drivable-area", 1)]);
    }

    #[test]
    fn edges_against_the_convention_are_recognised_by_vehicles_on_lanes() {
        let positions = [(0.0, 0.0), (20.0, 0.0), (40.0, 0.0), (60.0, 9.0)];
        assert_eq!(
            found(&scenario(&positions, true, |_| ())),
            [("av-off-road", 1), ("reversed-edges", 1), ("vehicles-off-road", 2)]
        );
    }

    #[test]
    fn driveways_are_drivable_where_edges_judge() {
        let square = [(35.0, 2.5), (45.0, 2.5), (45.0, 15.0), (35.0, 15.0)];
        let outline: Vec<Vec2> = square.into_iter().map(|(x, y)| Vec2::new(x, y)).collect();
        let s = scenario(&[(0.0, 0.0), (40.0, 9.0), (60.0, 9.0)], false, |parts| {
            parts.map.driveways.push(Surface { outline });
        });
        assert_eq!(found(&s), [("vehicles-off-road", 1)]);
        let road = s.start.road();
        let at = |x: f64, y: f64| {
            let p = Vec2::new(x, y);
            (road.drivable(p, &mut None).unwrap(), road.distance_off_road(p, &mut None).unwrap())
        };
        assert_eq!(at(40.0, 9.0), (true, 0.0));
        assert_eq!(at(60.0, 9.0), (false, 6.0));
        // Nearer to the driveway than to the edge.
        assert_eq!(at(47.0, 9.0), (false, 2.0));
    }

    #[test]
    fn irregular_clocks_are_noted_and_long_gaps_refused() {
        let clock = |late: f64| {
            move |parts: &mut ScenarioParts| {
                parts.timestamps =
                    (0..FRAMES).map(|f| DT * f as f64 + if f > 40 { late } else { 0.0 }).collect();
            }
        };
        assert_eq!(found(&scenario(&[(0.0, 0.0)], false, clock(0.02))), []);
        let gap = scenario(&[(0.0, 0.0)], false, clock(0.2));
        let detail = Some("0.30 s before frame 41".to_owned());
        assert_eq!(gap.notes()["irregular-clock"], Note { count: 1, detail });
        let error = assemble(&[(0.0, 0.0)], false, clock(1.5)).unwrap_err().to_string();
        assert!(error.contains("timestamps[41] is 1.600 s after the frame before"), "{error}");
    }

    #[test]
    fn overlapping_agents_are_noted() {
        use AgentKind::{Cyclist, Other, Pedestrian, Vehicle};
        let noted = |agents: &[(AgentKind, f64)]| {
            let positions: Vec<(f64, f64)> = agents.iter().map(|&(_, x)| (x, 0.0)).collect();
            let s = scenario(&positions, false, |parts| {
                for (logged, (kind, _)) in parts.agents.iter_mut().zip(agents) {
                    logged.agent.kind = *kind;
                }
            });
            s.notes().get("overlapping-agents").map(|note| note.count)
        };
        let av = (Vehicle, 0.0);
        // Touching boxes do not overlap.
        assert_eq!(noted(&[av, (Vehicle, 4.0), (Vehicle, 20.0)]), None);
        assert_eq!(noted(&[av, (Vehicle, 20.0), (Vehicle, 23.0)]), Some(2));
        assert_eq!(noted(&[av, (Vehicle, 3.0), (Vehicle, 6.0), (Vehicle, 20.0)]), Some(3));
        assert_eq!(noted(&[av, (Vehicle, 20.0), (Cyclist, 21.0)]), Some(2));
        assert_eq!(noted(&[av, (Pedestrian, 20.0), (Cyclist, 21.0), (Pedestrian, 20.5)]), None);
        assert_eq!(noted(&[av, (Other, 1.0)]), None);
    }
}

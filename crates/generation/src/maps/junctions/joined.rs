//! Two junctions along a road.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim_geometry::direction;
use reactsim_rollout::Stream;

use super::control::{Plan, signs};
use super::draw::{Kind, arm, arm_path, corners, pavement, section};
use super::interior::{Junction, Movement};
use super::signalised::{end, kind, phase, plan};
use super::street::{End, Port, Street};
use crate::maps::build::{MapBuilder, Path, Road, Section, mph};
use crate::{Draw, Layout};

/// Draws two signalised junctions with a green wave along the road.
pub(crate) fn signalised_pair(rng: &mut Stream) -> Layout {
    let mut b = MapBuilder::new();
    let pocket = rng.chance(0.5);
    let pair = Pair::lay(rng, &mut b, pocket, [true; 4]);
    let mut plans: Vec<Plan> = (0..2)
        .map(|i| {
            let mut phases = Vec::new();
            if pocket {
                phases.push(phase(rng, 0, true, pair.main.limit, (8.0, 12.0)));
            }
            phases.push(phase(rng, 0, false, pair.main.limit, (20.0, 34.0)));
            phases.push(phase(rng, 1, false, pair.cross[i].limit, (14.0, 26.0)));
            plan(rng, phases)
        })
        .collect();
    let longer = plans[0].cycle() - plans[1].cycle();
    let which = usize::from(longer > 0.0);
    if let Some(main) = plans[which].phases.iter_mut().find(|p| p.axis == 0 && !p.left) {
        main.green += longer.abs();
    }
    let travel = pair.distance / mph(pair.main.limit);
    plans[1].offset = (plans[0].offset - travel).rem_euclid(plans[0].cycle());
    for ((junction, movements), plan) in pair.junctions.iter().zip(&plans) {
        plan.apply(&mut b, movements);
        junction.walks(&mut b, |slot| plan.waits(movements, slot));
    }
    b.finish()
}

/// Draws a signalised junction, and near it a three-arm junction whose minor road stops.
pub(crate) fn signalised_and_t(rng: &mut Stream) -> Layout {
    let mut b = MapBuilder::new();
    let pocket = rng.chance(0.4);
    let arms = if rng.chance(0.5) { [true, true, true, false] } else { [true, false, true, true] };
    let pair = Pair::lay(rng, &mut b, pocket, arms);
    let mut phases = Vec::new();
    if pocket {
        phases.push(phase(rng, 0, true, pair.main.limit, (8.0, 12.0)));
    }
    phases.push(phase(rng, 0, false, pair.main.limit, (20.0, 34.0)));
    phases.push(phase(rng, 1, false, pair.cross[0].limit, (14.0, 26.0)));
    let plan = plan(rng, phases);
    let [(first, controlled), (second, others)] = &pair.junctions;
    plan.apply(&mut b, controlled);
    first.walks(&mut b, |slot| plan.waits(controlled, slot));
    signs(&mut b, others, 0, true);
    second.walks(&mut b, |_| Vec::new());
    b.finish()
}

/// Two junctions along a main road, which consists of arms 0 and 2 of both.
struct Pair {
    main: Kind,
    cross: [Kind; 2],
    distance: f64,
    junctions: [(Junction, Vec<Movement>); 2],
}

impl Pair {
    /// Lays both junctions; `arms` are those of the second one.
    fn lay(rng: &mut Stream, b: &mut MapBuilder, pocket: bool, arms: [bool; 4]) -> Self {
        let drawn = kind(rng, pocket);
        let main = Kind { lanes: drawn.lanes.min(2), ..drawn };
        let cross = [0, 1].map(|i| {
            let drawn = kind(rng, false);
            let quiet = i == 1 && arms != [true; 4];
            let flow = if quiet { rng.uniform(100.0, 220.0) } else { drawn.flow };
            let limit = if quiet { 25.0 } else { drawn.limit };
            Kind { lanes: if quiet { 1 } else { drawn.lanes }, bike: false, limit, flow, ..drawn }
        });
        let paved = pavement(rng, 0.9);
        let (main_section, cross_sections) =
            (section(rng, &main, paved), cross.map(|k| section(rng, &k, paved)));
        let distance = rng.uniform(150.0, 200.0);
        let heading = rng.uniform(-PI, PI);
        let u = direction(heading);
        let centres = [u * (-0.5 * distance), u * (0.5 * distance)];
        let path = Path::straight(distance).placed(0.0, centres[0], heading);
        let short = |end: End| match end {
            End::Junction { left, .. } => End::Junction { left: left.map(|l| l.min(45.0)), right: None },
            End::Border => End::Border,
        };
        // At the second junction, vehicles on the main road turn left only into arm 1, if it exists.
        let turns_left = [true, arms[1]];
        let ends = [0, 1].map(|i| match short(end(rng, &main, false)) {
            End::Junction { left, right } => End::Junction { left: left.filter(|_| turns_left[i]), right },
            End::Border => End::Border,
        });
        let mut shared = Street {
            name: "m".to_owned(),
            road: Road::new(path, main_section),
            from: 0.0,
            to: distance,
            ends,
            flow: main.flow,
        };
        let skews = [0; 2].map(|_| rng.uniform(-15.0, 15.0).to_radians());
        let mut outer = |i: usize, slot: usize, section: &Section, kind: &Kind, end: End| -> Street {
            let turn = [0.0, FRAC_PI_2 + skews[i], PI, FRAC_PI_2 + skews[i] + PI][slot];
            let path = arm_path(rng, centres[i], heading + turn, slot.is_multiple_of(2));
            arm(format!("{}{slot}", ["p", "q"][i]), path, *section, end, kind.flow)
        };
        let mut streets: [[Option<Street>; 4]; 2] = Default::default();
        for i in 0..2 {
            for slot in 0..4 {
                let is_shared = slot == 2 * i;
                if is_shared || i == 1 && !arms[slot] {
                    continue;
                }
                let on_main = slot % 2 == 0;
                // Arm 0 of the second junction turns left into arm 3.
                let left = on_main && main.median.is_some() && (i == 0 || arms[3]);
                let end = End::Junction { left: left.then_some(45.0), right: None };
                let (section, kind) =
                    if on_main { (&main_section, &main) } else { (&cross_sections[i], &cross[i]) };
                streets[i][slot] = Some(outer(i, slot, section, kind, end));
            }
        }
        let crosswalks = [0; 2].map(|_| [0; 4].map(|_| rng.chance(0.85) && paved.is_some()));
        let mut laid = Vec::new();
        for i in 0..2 {
            let shapes = [0, 1, 2, 3].map(|slot| {
                if slot == 2 * i {
                    Some(shared.shape(i))
                } else {
                    streets[i][slot].as_ref().map(|s| s.shape(0))
                }
            });
            let (corners, setbacks) = corners(rng, centres[i], &shapes, (7.0, 9.5));
            if i == 0 {
                shared.from = setbacks[0];
            } else {
                shared.to = distance - setbacks[2];
            }
            laid.push((corners, setbacks));
        }
        let [near, far] = shared.lay(b, rng);
        let mut own = [near, far];
        let mut it = laid.into_iter();
        let junctions = [0, 1].map(|i| {
            let (corners, setbacks) = it.next().unwrap_or_default();
            let ports: [Option<Port>; 4] = [0, 1, 2, 3].map(|slot| {
                if slot == 2 * i {
                    return own[i].take();
                }
                let street = streets[i][slot].as_mut()?;
                street.from = setbacks[slot];
                let [port, _] = street.lay(b, rng);
                port
            });
            let name = ["j", "k"][i].to_owned();
            let junction = Junction { name, centre: centres[i], ports, corners, crosswalks: crosswalks[i] };
            let movements = junction.lay(b);
            (junction, movements)
        });
        Self { main, cross, distance, junctions }
    }
}

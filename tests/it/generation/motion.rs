//! No agent jumps, and positions, velocities and headings agree.

use reactsim::geometry::{Vec2, direction, heading_of, wrap};
use reactsim::scene::{AgentKind, AgentState, DT, Frame};

use super::sample::{obeyed, parked};

/// Tolerance between a step and the velocities at its ends, metres: accelerations change within it.
const SLACK: f64 = 0.01;
/// The same for pedestrians, who stop within a step.
const SLACK_ON_FOOT: f64 = 0.1;
/// Speed from which a vehicle has a direction of motion, m/s.
const MOVES: f64 = 1.0;
/// Largest angle between the box of a vehicle and the motion of the middle of its rear axle, radians: two
/// degrees.
const SKID: f64 = 0.035;

/// Returns consecutive frames at which an agent is present, with the number of the second one.
fn steps(track: &[Frame]) -> impl Iterator<Item = (usize, AgentState, AgentState)> {
    (1..).zip(track.windows(2)).filter_map(|(f, pair)| Some((f, pair[0]?, pair[1]?)))
}

#[test]
fn velocities_say_where_everybody_goes() {
    obeyed(|generated, breaches| {
        for a in &generated.everybody {
            for (f, from, to) in steps(&a.track) {
                let (v, w) = (from.velocity().unwrap(), to.velocity().unwrap());
                let off = (to.position() - from.position() - (v + w) * (0.5 * DT)).norm();
                let on_foot = a.agent.kind == AgentKind::Pedestrian;
                if off > if on_foot { SLACK_ON_FOOT } else { SLACK } {
                    breaches.note(&a.agent.id, f, format_args!("{off:.3} m from where its velocity leads"));
                }
            }
        }
    });
}

/// Approximate distance of the middle of a car's rear axle behind the middle of its box, as a share of the
/// length.
const REAR: f64 = 0.3;

/// Returns the direction of motion of the point `behind` metres behind the middle of a box, radians.
fn course(from: AgentState, to: AgentState, behind: f64) -> f64 {
    let place = |s: AgentState| s.position() - direction(s.heading) * behind;
    heading_of(place(to) - place(from))
}

#[test]
fn vehicles_point_where_they_drive() {
    obeyed(|generated, breaches| {
        for a in generated.on_wheels() {
            for (f, from, to) in steps(&a.track) {
                if from.speed() < MOVES || to.speed() < MOVES {
                    continue;
                }
                // Rear axles of trucks and buses are elsewhere: the best of several positions counts.
                let heading = from.heading + 0.5 * wrap(to.heading - from.heading);
                let off = |share: f64| wrap(course(from, to, share * a.agent.length) - heading).abs();
                let least =
                    [0.0, 0.15, 0.2, 0.25, REAR, 0.35].into_iter().map(off).fold(f64::INFINITY, f64::min);
                if least > SKID {
                    let degrees = least.to_degrees();
                    breaches.note(&a.agent.id, f, format_args!("points {degrees:.1} degrees aside"));
                }
            }
        }
    });
}

#[test]
fn nobody_turns_on_the_spot() {
    obeyed(|generated, breaches| {
        for a in generated.on_wheels() {
            for (f, from, to) in steps(&a.track) {
                let (way, turn) = ((to.position() - from.position()).norm(), wrap(to.heading - from.heading));
                // No vehicle turns in a circle of less than 3 m, no bicycle of less than 1 m; headings are
                // rounded.
                let tightest = if a.agent.kind == AgentKind::Cyclist { 1.0 } else { 3.0 };
                if turn.abs() > way / tightest + 2e-4 {
                    breaches.note(&a.agent.id, f, format_args!("turns by {turn:.3} rad on {way:.3} m"));
                }
            }
        }
    });
}

#[test]
fn parked_vehicles_stay() {
    obeyed(|generated, breaches| {
        for a in generated.everybody.iter().filter(|a| parked(a)) {
            let first = a.track[0].unwrap();
            for (f, state) in a.track.iter().enumerate() {
                if *state != Some(first) || first.velocity() != Some(Vec2::zeros()) {
                    breaches.note(&a.agent.id, f, "moves");
                    break;
                }
            }
        }
    });
}

//! No pedestrian is run over, or walks through a vehicle.

use reactsim::geometry::rounded_distance;
use reactsim::scene::levels::apart;
use reactsim::scene::{AgentKind, FRAMES, LoggedAgent};

use super::sample::obeyed;

/// Rounding of boxes in the metrics.
const ROUNDING: f64 = 0.7;

/// Returns the height of an agent at a frame, metres; NaN if unknown.
fn height(agent: &LoggedAgent, frame: usize) -> f64 {
    agent.heights.get(frame).copied().flatten().unwrap_or(f64::NAN)
}

#[test]
fn nobody_on_foot_is_run_over() {
    obeyed(|generated, breaches| {
        for p in generated.everybody.iter().filter(|a| a.agent.kind == AgentKind::Pedestrian) {
            for v in generated.on_wheels() {
                // Each pair is reported once, at its first contact.
                let touches = (0..FRAMES).find_map(|f| {
                    let (a, b) = (p.track[f]?.footprint(&p.agent), v.track[f]?.footprint(&v.agent));
                    let near = (a.center - b.center).norm() < a.radius() + b.radius();
                    let touch = near
                        && rounded_distance(&a, &b, ROUNDING) < 0.0
                        && !apart(height(p, f), height(v, f), (a.center - b.center).norm());
                    touch.then(|| (f, v.track[f].map_or(0.0, |s| s.speed())))
                });
                if let Some((f, speed)) = touches {
                    breaches.note(&p.agent.id, f, format_args!("{} touches at {speed:.1} m/s", v.agent.id));
                }
            }
        }
    });
}

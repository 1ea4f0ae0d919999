//! Plans that a tracker follows: mistakes are refused by name, and no honest planner is.

use reactsim::evaluation::{Driver, EvaluationError, Outcome, RolloutCheck};
use reactsim::geometry::{direction, left};
use reactsim::planning::planner::{Planner, PlannerInput};
use reactsim::planning::tracking::Controller;
use reactsim::planning::{PlanningError, Trajectory};
use reactsim::scene::AgentState;

use super::{driven, execute};

/// Pose `t` seconds after the first plan or the present, and its speed at first.
type Draw = fn(AgentState, f64) -> [f64; 3];

/// A planner that draws poses from the state of the AV at present, or at its first plan.
struct Drawing {
    draw: Draw,
    /// Seconds between two poses.
    interval: f64,
    /// Seconds by which the first pose is late.
    late: f64,
    /// State and time of the first plan, if it goes on from there whatever the AV does.
    own_clock: Option<Option<(AgentState, f64)>>,
}

impl Planner for Drawing {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let now = input
            .seen
            .and_then(|seen| seen.state(0))
            .ok_or_else(|| PlanningError("the AV is absent".to_owned()))?;
        let time = input.ego().time;
        let (from, since) = match &mut self.own_clock {
            Some(first) => *first.get_or_insert((now, time)),
            None => (now, time),
        };
        let at = |k: i32| (self.draw)(from, time - since + self.interval * f64::from(k) - self.late);
        let poses: Vec<[f64; 3]> = (1..=40).map(at).collect();
        Ok(Trajectory::through_centers(&poses, input.ego(), input.shape)?)
    }
}

/// Creates a planner for one rollout.
type Draws = fn() -> Drawing;

const HONEST: Drawing = Drawing { draw: straight, interval: 0.1, late: 0.0, own_clock: None };

/// Returns the pose after a distance along the heading and another one to the left.
fn moved(now: AgentState, along: f64, aside: f64) -> [f64; 3] {
    let ahead = direction(now.heading);
    let p = now.position() + ahead * along + left(ahead) * aside;
    [p.x, p.y, now.heading]
}

fn straight(now: AgentState, t: f64) -> [f64; 3] {
    moved(now, now.forward_speed() * t, 0.0)
}

/// Accelerates by `a` m/s² until it has the speed `end`.
fn reaching(now: AgentState, t: f64, a: f64, end: f64) -> [f64; 3] {
    let v = now.forward_speed().max(0.0);
    let a = a.copysign(end - v);
    let changing = t.min((end - v) / a);
    moved(now, v * changing + 0.5 * a * changing * changing + end * (t - changing), 0.0)
}

fn run(drawing: Draws, every: usize, allowed: &[RolloutCheck]) -> Result<usize, EvaluationError> {
    let driver = Driver::own("drawing", move || Box::new(drawing()));
    let mut plan = driven("stop", driver, Controller::LqrBicycle, every);
    plan.spec.subject.motion.allow = allowed.to_vec();
    let (outcome, rows, failures) = execute(&plan, 1, 3, None);
    assert!(matches!(outcome?, Outcome::Finished(_)));
    // An AV that cannot follow its plan is refused where the plan is 10 m away.
    assert!(failures.iter().all(|failure| failure.error.contains("m from ego")), "{failures:?}");
    Ok(rows.iter().filter(|row| row.outcomes.keys().any(|name| name.starts_with("allowed-"))).count())
}

#[test]
fn mistakes_are_named() {
    let mistakes: [(Draws, RolloutCheck, &str); 6] = [
        (|| Drawing { interval: 0.05, ..HONEST }, RolloutCheck::Units, "motion of 0.05 s in place of 0.1 s"),
        (|| Drawing { interval: 0.2, ..HONEST }, RolloutCheck::Units, "motion of 0.2 s in place of 0.1 s"),
        (
            || Drawing {
                draw: |now, t| {
                    let [x, y, heading] = straight(now, t);
                    [x, y, heading.to_degrees()]
                },
                ..HONEST
            },
            RolloutCheck::Headings,
            "radians",
        ),
        (
            || Drawing { draw: |now, t| moved(now, now.forward_speed() * t - 1.3, 0.0), ..HONEST },
            RolloutCheck::RearAxle,
            "poses of the rear axle",
        ),
        (|| Drawing { late: 0.1, ..HONEST }, RolloutCheck::Time, "late by one step"),
        (|| Drawing { late: 0.6, ..HONEST }, RolloutCheck::Time, "0.6 s behind at step 1"),
    ];
    for (drawing, check, part) in mistakes {
        for every in [1, 5] {
            let text = run(drawing, every, &[]).expect_err(part).to_string();
            let is_named = text.contains(part) && text.contains(&format!("`allow` {}", check.allowance()));
            assert!(is_named, "{part} every {every}: {text}");
        }
    }
    let late = run(|| Drawing { late: 0.1, ..HONEST }, 5, &[RolloutCheck::Time]);
    assert!(late.unwrap() > 6, "allowed mistakes are marked");
}

#[test]
fn honest_planners_pass() {
    let honest: [(&str, Draws); 11] = [
        ("straight on", || HONEST),
        ("brakes hard", || Drawing { draw: |now, t| reaching(now, t, 8.0, 0.0), ..HONEST }),
        ("speeds up", || Drawing { draw: |now, t| reaching(now, t, 4.0, 20.0), ..HONEST }),
        ("stands at once", || Drawing { draw: |now, _| moved(now, 0.0, 0.0), ..HONEST }),
        ("has 5 m/s at once", || Drawing { draw: |now, t| moved(now, 5.0 * t, 0.0), ..HONEST }),
        ("has 15 m/s at once", || Drawing { draw: |now, t| moved(now, 15.0 * t, 0.0), ..HONEST }),
        ("is 2.5 m aside", || Drawing { draw: |now, t| moved(now, now.forward_speed() * t, 2.5), ..HONEST }),
        ("turns", || Drawing {
            draw: |now, t| {
                let turn = 0.02 * now.forward_speed() * t;
                let [x, y, heading] =
                    moved(now, now.forward_speed() * t, 0.5 * turn * now.forward_speed() * t);
                [x, y, heading + turn]
            },
            ..HONEST
        }),
        ("speeds up by its own clock", || Drawing {
            draw: |now, t| reaching(now, t, 3.0, 15.0),
            own_clock: Some(None),
            ..HONEST
        }),
        ("brakes by its own clock", || Drawing {
            draw: |now, t| reaching(now, t, 6.0, 0.0),
            own_clock: Some(None),
            ..HONEST
        }),
        ("is aside by its own clock", || Drawing {
            draw: |now, t| moved(now, now.forward_speed() * t, 1.5),
            own_clock: Some(None),
            ..HONEST
        }),
    ];
    for (what, drawing) in honest {
        for every in [1, 5, 40] {
            let marked = run(drawing, every, &[]);
            assert_eq!(marked.unwrap_or_else(|e| panic!("{what} every {every}: {e}")), 0, "{what}");
        }
    }
}

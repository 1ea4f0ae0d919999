//! Continuity of positions with the current frame, and the mistakes that break it.

use reactsim_geometry::{Vec2, direction, left, math};
use reactsim_scene::{AgentKind, DT};

use super::{CheckedMotion, CheckedScene, Finding, JUMP, Subject, median, share};
use crate::motion::kind::RolloutCheck;

/// Distance of the first given position from the expected one that is a jump of a single agent, metres:
/// recorded logs have some of 1.2 to 1.5 m, where a tracker corrects itself.
const LONE_JUMP: f64 = 2.5;
/// Largest distance of positions that a known mistake explains, metres.
const FIT: f64 = 0.5;
/// Share of the agents that a known mistake must explain.
const MOST: f64 = 0.8;
/// Speed from which agents show delays and wrong units, m/s.
const MOVING: f64 = 3.0;
/// Smallest offset along the heading that counts as another point of the vehicle, metres: more than what
/// braking adds in 0.1 s (0.05 m at 10 m/s²) and than noise of recorded velocities.
const AXLE_OFFSET: f64 = 0.5;
/// Difference from the present displacement per step that a plan shows in its second step, metres: more than
/// what braking as hard as possible changes by then (10 m/s²).
const PLANNED_CHANGE: f64 = 0.15;
/// Ratio of displacements from which motion is too fast, and its inverse too slow, to continue.
const RATIO: f64 = 1.5;
/// Smallest distance of an origin from the world's origin at which the two frames can be told apart, metres.
const FAR_ORIGIN: f64 = 10.0;
/// Largest distance of the entry at the current frame from the current state, metres: more than rounding.
const ENTRY0_TOLERANCE: f64 = 0.05;

/// Ratios with a name: given over expected.
const RATIOS: &[(f64, &str)] = &[
    (3.6, "km/h read as m/s"),
    (1.0 / 3.6, "m/s read as km/h"),
    (3.281, "feet in place of metres"),
    (0.3048, "metres converted from feet although they are metres"),
    (2.237, "miles per hour read as m/s"),
    (0.447, "m/s read as miles per hour"),
    (10.0, "motion of 1 s in place of 0.1 s"),
    (0.1, "motion of 0.01 s in place of 0.1 s"),
    (5.0, "motion of 0.5 s in place of 0.1 s"),
    (2.0, "motion of 0.2 s in place of 0.1 s"),
    (0.5, "motion of 0.05 s in place of 0.1 s"),
    (100.0, "centimetres in place of metres"),
    (0.01, "metres divided by 100"),
    (1000.0, "millimetres in place of metres"),
    (0.001, "kilometres in place of metres"),
];

/// Checks whether plans continue from where the AV is when they are made. Distances alone show nothing: a
/// plan may begin on the centre line beside the AV, or ahead of an AV that lags behind its plans.
pub(super) fn of_plans(scene: &CheckedScene<'_>) -> Option<Finding> {
    let plans: Vec<&CheckedMotion<'_>> = scene.agents.iter().filter(|a| a.first().is_some()).collect();
    late(scene, &plans)
        .or_else(|| speed_ratio(scene, &plans))
        .or_else(|| rear_axle(scene))
        .or_else(|| delay(scene, &plans))
}

/// Checks whether the motion continues from the current frame.
pub(super) fn finding(scene: &CheckedScene<'_>) -> Option<Finding> {
    let agents: Vec<&CheckedMotion<'_>> = scene.agents.iter().filter(|a| a.first().is_some()).collect();
    if let Some(finding) = late(scene, &agents).or_else(|| rear_axle(scene)) {
        return Some(finding);
    }
    if let Some(text) = entry0(scene) {
        return Some(Finding::new(RolloutCheck::Continuity, text));
    }
    let jumping = agents.iter().filter(|a| is_jump(a)).count();
    // Mistakes of frames and order move most agents far.
    if jumping >= 2
        && 2 * jumping >= agents.len()
        && let Some(finding) = frame(scene, &agents).or_else(|| order(&agents))
    {
        return Some(finding);
    }
    if let Some(finding) = delay(scene, &agents).or_else(|| speed_ratio(scene, &agents)) {
        return Some(finding);
    }
    Some(Finding::new(RolloutCheck::Continuity, jump(&agents)?))
}

fn is_lone_jump(agent: &CheckedMotion<'_>) -> bool {
    agent.residual().is_some_and(|residual| residual.norm() > LONE_JUMP)
}

fn is_jump(agent: &CheckedMotion<'_>) -> bool {
    // NaN is not within the tolerance either.
    agent
        .residual()
        .is_some_and(|residual| !matches!(residual.norm().total_cmp(&JUMP), std::cmp::Ordering::Less))
}

/// Poses of the rear axle, or of another point of the vehicles.
fn rear_axle(scene: &CheckedScene<'_>) -> Option<Finding> {
    // A vehicle that stands at once, within 0.1 s, is behind where its velocity leads, too.
    let stops =
        |a: &CheckedMotion<'_>| a.speed() * DT >= AXLE_OFFSET && a.second().is_some() && !a.sets_off();
    let vehicles = scene.agents.iter().filter(|a| a.kind == AgentKind::Vehicle && a.length > 0.0);
    let vehicles = vehicles.filter(|a| a.entry0.is_some() || !stops(a));
    let offsets: Vec<(f64, f64, f64)> = vehicles
        .filter_map(|a| {
            let by = match a.entry0 {
                Some(entry) => entry.position() - a.now.position(),
                None => a.residual()?,
            };
            let ahead = direction(a.now.heading);
            Some((by.dot(&ahead), by.dot(&left(ahead)), a.length))
        })
        .collect();
    if offsets.len() < scene.least(3) {
        return None;
    }
    let along = median(offsets.iter().map(|o| o.0))?;
    let of_length = median(offsets.iter().map(|o| o.0 / o.2))?;
    // A single trajectory without its current state cannot be told apart from a late one by its size only.
    let has_entry0 = scene.agents.first().is_some_and(|a| a.entry0.is_some());
    let (least, most) = match has_entry0 || scene.subject == Subject::Agents {
        true => (0.0, 0.5),
        false => (0.2, 0.4),
    };
    let is_axle = |&(s, l, length): &(f64, f64, f64)| {
        let part = s / length;
        s * along > 0.0
            && s.abs() >= AXLE_OFFSET
            && (least..=most).contains(&part.abs())
            && l.abs() <= 0.25
            && ((part - of_length).abs() <= 0.05 || (s - along).abs() <= 0.15)
    };
    let fitting = offsets.iter().filter(|o| is_axle(o)).count();
    // An AV that lags behind its plans does not do so at the first.
    let lags = scene.subject == Subject::Plans && !is_axle(&offsets[0]);
    if lags || (fitting as f64) < MOST * offsets.len() as f64 {
        return None;
    }
    let (what, mend) = match along < 0.0 {
        true if scene.subject == Subject::Plans => ("poses of the rear axle", "give box centres"),
        true => ("poses of the rear axle", "give `pose` rear-axle, or box centres"),
        false => ("poses of a point ahead of the centre", "give box centres"),
    };
    let noun = if scene.subject == Subject::Plans { "plans" } else { "vehicles" };
    Some(Finding::new(
        RolloutCheck::RearAxle,
        format!(
            "the positions look like {what}: {fitting} of {} {noun} are {:.3} m {} their box centres along \
             the heading ({:.1} % of their length); {mend}",
            offsets.len(),
            along.abs(),
            if along < 0.0 { "behind" } else { "ahead of" },
            100.0 * of_length.abs(),
        ),
    ))
}

/// An entry at the current frame that is not the current state.
fn entry0(scene: &CheckedScene<'_>) -> Option<String> {
    let agent = scene.agents.iter().find(|a| {
        let distance = a.entry0.map(|entry| (entry.position() - a.now.position()).norm());
        distance.is_some_and(|d| d > ENTRY0_TOLERANCE)
    })?;
    let by = agent.entry0?.position() - agent.now.position();
    Some(format!(
        "entry 0 of agent `{}` is ({:.2}, {:.2}) m from its state at the current frame, where it must be; \
         give box centres in the frame of the scenario, or in world coordinates",
        agent.id, by.x, by.y
    ))
}

/// Another frame of coordinates.
fn frame(scene: &CheckedScene<'_>, agents: &[&CheckedMotion<'_>]) -> Option<Finding> {
    let given: Vec<Vec2> = agents.iter().filter_map(|a| a.first()).collect();
    let expected: Vec<Vec2> = agents.iter().map(|a| a.expected()).collect();
    let fits = |map: &dyn Fn(usize, Vec2) -> Vec2| {
        let errors: Vec<f64> =
            given.iter().enumerate().map(|(i, p)| (map(i, *p) - expected[i]).norm()).collect();
        share(&errors, |e| e <= FIT) >= MOST
    };
    let found = |text: String| Some(Finding::new(RolloutCheck::Coordinates, text));
    // By one offset.
    let by = Vec2::new(
        median(given.iter().zip(&expected).map(|(g, e)| g.x - e.x))?,
        median(given.iter().zip(&expected).map(|(g, e)| g.y - e.y))?,
    );
    let origin = scene.origin;
    if fits(&|_, p| p - by) {
        let is_origin = origin.norm() > FAR_ORIGIN
            && [origin, -origin].iter().any(|o| (by - o).norm() <= JUMP.max(1e-3 * by.norm()));
        return found(if is_origin {
            "all agents are moved by the origin of the scenario: the coordinates are in the other frame (the \
             column `origin` states which)"
                .to_owned()
        } else {
            format!(
                "all agents are moved by ({:.1}, {:.1}) m at step 1; give positions with the origin of the \
                 states that the program sends",
                by.x, by.y
            )
        });
    }
    let ahead = direction(scene.av.heading);
    let in_frame = |p: Vec2, ahead: Vec2| ahead * p.x + left(ahead) * p.y;
    let av = scene.av.position();
    let own = |i: usize, p: Vec2| agents[i].now.position() + in_frame(p, direction(agents[i].now.heading));
    type Map<'a> = &'a dyn Fn(usize, Vec2) -> Vec2;
    let maps: [(Map<'_>, &str); 10] = [
        (&|_, p| Vec2::new(p.y, p.x), "x and y look swapped"),
        (&|_, p| Vec2::new(p.x, -p.y), "y looks mirrored (an axis that points to the right or downwards)"),
        (&|_, p| Vec2::new(-p.x, p.y), "x looks mirrored"),
        (&|_, p| Vec2::new(-p.x, -p.y), "x and y look negated"),
        (&|_, p| Vec2::new(p.y, -p.x), "positions look turned by 90° counter-clockwise"),
        (&|_, p| Vec2::new(-p.y, p.x), "positions look turned by 90° clockwise"),
        (&|i, p| agents[i].now.position() + p, "positions look relative to each agent's own position"),
        (&own, "positions look like those of each agent's own frame"),
        (
            &|_, p| av + in_frame(p, ahead),
            "positions look like those of the AV's frame, turned by its heading",
        ),
        (&|_, p| p + av, "positions look relative to the AV"),
    ];
    for (map, text) in maps {
        if fits(map) {
            return found(format!(
                "{text}: step 1 does not continue from the current frame otherwise; give positions along the \
                 axes of the states that the program sends"
            ));
        }
    }
    // Another unit of length.
    let dots = |f: fn(&Vec2, &Vec2) -> f64| given.iter().zip(&expected).map(|(g, e)| f(g, e)).sum::<f64>();
    let scale = dots(|g, e| g.dot(e)) / dots(|_, e| e.dot(e));
    let is_other = scale.is_finite() && scale > 0.0 && !(0.9..1.1).contains(&scale);
    if is_other && fits(&|_, p| p / scale) {
        let text = format!(
            "positions are {scale:.3} times as large as those of the current frame{}; give metres",
            named_ratio(scale)
        );
        return Some(Finding::new(RolloutCheck::Units, text));
    }
    None
}

/// Agents in another order.
fn order(agents: &[&CheckedMotion<'_>]) -> Option<Finding> {
    if agents.len() < 3 {
        return None;
    }
    let at_other = |(i, agent): &(usize, &&CheckedMotion<'_>)| {
        let Some(first) = agent.first() else { return false };
        let other = agents.iter().enumerate().find(|(j, o)| j != i && (first - o.expected()).norm() <= FIT);
        is_jump(agent) && other.is_some()
    };
    let jumping = agents.iter().filter(|a| is_jump(a)).count();
    let moved: Vec<_> = agents.iter().enumerate().filter(at_other).collect();
    if (moved.len() as f64) < MOST * jumping as f64 {
        return None;
    }
    Some(Finding::new(
        RolloutCheck::Order,
        format!(
            "the agents look exchanged: {} of {} agents are at step 1 where another one should be, the first \
             `{}`; answer in the order in which the agents are sent",
            moved.len(),
            agents.len(),
            moved.first()?.1.id
        ),
    ))
}

/// Motion that is one step behind.
fn late(scene: &CheckedScene<'_>, agents: &[&CheckedMotion<'_>]) -> Option<Finding> {
    let moving = agents.iter().filter(|a| a.speed() >= MOVING).count();
    let same = agents.iter().filter(|a| a.speed() >= MOVING && a.begins_here() && a.sets_off()).count();
    if moving == 0 || moving < scene.least(2) || (same as f64) < MOST * moving as f64 {
        return None;
    }
    let noun = scene.noun();
    Some(Finding::new(
        RolloutCheck::Time,
        format!(
            "the motion looks late by one step: step 1 of {same} of {moving} moving {noun} is exactly the \
             current frame; answer with the states after 1, 2, … steps, without the current one"
        ),
    ))
}

/// Motion of an earlier frame.
fn delay(scene: &CheckedScene<'_>, agents: &[&CheckedMotion<'_>]) -> Option<Finding> {
    let moving: Vec<&&CheckedMotion<'_>> = agents.iter().filter(|a| a.speed() >= MOVING).collect();
    if scene.subject == Subject::OneAgent || moving.len() < 3 {
        return None;
    }
    // All behind by one time.
    let delay = median(moving.iter().filter_map(|a| {
        let v = a.velocity?;
        Some(-a.residual()?.dot(&v) / v.dot(&v))
    }))?;
    if !(0.095..5.0).contains(&delay) {
        return None;
    }
    let error =
        |a: &CheckedMotion<'_>| Some((a.residual()? + a.velocity? * delay).norm() / (delay * a.speed()));
    let errors: Vec<f64> = moving.iter().filter_map(|a| error(a)).collect();
    // An AV that lags behind its plans does not do so at the first.
    if scene.subject == Subject::Plans && agents.first().and_then(|a| error(a)).is_none_or(|e| e > 0.25) {
        return None;
    }
    // Agents that stay from here on are frozen, not late.
    let move_on = moving.iter().filter(|a| a.sets_off()).count();
    if share(&errors, |e| e <= 0.25) < MOST || (move_on as f64) < MOST * moving.len() as f64 {
        return None;
    }
    Some(Finding::new(
        RolloutCheck::Time,
        format!(
            "the motion looks like that of an earlier frame: {} moving {} are {delay:.1} s behind at step 1; \
             continue from the latest frame of the states (the last one, not the first)",
            moving.len(),
            scene.noun()
        ),
    ))
}

/// Displacements in other units of length or time.
fn speed_ratio(scene: &CheckedScene<'_>, agents: &[&CheckedMotion<'_>]) -> Option<Finding> {
    let plans = scene.subject == Subject::Plans;
    let ratio = |a: &CheckedMotion<'_>| {
        let v = a.velocity?;
        // A plan may begin elsewhere.
        let (by, least) = match plans {
            true => (a.second()?, PLANNED_CHANGE),
            false => (a.first()? - a.now.position(), 0.25),
        };
        let differs = a.speed() >= MOVING && (by - v * DT).norm() >= least;
        differs.then_some(by.dot(&v) / (v.dot(&v) * DT))
    };
    let ratios: Vec<f64> = agents.iter().filter_map(|a| ratio(a)).collect();
    let moving = agents.iter().filter(|a| a.speed() >= MOVING).count();
    // A single plan may be that of a planner that leaves it to the tracker to slow down.
    if plans && moving < 2 {
        return None;
    }
    if ratios.len() < scene.least(3) || (ratios.len() as f64) < 0.5 * moving as f64 {
        return None;
    }
    let ratio = median(ratios.iter().copied())?;
    let is_possible = (1.0 / RATIO..=RATIO).contains(&ratio) || ratio <= 0.005;
    if is_possible || share(&ratios, |r| (r / ratio - 1.0).abs() <= 0.15) < MOST {
        return None;
    }
    Some(Finding::new(
        RolloutCheck::Units,
        format!(
            "{} of {moving} moving {} are {ratio:.2} times as fast at step 1 as at the current frame{}; give \
             metres, one state per 0.1 s, from velocities in m/s",
            ratios.len(),
            scene.noun(),
            named_ratio(ratio)
        ),
    ))
}

/// Returns what a ratio looks like, if it is a known one.
fn named_ratio(ratio: f64) -> String {
    let nearest = RATIOS.iter().min_by(|a, b| {
        let distance = |known: f64| math::ln(ratio / known).abs();
        distance(a.0).total_cmp(&distance(b.0))
    });
    let close = nearest.filter(|(known, _)| (ratio / known - 1.0).abs() <= 0.05);
    close.map_or_else(String::new, |(_, name)| format!(" ({name})"))
}

fn jump(agents: &[&CheckedMotion<'_>]) -> Option<String> {
    let first = agents.iter().find(|a| is_lone_jump(a))?;
    let distance = first.residual()?.norm();
    let n = agents.iter().filter(|a| is_lone_jump(a)).count();
    let others = if n > 1 { format!("; {n} of {} agents are such", agents.len()) } else { String::new() };
    Some(format!("agent `{}` is {distance:.1} m from where its velocity leads at step 1{others}", first.id))
}

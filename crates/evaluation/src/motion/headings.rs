//! Headings against the current frame and against the motion.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim_geometry::{heading_of, math, wrap};
use reactsim_scene::AgentKind;

use super::{CheckedMotion, CheckedScene, Finding, Subject, median, share};
use crate::motion::kind::RolloutCheck;

/// Largest change of the heading of a vehicle or cyclist in 0.1 s, radians: 200°/s.
const TURN: f64 = 0.35;
/// Largest difference of headings that a known mistake explains, radians.
const FIT: f64 = 0.1;
/// Share of the agents that a known mistake must explain.
const MOST: f64 = 0.9;
/// Steps over which the direction of motion is measured.
const WINDOW: usize = 5;
/// Displacement over these steps from which agents have a direction, metres: 6 m/s.
const DISPLACEMENT: f64 = 3.0;
/// Angle between motion and heading from which they disagree, radians.
const ASKEW: f64 = 0.6;

/// Speed from which the AV follows its plans, m/s: at rest it may be at an angle to them for good.
const FOLLOWING: f64 = 1.0;

fn has_heading(agent: &CheckedMotion<'_>) -> bool {
    matches!(agent.kind, AgentKind::Vehicle | AgentKind::Cyclist)
}

/// Checks whether headings continue from the current frame.
pub(super) fn finding(scene: &CheckedScene<'_>) -> Option<Finding> {
    let are_plans = scene.subject == Subject::Plans;
    let headings: Vec<(f64, f64)> = scene
        .agents
        .iter()
        .filter(|a| has_heading(a) && (!are_plans || a.speed() >= FOLLOWING))
        .filter_map(|a| Some((a.future.first()?.as_ref()?.heading, a.now.heading)))
        .collect();
    let turns: Vec<f64> = headings.iter().map(|(given, now)| wrap(given - now)).collect();
    let wrong = turns.iter().filter(|turn| turn.abs() > TURN).count();
    if wrong < scene.least(2) || (wrong as f64) < 0.2 * turns.len() as f64 {
        return None;
    }
    let fits = |map: &dyn Fn(f64) -> f64| {
        let errors: Vec<f64> = headings.iter().map(|(given, now)| wrap(map(*given) - now).abs()).collect();
        share(&errors, |e| e <= FIT) >= MOST
    };
    let sum = |part: fn(f64) -> f64| turns.iter().map(|t| part(*t)).sum::<f64>();
    let mean = math::atan2(sum(math::sin), sum(math::cos));
    let what = if fits(&|h| h.to_radians()) {
        "they look like degrees; give radians".to_owned()
    } else if fits(&|h| -h.to_radians()) || fits(&|h| FRAC_PI_2 - h.to_radians()) {
        "they look like degrees that increase clockwise; give radians counter-clockwise from the x axis"
            .to_owned()
    } else if fits(&|h| -h) {
        "they look clockwise; give radians counter-clockwise".to_owned()
    } else if fits(&|h| FRAC_PI_2 - h) {
        "they look clockwise from the y axis, as of a compass or of swapped axes; give radians \
         counter-clockwise from the x axis"
            .to_owned()
    } else if are_plans {
        // A plan may turn into the lane at once.
        return None;
    } else if fits(&|h| h - mean) {
        format!(
            "they look turned by a constant {:.0}°; give radians counter-clockwise from the x axis",
            mean.to_degrees()
        )
    } else if 2 * wrong >= turns.len() && wrong >= scene.least(3) {
        "give radians counter-clockwise from the x axis".to_owned()
    } else {
        return None;
    };
    let turn = median(turns.iter().map(|t| t.abs()).filter(|t| *t > TURN))?;
    Some(Finding::new(
        RolloutCheck::Headings,
        format!(
            "the headings of {wrong} of {} {} change by {:.0}° (median) from the current frame to step 1: \
             {what}",
            turns.len(),
            scene.noun(),
            turn.to_degrees()
        ),
    ))
}

/// Checks whether agents move along their headings after the first step.
pub(super) fn against_motion(scene: &CheckedScene<'_>) -> Option<Finding> {
    let agents: Vec<f64> = scene.agents.iter().filter(|a| has_heading(a)).filter_map(angle).collect();
    let wrong: Vec<f64> = agents.iter().copied().filter(|a| a.abs() > ASKEW).collect();
    if wrong.len() < scene.least(3) || 2 * wrong.len() < agents.len() {
        return None;
    }
    let angle = median(wrong.iter().map(|a| a.abs()))?;
    Some(Finding::new(
        RolloutCheck::Headings,
        format!(
            "{} of {} moving {} do not move along their headings, but at {:.0}° to them (median); give \
             radians counter-clockwise from the x axis, and positions along the same axes",
            wrong.len(),
            agents.len(),
            scene.noun(),
            angle.to_degrees()
        ),
    ))
}

/// Median angle between motion and heading where an agent moves, radians.
fn angle(agent: &CheckedMotion<'_>) -> Option<f64> {
    let angles = (WINDOW..agent.future.len()).filter_map(|k| {
        let (before, middle, after) =
            (agent.future[k - WINDOW]?, agent.future[k - WINDOW / 2]?, agent.future[k]?);
        let by = after.position() - before.position();
        (by.norm() >= DISPLACEMENT).then(|| wrap(heading_of(by) - middle.heading))
    });
    let angles: Vec<f64> = angles.collect();
    (angles.len() >= WINDOW).then_some(())?;
    median(angles.into_iter().map(|a| a.abs().min(PI)))
}

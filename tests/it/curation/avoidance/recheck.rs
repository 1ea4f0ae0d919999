//! Independent check of everything that a certificate promises, with its own distances, times to collision
//! and limits.

use std::f64::consts::PI;

use reactsim::curation::{AvoidanceSettings, Certificate, Response};
use reactsim::geometry::{OrientedBox, Vec2, direction};
use reactsim::scene::{Agent, AgentKind, AgentState, CURRENT, DT, FUTURE, Frame, Scenario};

use crate::scenes::slot;

/// Returns the distance from a point to a sharp box, negative inside.
fn to_box(p: Vec2, b: &OrientedBox) -> f64 {
    let d = p - b.center;
    let (x, y) = (d.dot(&b.axis).abs() - b.half_length, b.axis.perp(&d).abs() - b.half_width);
    x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0)
}

/// Returns the distance of two rounded boxes (corners are quarter circles of 0.7 times half the shorter
/// side), exact if their cores are apart; for boxes that are far from each other, a lower bound of it.
fn distance(a: &OrientedBox, b: &OrientedBox) -> f64 {
    let radius = |x: &OrientedBox| x.half_length.hypot(x.half_width);
    let apart = (a.center - b.center).norm() - radius(a) - radius(b);
    if apart > 1.0 {
        return apart;
    }
    let round = |x: &OrientedBox| 0.7 * x.half_length.min(x.half_width);
    let core = |x: &OrientedBox| {
        let r = round(x);
        OrientedBox { half_length: x.half_length - r, half_width: x.half_width - r, ..*x }
    };
    // Of separate boxes, a corner of one is nearest. Boxes that cross without a corner in the other are found
    // by points of the sides.
    let from = |x: &OrientedBox, y: &OrientedBox| {
        let corners = x.corners();
        let sides = (0..4).flat_map(|i| {
            let (p, q) = (corners[i], corners[(i + 1) % 4]);
            (0..40).map(move |m| p + (q - p) * (f64::from(m) / 40.0))
        });
        sides.map(|p| to_box(p, y)).fold(f64::INFINITY, f64::min)
    };
    let (p, q) = (core(a), core(b));
    from(&p, &q).min(from(&q, &p)) - round(a) - round(b)
}

/// Returns the box of an agent at a frame.
fn footprint(agent: &Agent, state: Frame) -> Option<OrientedBox> {
    state.map(|s| OrientedBox::new(s.position(), s.heading, agent.length, agent.width))
}

/// Returns the first step at which an observer who knows the log sees that an agent deviates from it.
fn visible(logged: &[Frame], moved: &[Frame]) -> Option<usize> {
    (1..=FUTURE).find(|&k| {
        let (Some(was), Some(is)) = (logged[k], moved[k]) else { return false };
        let turned = (is.heading - was.heading + PI).rem_euclid(2.0 * PI) - PI;
        (is.position() - was.position()).norm() > 0.5
            || turned.abs() > 6_f64.to_radians()
            || (is.speed() - was.speed()).abs() > 1.0
    })
}

/// Returns whether the metrics count overlaps of the two agents.
fn judged(a: &Agent, b: &Agent) -> bool {
    let on_foot = |x: &Agent| x.kind == AgentKind::Pedestrian;
    let light = |x: &Agent| x.kind != AgentKind::Vehicle;
    !(on_foot(a) && light(b) || on_foot(b) && light(a))
}

/// Checks that, except within 0.2 s of an overlap in the log, two boxes overlap at most as much as they do
/// there.
fn kept_apart(name: &str, now: [&[Option<OrientedBox>]; 2], logged: [&[Option<OrientedBox>]; 2]) {
    let apart =
        |x: [&[Option<OrientedBox>]; 2], k: usize| Some(distance(x[0][k].as_ref()?, x[1][k].as_ref()?));
    let in_log: Vec<f64> = (0..=FUTURE).map(|k| apart(logged, k).unwrap_or(f64::INFINITY)).collect();
    let closest = in_log.iter().copied().fold(f64::INFINITY, f64::min);
    // Between the frames of the log, the overlap may be a little larger.
    let least = if closest < 0.0 { closest.max(-0.2) - 0.02 } else { 0.0 };
    for k in 1..=FUTURE {
        let excused = in_log[k.saturating_sub(2)..=(k + 2).min(FUTURE)].iter().any(|d| *d < 0.0);
        let Some(apart) = apart(now, k).filter(|_| !excused) else { continue };
        assert!(apart >= least - 1e-9, "{name} at step {k}: {apart:.3} m, in the log {closest:.3} m");
    }
}

/// Checks everything that a certificate promises.
pub(super) fn recheck(scenario: &Scenario, av: &[AgentState], certificate: &Certificate) {
    let agents = &scenario.start.agents;
    let logged: Vec<Vec<Frame>> = (0..agents.len()).map(|i| scenario.logged(i)[CURRENT..].to_vec()).collect();
    let mut tracks = logged.clone();
    tracks[0] = av.iter().copied().map(Some).collect();
    let mut responds = vec![false; agents.len()];
    for response in &certificate.responses {
        let i = slot(scenario, &response.agent);
        responds[i] = true;
        limits(scenario, i, response);
        let responds = response.reaction_step + 1..;
        tracks[i].truncate(responds.start);
        tracks[i].extend(response.track[responds].iter().copied().map(Some));
    }
    let boxes = |tracks: &[Vec<Frame>]| -> Vec<Vec<Option<OrientedBox>>> {
        let of = |(agent, track): (&Agent, &Vec<Frame>)| track.iter().map(|s| footprint(agent, *s)).collect();
        agents.iter().zip(tracks).map(of).collect()
    };
    let (now, before) = (boxes(&tracks), boxes(&logged));
    let disturbs = |i: usize, track: &[Frame], at: &[Option<OrientedBox>], k: usize| -> Option<String> {
        let apart = distance(at[k].as_ref()?, now[0][k].as_ref()?);
        let ttc = match agents[i].kind {
            AgentKind::Vehicle => time_to_collision(&agents[i], &track[k]?, &agents[0], &av[k]),
            _ => 5.0,
        };
        let name = format!("{}: `{}` at step {k}", scenario.id, agents[i].id);
        (apart < -1e-9 || ttc < 0.5).then(|| format!("{name}: {apart:.3} m and {ttc:.2} s from the AV"))
    };
    for i in (1..agents.len()).filter(|&i| agents[i].kind != AgentKind::Other) {
        for k in 1..=FUTURE {
            assert_eq!(disturbs(i, &tracks[i], &now[i], k), None);
        }
        if !responds[i] {
            continue;
        }
        let name = |other: &str| format!("{}: `{}` and `{other}`", scenario.id, agents[i].id);
        for j in (1..agents.len()).filter(|&j| j != i && judged(&agents[i], &agents[j])) {
            kept_apart(&name(&agents[j].id), [&now[i], &now[j]], [&before[i], &before[j]]);
        }
        for obstacle in &scenario.start.obstacles {
            let standing = vec![Some(*obstacle); FUTURE + 1];
            kept_apart(&name("obstacle"), [&now[i], &standing], [&before[i], &standing]);
        }
    }
    for response in &certificate.responses {
        let i = slot(scenario, &response.agent);
        // The reaction comes 0.3 s after its cause is visible: the AV if that disturbs the agent, else the
        // response of another agent.
        let direct = (1..=FUTURE).any(|k| disturbs(i, &logged[i], &before[i], k).is_some());
        let others = (1..agents.len()).filter(|&j| j != i && responds[j]);
        let seen = match direct {
            true => visible(&logged[0], &tracks[0]),
            false => others.filter_map(|j| visible(&logged[j], &tracks[j])).min(),
        };
        let earliest = seen.map_or(FUTURE, |k| (k + 3).min(FUTURE));
        let name = format!("{}: `{}`", scenario.id, response.agent);
        assert!(response.reaction_step >= earliest, "{name}: {} before {earliest}", response.reaction_step);
        let nearest = (1..=FUTURE)
            .filter_map(|k| Some(distance(now[i][k].as_ref()?, now[0][k].as_ref()?)))
            .fold(f64::INFINITY, f64::min);
        if nearest < 1.0 || response.clearance < 1.0 {
            assert!((nearest - response.clearance).abs() < 1e-6, "{nearest} but {}", response.clearance);
        }
    }
}

/// Returns the largest speed that the bends of a log allow at a position: for 4 m/s², or 1.1 times the logged
/// speed there.
fn allowed_there(log: &[Frame], place: Vec2) -> f64 {
    let mut points: Vec<AgentState> = Vec::new();
    for state in log.iter().flatten() {
        if points.last().is_none_or(|last| (state.position() - last.position()).norm() > 0.4) {
            points.push(*state);
        }
    }
    let near = |s: &&AgentState| (s.position() - place).norm() < 3.5;
    let driven = log.iter().flatten().filter(near).map(AgentState::speed).fold(0.0, f64::max);
    let by_distance = |a: &usize, b: &usize| {
        let d = |i: usize| (points[i].position() - place).norm();
        d(*a).total_cmp(&d(*b))
    };
    let Some(at) = (0..points.len()).min_by(by_distance) else { return f64::INFINITY };
    let walk = |step: isize| {
        let (mut i, mut way) = (at, 0.0);
        while let Some(next) = i.checked_add_signed(step).filter(|n| *n < points.len() && way < 2.5) {
            way += (points[next].position() - points[i].position()).norm();
            i = next;
        }
        (points[i].heading, way)
    };
    let ((from, back), (to, on)) = (walk(-1), walk(1));
    let turned = ((to - from + PI).rem_euclid(2.0 * PI) - PI).abs();
    if back + on < 2.5 {
        return f64::INFINITY;
    }
    (4.0 * (back + on) / turned).sqrt().max(1.1 * driven)
}

/// Returns the time to collision as the benchmark defines it.
fn time_to_collision(me: &Agent, s: &AgentState, other: &Agent, o: &AgentState) -> f64 {
    let d = o.position() - s.position();
    let turn = (o.heading - s.heading + PI).rem_euclid(2.0 * PI) - PI;
    let (c, n) = (turn.cos().abs(), turn.sin().abs());
    let gap = d.dot(&direction(s.heading)) - me.length / 2.0 - other.length / 2.0 * c - other.width / 2.0 * n;
    let beside =
        direction(s.heading).perp(&d).abs() - me.width / 2.0 - other.length / 2.0 * n - other.width / 2.0 * c;
    let front = gap > 0.0
        && turn.abs() <= 75_f64.to_radians()
        && beside < 0.0
        && (beside < -0.5 || turn.abs() <= 10_f64.to_radians());
    let closing = s.speed() - o.speed();
    if front && closing > 0.0 { gap / closing } else { 5.0 }
}

/// Checks the bounds of one response: as in the log up to the reaction, then along the logged path with
/// bounded braking and jerk.
fn limits(scenario: &Scenario, i: usize, response: &Response) {
    let log = scenario.logged(i);
    let name = format!("{}: `{}`", scenario.id, response.agent);
    let r = response.reaction_step;
    assert_eq!(response.track.len(), FUTURE + 1, "{name}");
    for k in 0..=r {
        if let Some(was) = log[CURRENT + k] {
            assert_eq!(response.track[k], was, "{name} leaves its log at step {k} < {r}");
        }
    }
    let settings = AvoidanceSettings::default();
    let at = |k: usize| response.track[k];
    let hardest_gain = 3.5;
    let mut before: Option<f64> = None;
    for k in r + 1..=FUTURE {
        let moved = (at(k).position() - at(k - 1).position()) / DT;
        let said = Vec2::new(at(k).vx, at(k).vy);
        assert!((moved - said).norm() < 1e-6, "{name}: velocity at step {k}");
        let from = if k == r + 1 && at(r).speed() < 0.1 { 0.0 } else { at(k - 1).speed() };
        if !from.is_finite() {
            continue;
        }
        let a = (said.norm() - from) / DT;
        assert!(a >= -settings.max_deceleration - 0.15, "{name} brakes at {a:.2} m/s2 at step {k}");
        assert!(a <= hardest_gain + 0.15, "{name} gains {a:.2} m/s2 at step {k}");
        if let Some(before) = before {
            let jerk = (a - before) / DT;
            // Positions are on chords of the path, which adds a little to the profile's own jerk.
            assert!(jerk.abs() <= settings.max_jerk + 3.0, "{name}: {jerk:.1} m/s3 at step {k}");
        }
        before = Some(a);
        let turns = scenario.start.agents[i].kind != AgentKind::Pedestrian;
        let most = if turns { allowed_there(&log, at(k).position()) } else { f64::INFINITY };
        // Bends are measured between recorded points, the paths of responses between points every half metre.
        assert!(
            said.norm() <= 1.1 * most + 0.3,
            "{name} goes {:.1} m/s at step {k}, not {most:.1}",
            said.norm()
        );
        if at(k).position() == at(k - 1).position() {
            assert_eq!(at(k).speed(), 0.0, "{name} stands at step {k}");
            assert_eq!(at(k).heading, at(k - 1).heading, "{name} stands at step {k}");
        }
    }
    // The response goes further than the log by at most 2 m plus a tenth of the distance at the log's last
    // speed.
    let way = |states: &mut dyn Iterator<Item = AgentState>| {
        let positions: Vec<Vec2> = states.map(|s| s.position()).collect();
        positions.windows(2).map(|w| (w[1] - w[0]).norm()).sum::<f64>()
    };
    let last = log.iter().rposition(Option::is_some).unwrap();
    let last_speed = log[last].unwrap().speed();
    let missing = (log.len() - 1 - last) as f64 * DT * last_speed;
    let in_log = way(&mut log[CURRENT + r..].iter().flatten().copied()) + missing;
    let rest = (FUTURE - r) as f64 * DT;
    let most = in_log + 2.0 + 0.1 * last_speed * rest;
    let driven = way(&mut response.track[r..].iter().copied());
    let halt = at(r).speed() * at(r).speed() / (2.0 * settings.max_deceleration) + at(r).speed();
    assert!(driven <= most.max(halt) + 0.5, "{name} goes {driven:.1} m, in its log {in_log:.1} m");
    // The path is nowhere further from the logged positions (up to its end) than the shift.
    let logged: Vec<Vec2> = log[CURRENT + r..].iter().flatten().map(AgentState::position).collect();
    let end = logged[logged.len() - 1];
    for k in r + 1..=FUTURE {
        let p = at(k).position();
        let beyond = (p - end).norm() < 1.5 || (end - logged[0]).norm() < (p - logged[0]).norm();
        let aside = logged
            .windows(2)
            .map(|w| {
                let (d, e) = (w[1] - w[0], p - w[0]);
                let t = if d.norm() > 0.0 { (e.dot(&d) / d.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
                (e - d * t).norm()
            })
            .fold((p - logged[0]).norm(), f64::min);
        assert!(beyond || aside <= response.nudge.abs() + 0.3, "{name} is {aside:.2} m aside at step {k}");
    }
}

//! Certificates: that they are found where a driver would find a way, refused where none would, and that what they say is true.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim::curation::{AvoidanceSettings, Certificate, Response, Unavoidable, certify, certify_case};
use reactsim::geometry::{OrientedBox, Polygon, Vec2, direction};
use reactsim::metrics::{Case, Options};
use reactsim::rollout::ScriptedAv;
use reactsim::scene::{
    Agent, AgentKind, AgentState, CURRENT, DT, FUTURE, Frame, LoggedAgent, MapParts, Scenario,
};

use crate::scenes::{agent, car, lane, later, line, real, scene, slot, state, straight};

/// The AV's log as a candidate, changed by `change` (step, logged state).
fn candidate(scenario: &Scenario, change: impl Fn(usize, AgentState) -> AgentState) -> Vec<AgentState> {
    let logged = scenario.logged(0);
    (0..=FUTURE).map(|k| logged[CURRENT + k].unwrap()).enumerate().map(|(k, s)| change(k, s)).collect()
}

/// An AV that brakes along the x axis at `rate` after `delay` seconds.
fn braking(scenario: &Scenario, rate: f64, delay: f64) -> Vec<AgentState> {
    let now = scenario.start.now(0);
    let speed = now.speed();
    candidate(scenario, |k, _| {
        let t = k as f64 * DT;
        let braked = (t - delay).clamp(0.0, speed / rate);
        let way = speed * t.min(delay) + speed * braked - 0.5 * rate * braked * braked;
        let v = direction(now.heading) * if t <= delay { speed } else { speed - rate * braked };
        let p = now.position() + direction(now.heading) * way;
        AgentState { x: p.x, y: p.y, vx: v.x, vy: v.y, ..now }
    })
}

fn found(scenario: &Scenario, av: &[AgentState]) -> Certificate {
    let certificate = certify(scenario, av, &AvoidanceSettings::default())
        .unwrap_or_else(|why| panic!("{}: {why}", scenario.id));
    recheck(scenario, av, &certificate);
    certificate
}

fn refused(scenario: &Scenario, av: &[AgentState]) -> Unavoidable {
    match certify(scenario, av, &AvoidanceSettings::default()) {
        Err(why) => why,
        Ok(certificate) => panic!("{}: {:?}", scenario.id, certificate.peak_deceleration()),
    }
}

/// Distance from a point to a sharp box, negative inside.
fn to_box(p: Vec2, b: &OrientedBox) -> f64 {
    let d = p - b.center;
    let (x, y) = (d.dot(&b.axis).abs() - b.half_length, b.axis.perp(&d).abs() - b.half_width);
    x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0)
}

/// The distance of two rounded boxes (corners are quarter circles of 0.7 times half the shorter side), exact where their cores are
/// apart; where the boxes are far from each other, a lower bound of it.
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
    // Of boxes that are apart a corner of one is nearest. Boxes that cross without a corner in the other are found by points of the sides.
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

/// The box of an agent at a frame.
fn footprint(agent: &Agent, state: Frame) -> Option<OrientedBox> {
    state.map(|s| OrientedBox::new(s.position(), s.heading, agent.length, agent.width))
}

/// The first step at which one who knows the log sees that somebody moves otherwise.
fn visible(logged: &[Frame], moved: &[Frame]) -> Option<usize> {
    (1..=FUTURE).find(|&k| {
        let (Some(was), Some(is)) = (logged[k], moved[k]) else { return false };
        let turned = (is.heading - was.heading + PI).rem_euclid(2.0 * PI) - PI;
        (is.position() - was.position()).norm() > 0.5
            || turned.abs() > 6_f64.to_radians()
            || (is.speed() - was.speed()).abs() > 1.0
    })
}

/// Whether the metrics count overlaps of the two.
fn judged(a: &Agent, b: &Agent) -> bool {
    let on_foot = |x: &Agent| x.kind == AgentKind::Pedestrian;
    let light = |x: &Agent| x.kind != AgentKind::Vehicle;
    !(on_foot(a) && light(b) || on_foot(b) && light(a))
}

/// Two boxes may overlap within 0.2 s of an overlap in the log, and else as little as they do there at most.
fn kept_apart(name: &str, now: [&[Option<OrientedBox>]; 2], logged: [&[Option<OrientedBox>]; 2]) {
    let apart =
        |x: [&[Option<OrientedBox>]; 2], k: usize| Some(distance(x[0][k].as_ref()?, x[1][k].as_ref()?));
    let in_log: Vec<f64> = (0..=FUTURE).map(|k| apart(logged, k).unwrap_or(f64::INFINITY)).collect();
    let closest = in_log.iter().copied().fold(f64::INFINITY, f64::min);
    // What happens between the frames of the log may be a little more.
    let least = if closest < 0.0 { closest.max(-0.2) - 0.02 } else { 0.0 };
    for k in 1..=FUTURE {
        let excused = in_log[k.saturating_sub(2)..=(k + 2).min(FUTURE)].iter().any(|d| *d < 0.0);
        let Some(apart) = apart(now, k).filter(|_| !excused) else { continue };
        assert!(apart >= least - 1e-9, "{name} at step {k}: {apart:.3} m, in the log {closest:.3} m");
    }
}

/// Everything that a certificate promises, measured anew.
fn recheck(scenario: &Scenario, av: &[AgentState], certificate: &Certificate) {
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
        // 0.3 s after what it reacts to is there to be seen: the AV, where that disturbs it, else the response of somebody else.
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

/// The largest speed that the bends of a log allow at a place: for 4 m/s², or 1.1 times what the log drives there.
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

/// The time to collision as the benchmark defines it.
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

/// The bounds of one response: as in the log up to the reaction, then along the logged path with bounded braking and jerk.
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
            // Positions lie on the chords of a path: a little more than the profile's own jerk.
            assert!(jerk.abs() <= settings.max_jerk + 3.0, "{name}: {jerk:.1} m/s3 at step {k}");
        }
        before = Some(a);
        let turns = scenario.start.agents[i].kind != AgentKind::Pedestrian;
        let most = if turns { allowed_there(&log, at(k).position()) } else { f64::INFINITY };
        // Bends are measured between recorded points, the paths of responses between places every half metre.
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
    // Not much further than the log: 2 m, and a tenth of what its last speed covers.
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
    // The path: nowhere further from the logged positions (up to its end) than the shift.
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

fn response<'c>(certificate: &'c Certificate, id: &str) -> &'c Response {
    certificate.responses.iter().find(|r| r.agent == id).unwrap_or_else(|| panic!("no response of `{id}`"))
}

#[test]
fn a_follower_brakes_behind_an_av_that_stops() {
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("follower", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    assert_eq!(certificate.responses.len(), 1);
    let own = response(&certificate, "own");
    assert_eq!(own.nudge, 0.0);
    // 1.2 m/s are lost after 0.4 s, and 0.3 s pass.
    assert_eq!(own.reaction_step, 7);
    assert!((1.5..5.01).contains(&own.peak_deceleration), "{}", own.peak_deceleration);
    assert_eq!(certificate.peak_deceleration(), own.peak_deceleration);
    assert!(own.clearance >= 0.2, "{}", own.clearance);
    assert!(own.track[FUTURE].speed() < 3.0, "{}", own.track[FUTURE].speed());
}

#[test]
fn nobody_responds_to_an_av_that_disturbs_nobody() {
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("undisturbed", agents, straight());
    assert_eq!(found(&scenario, &candidate(&scenario, |_, s| s)), Certificate::default());
}

#[test]
fn a_follower_of_the_follower_brakes_likewise() {
    let agents = vec![
        car("av", 20.0, 0.0, 0.0, 10.0),
        car("first", 4.0, 0.0, 0.0, 10.0),
        car("second", -10.0, 0.0, 0.0, 10.0),
        car("third", -24.0, 0.0, 0.0, 10.0),
    ];
    let scenario = scene("queue", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    let reactions: Vec<usize> =
        ["first", "second", "third"].map(|id| response(&certificate, id).reaction_step).to_vec();
    assert!(reactions[0] <= reactions[1] && reactions[1] <= reactions[2], "{reactions:?}");
}

#[test]
fn who_only_meets_the_braking_leader_reacts_to_that() {
    // The AV stops in the middle of a crossing. Only the first vehicle would get there; the second would end just before.
    let north = |id: &str, y: f64| car(id, 30.0, y, FRAC_PI_2, 10.0);
    let agents = vec![car("av", 0.0, 0.0, 0.0, 10.0), north("first", -71.0), north("second", -85.0)];
    let scenario = scene("second row", agents, straight());
    let av = braking(&scenario, 2.0, 0.5);
    let certificate = found(&scenario, &av);
    let (first, second) = (response(&certificate, "first"), response(&certificate, "second"));
    assert!(second.reaction_step > first.reaction_step, "{} {}", first.reaction_step, second.reaction_step);
}

/// A crossing: the AV drives east and stops in the middle; `own` comes from the south.
fn crossing(gap: f64) -> (Scenario, Vec<AgentState>) {
    let mut map = straight();
    map.lanes.push(lane("north", line((30.0, -150.0), (30.0, 150.0)), Some(15.0)));
    let agents = vec![car("av", 0.0, 0.0, 0.0, 10.0), car("own", 30.0, -gap, FRAC_PI_2, 10.0)];
    let scenario = scene(&format!("crossing from {gap} m"), agents, map);
    let av = braking(&scenario, 2.0, 0.5);
    (scenario, av)
}

#[test]
fn a_crossing_car_yields_or_goes_first() {
    let (scenario, av) = crossing(45.0);
    // It passes after 3.0 s in the log and in the middle of the crossing stands the AV after 5.5 s.
    let end = av[FUTURE].x;
    assert!((27.0..33.0).contains(&end), "the AV stops at {end}");
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.track[FUTURE].y < -1.0 || own.track[FUTURE].y > 5.0);
}

#[test]
fn head_on_there_is_no_way_out() {
    let agents = vec![car("av", 60.0, 3.6, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("head-on", agents, straight());
    // The AV comes over into the lane of the oncoming car and goes on.
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.6 * (1.0 - share * share * (3.0 - 2.0 * share)), ..s }
    });
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. }), "{why}");
    assert!(why.to_string().contains("`own`"), "{why}");
}

#[test]
fn a_cut_in_at_arms_length_is_too_close() {
    let agents = vec![car("av", 8.0, -3.6, 0.0, 15.0), car("own", 0.0, 0.0, 0.0, 15.0)];
    let scenario = scene("cut-in", agents, straight());
    // Within 1 s the AV is before the other car, and 9 m/s slower.
    let now = scenario.start.now(0);
    let mut x = now.x;
    let av = candidate(&scenario, |_, s| s);
    let av: Vec<AgentState> = av
        .iter()
        .enumerate()
        .map(|(k, s)| {
            let share = (k as f64 * DT).min(1.0);
            let speed = 15.0 - 9.0 * share;
            x += if k == 0 { 0.0 } else { speed * DT };
            AgentState { x, y: -3.6 * (1.0 - share), vx: speed, ..*s }
        })
        .collect();
    let why = refused(&scenario, &av);
    assert!(matches!(why, Unavoidable::TooClose { .. } | Unavoidable::TooEarly { .. }), "{why}");
}

#[test]
fn a_conflict_before_anybody_can_react_is_refused() {
    let agents = vec![car("av", 5.3, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let scenario = scene("tailgating", agents, straight());
    let why = refused(&scenario, &braking(&scenario, 6.0, 0.0));
    assert!(matches!(why, Unavoidable::TooEarly { reaction: 5 | 6, .. }), "{why}");
}

#[test]
fn a_nudge_saves_where_braking_can_not() {
    // The oncoming AV reaches half a metre over into the lane of the other, all the way: stopping does not help.
    let agents = vec![car("av", 80.0, 3.2, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    let mut map = straight();
    map.lanes.push(lane("right", line((-150.0, -3.5), (350.0, -3.5)), Some(15.0)));
    let scenario = scene("narrow", agents, map);
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.2 - 1.6 * share * share * (3.0 - 2.0 * share), ..s }
    });
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.nudge < 0.0 && own.nudge >= -1.0, "{}", own.nudge);
    let never = AvoidanceSettings { max_nudge: 0.0, ..AvoidanceSettings::default() };
    assert!(matches!(certify(&scenario, &av, &never), Err(Unavoidable::TooClose { .. })));
}

#[test]
fn a_pedestrian_waits() {
    let walker = agent("walker", AgentKind::Pedestrian, state(30.0, -7.0, FRAC_PI_2, 1.4));
    let scenario = scene("walker", vec![car("av", -30.0, 0.0, 0.0, 14.0), walker], straight());
    // In the log the AV is past before the walker comes; the candidate is slower.
    let av = candidate(&scenario, |k, s| {
        let now = later(&AgentState { x: -30.0, vx: 12.0, ..s }, k as f64 * DT);
        AgentState { x: now.x, vx: 12.0, ..s }
    });
    let certificate = found(&scenario, &av);
    for response in &certificate.responses {
        assert_eq!((response.agent.as_str(), response.nudge), ("walker", 0.0));
    }
}

#[test]
fn a_standing_car_that_is_run_into_can_do_nothing() {
    // The AV comes over and drives into it; or it comes slowly, and there would be time to drive off.
    for (speed, from) in [(10.0, 0.0), (3.0, 24.0)] {
        let agents = vec![car("av", from, 3.6, 0.0, speed), car("own", 40.0, 0.0, 0.0, 0.0)];
        let scenario = scene("standing", agents, straight());
        let av = candidate(&scenario, |k, s| {
            let share = (k as f64 * DT / 2.0).min(1.0);
            AgentState { y: 3.6 * (1.0 - share), ..s }
        });
        let why = refused(&scenario, &av);
        assert!(matches!(why, Unavoidable::Standing { .. }), "{why}");
        assert!(why.to_string().contains("`own`"), "{why}");
    }
}

/// A vehicle along a path: `at` gives position and heading by arc length, `speed` the speed by time; it is at 0 now.
fn along(id: &str, at: impl Fn(f64) -> (Vec2, f64), speed: impl Fn(f64) -> f64) -> LoggedAgent {
    let mut own = car(id, 0.0, 0.0, 0.0, 0.0);
    let mut s = -speed(0.0) * CURRENT as f64 * DT;
    for (f, frame) in own.track.iter_mut().enumerate() {
        let v = speed((f as f64 - CURRENT as f64) * DT);
        s += if f == 0 { 0.0 } else { v * DT };
        let ((p, heading), v) = (at(s), direction(at(s).1) * v);
        *frame = Some(AgentState { x: p.x, y: p.y, heading, vx: v.x, vy: v.y });
    }
    own
}

/// Straight on to the east for 30 m, then a left turn of 8 m radius, and north.
fn bend(s: f64) -> (Vec2, f64) {
    let turned = ((s - 30.0) / 8.0).clamp(0.0, FRAC_PI_2);
    let rest = (s - 30.0 - 8.0 * FRAC_PI_2).max(0.0);
    let corner = Vec2::new(s.min(30.0) + 8.0 * turned.sin(), 8.0 * (1.0 - turned.cos()) + rest);
    (corner, turned)
}

/// The AV's log as a candidate that goes along the x axis from `from` on, at a speed by time.
fn eastward(scenario: &Scenario, from: f64, speed: impl Fn(f64) -> f64) -> Vec<AgentState> {
    let mut x = from;
    let now = scenario.start.now(0);
    candidate(scenario, |_, s| s)
        .iter()
        .enumerate()
        .map(|(k, _)| {
            let v = speed(k as f64 * DT);
            x += if k == 0 { 0.0 } else { v * DT };
            AgentState { x, vx: v, vy: 0.0, ..now }
        })
        .collect()
}

#[test]
fn nobody_escapes_through_a_bend_faster_than_its_tyres_allow() {
    // From 12 to 5 m/s before the bend, and 5 m/s through it. The AV behind it does likewise, but as a candidate goes on at 11 m/s: the
    // quickest way out is to take 8 m of radius at 12 m/s.
    let speed = |t: f64| (12.0 - 2.5 * (t - 0.5).max(0.0)).max(5.0);
    for gap in [12.0, 14.0, 16.0, 18.0, 20.0, 22.0] {
        let av = along("av", |s| (Vec2::new(s - gap, 0.0), 0.0), speed);
        let scenario = scene(&format!("bend {gap}"), vec![av, along("own", bend, speed)], straight());
        let av = eastward(&scenario, -gap, |t| speed(t).max(11.0));
        if let Ok(certificate) = certify(&scenario, &av, &AvoidanceSettings::default()) {
            recheck(&scenario, &av, &certificate);
        }
    }
}

#[test]
fn who_comes_late_to_a_bend_takes_it_slowly_all_the_same() {
    // After the bend it is at 12 m/s again; the AV ahead, which goes straight on, delays it, so that it is in the bend by then.
    let speed = |t: f64| match t < 5.9 {
        true => (12.0 - 2.5 * (t - 0.5).max(0.0)).max(5.0),
        false => (5.0 + 3.5 * (t - 5.9)).min(12.0),
    };
    let agents = vec![car("av", 14.0, 0.0, 0.0, 12.0), along("own", bend, speed)];
    let scenario = scene("late to the bend", agents, straight());
    let braked = |t: f64| (12.0 - 5.0 * t).max(1.0);
    let av =
        eastward(&scenario, 14.0, |t| if t < 3.5 { braked(t) } else { (1.0 + 3.0 * (t - 3.5)).min(12.0) });
    let certificate = found(&scenario, &av);
    let own = response(&certificate, "own");
    assert!(own.track[FUTURE].y > 0.5, "it is in the bend: {}", own.track[FUTURE].y);
}

#[test]
fn who_stops_in_its_log_does_not_drive_on() {
    // Both stop in the log; the candidate does not, and drives into the other from behind. Driving on before it would be a way out.
    let speed = |t: f64| (10.0 - 5.0 / 3.0 * t).max(0.0);
    let at = |s: f64| (Vec2::new(s, 0.0), 0.0);
    let own = along("own", at, speed);
    let av = along("av", |s| (Vec2::new(s - 14.0, 0.0), 0.0), speed);
    let scenario = scene("stopping", vec![av, own], straight());
    let why = refused(&scenario, &eastward(&scenario, -14.0, |t| speed(t).max(6.0)));
    assert!(matches!(why, Unavoidable::TooClose { .. }), "{why}");
}

#[test]
fn one_frame_of_overlap_in_the_log_excuses_that_frame_only() {
    let mut behind = car("behind", -14.0, 0.0, 0.0, 10.0);
    // A slip of the recording: for one frame it is in the other one.
    if let Some(state) = &mut behind.track[CURRENT + 2] {
        state.x += 12.0;
    }
    let agents = vec![car("av", 20.0, 0.0, 0.0, 10.0), car("own", 0.0, 0.0, 0.0, 10.0), behind];
    let scenario = scene("slip", agents, straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    response(&certificate, "behind");
}

/// As in [`a_nudge_saves_where_braking_can_not`], with something more on the map or beside the road.
fn narrow(map: MapParts, beside: Vec<LoggedAgent>) -> (Scenario, Vec<AgentState>) {
    let mut agents = vec![car("av", 80.0, 3.2, PI, 10.0), car("own", 0.0, 0.0, 0.0, 10.0)];
    agents.extend(beside);
    let scenario = scene("narrow", agents, map);
    let av = candidate(&scenario, |k, s| {
        let share = (k as f64 * DT / 1.5).min(1.0);
        AgentState { y: 3.2 - 1.6 * share * share * (3.0 - 2.0 * share), ..s }
    });
    (scenario, av)
}

#[test]
fn a_nudge_keeps_clear_of_what_stands_around() {
    let cone = |i: u8| {
        agent(&format!("cone {i}"), AgentKind::Other, state(20.0 + 6.0 * f64::from(i), -1.45, 0.0, 0.0))
    };
    let (scenario, av) = narrow(straight(), Vec::new());
    assert!(response(&found(&scenario, &av), "own").nudge < 0.0);
    let (scenario, av) = narrow(straight(), (0..8).map(cone).collect());
    assert_eq!(scenario.start.obstacles.len(), 8);
    assert!(matches!(refused(&scenario, &av), Unavoidable::TooClose { .. }));
}

#[test]
fn a_nudge_keeps_its_corners_on_the_road() {
    let ground = |right: f64| {
        let corners = [(-200.0, right), (400.0, right), (400.0, 9.0), (-200.0, 9.0)];
        let exterior = corners.map(|(x, y)| Vec2::new(x, y)).to_vec();
        MapParts { drivable_area: Some(vec![Polygon { exterior, holes: Vec::new() }]), ..straight() }
    };
    let (scenario, av) = narrow(ground(-2.5), Vec::new());
    assert!(response(&found(&scenario, &av), "own").nudge < 0.0);
    // The centre stays on the ground, a corner does not.
    let (scenario, av) = narrow(ground(-1.2), Vec::new());
    assert!(matches!(refused(&scenario, &av), Unavoidable::TooClose { .. }));
}

#[test]
fn a_case_that_is_there_already_gives_the_same_certificate() {
    let (scenario, av) = crossing(45.0);
    let mut tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    tracks[0].truncate(CURRENT + 1);
    tracks[0].extend(av[1..].iter().copied().map(Some));
    let case = Case::of_rollout(&scenario, tracks, Options::default());
    let settings = AvoidanceSettings::default();
    assert_eq!(certify_case(&scenario, &av, &case, &settings).unwrap(), found(&scenario, &av));
    let malformed = certify_case(&scenario, &av[1..], &case, &settings);
    assert_eq!(malformed, Err(Unavoidable::Malformed { found: 80 }));
}

#[test]
fn candidates_of_the_wrong_form_are_refused() {
    let scenario = scene("form", vec![car("av", 0.0, 0.0, 0.0, 10.0)], MapParts::default());
    let mut av = candidate(&scenario, |_, s| s);
    av[7].x = f64::NAN;
    assert_eq!(refused(&scenario, &av), Unavoidable::Malformed { found: 80 });
    assert_eq!(refused(&scenario, &av[..7]), Unavoidable::Malformed { found: 7 });
    assert_eq!(refused(&scenario, &[]), Unavoidable::Malformed { found: 0 });
}

#[test]
fn an_agent_with_gaps_in_its_log_is_no_trouble() {
    let mut own: LoggedAgent = car("own", 0.0, 0.0, 0.0, 10.0);
    for frame in [CURRENT + 3, CURRENT + 7, CURRENT + 20] {
        own.track[frame] = None;
    }
    for frame in CURRENT + 60..own.track.len() {
        own.track[frame] = None;
    }
    let scenario = scene("gaps", vec![car("av", 20.0, 0.0, 0.0, 10.0), own], straight());
    let av = braking(&scenario, 3.0, 0.0);
    let certificate = found(&scenario, &av);
    assert_eq!(response(&certificate, "own").track.len(), FUTURE + 1);
}

#[test]
fn the_same_question_has_the_same_answer() {
    let (scenario, av) = crossing(45.0);
    assert_eq!(found(&scenario, &av), found(&scenario, &av));
}

#[test]
fn certificates_of_real_logs_hold() {
    let scenarios = real(24);
    if scenarios.is_empty() {
        // No data beside the repository.
        return;
    }
    let (mut conflicts, mut certified) = (0, 0);
    for (scenario, script) in scenarios.iter().flat_map(|s| {
        ["brake:3", "retime:0.5", "retime:1.5", "shift:-2", "shift:2"].map(|script| (s, script))
    }) {
        let Ok(av) = ScriptedAv::new(scenario, script.parse().unwrap()) else { continue };
        let track: Vec<AgentState> =
            std::iter::once(scenario.start.now(0)).chain(av.track().iter().copied()).collect();
        let certificate = certify(scenario, &track, &AvoidanceSettings::default());
        if let Ok(certificate) = &certificate {
            recheck(scenario, &track, certificate);
        }
        let responds = certificate.as_ref().map_or(0, |c| c.responses.len());
        // Whoever only brakes leaves the others a way out.
        if script == "brake:3" && (certificate.is_err() || responds > 0) {
            conflicts += 1;
            certified += usize::from(certificate.is_ok());
        }
    }
    assert!(certified * 10 >= conflicts * 8, "{certified} of {conflicts} are certified");
    assert!(certified > 3, "{certified} certificates");
}

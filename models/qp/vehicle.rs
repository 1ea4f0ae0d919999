//! The plan of one vehicle: for each of its modes a path and the speed along it, until one is kept clear.

use reactsim::dynamics::{Ability, Moving, Pose, Tracker};
use reactsim::geometry::{OrientedBox, direction};
use reactsim::scene::{DT, Road};

use super::bends::{Bends, Course};
use super::drive::drive;
use super::ending::{Ending, Endings};
use super::mode::{Mode, Wish};
use super::obstacle::{Extent, Obstacle, Span, TIMES, spans, step_of};
use super::program::Solve;
use super::rows::{Rows, excess};
use super::settings::Settings;
use super::sides::{road_end, sides};
use super::speed::{STEPS, Speeds, Wanted, hardest_braking};
use super::way::Way;

/// A vehicle that is to be planned.
pub(super) struct Subject<'a> {
    pub(super) now: Moving,
    /// How far the rear axle lies behind the box centre, metres.
    pub(super) rear: f64,
    /// Half of length and width.
    pub(super) extent: Extent,
    /// Curvature of its way now, 1/m; `None` for one that stands or crawls.
    pub(super) curvature: Option<f64>,
    /// The ground, for those who are on the drivable part of it.
    pub(super) road: Option<Road<'a>>,
}

/// What was found for one mode.
struct Attempt {
    moves: Vec<Moving>,
    way: Way,
    solve: Solve,
    /// How far it goes into what is in the way, metres.
    excess: f64,
    spans: Vec<[Option<Span>; TIMES]>,
}

/// Plans vehicles, one after another.
pub(super) struct Planner {
    pub(super) settings: Settings,
    speeds: Speeds,
    bends: Bends,
    tracker: Tracker,
    pub(super) endings: Endings,
}

/// Who is slower and wants to go less far than this stands, m/s and metres.
pub(super) const STANDS: (f64, f64) = (0.1, 0.15);
/// Who is slower may turn the wheel as it likes, m/s.
const DECIDES_TO_REVERSE: f64 = 0.6;
/// Comfortable accelerations, m/s²: across, and along before bends and the end of the road.
const COMFORTABLE: (f64, f64) = (4.0, 2.5);
const AT_ROAD_END: f64 = 4.0;

impl Planner {
    /// `None` where the solver refuses the programs, which a test excludes.
    pub(super) fn new(settings: &Settings) -> Option<Self> {
        Some(Self {
            settings: settings.clone(),
            speeds: Speeds::new(settings)?,
            bends: Bends::new(settings)?,
            tracker: Tracker::new(Ability::of_vehicle(0.0)),
            endings: Endings::default(),
        })
    }

    /// How a vehicle moves in the next steps. `modes` are valid, the most probable ones first, and at least one.
    pub(super) fn plan(
        &mut self,
        subject: &Subject<'_>,
        modes: &[Mode],
        obstacles: &[&Obstacle],
    ) -> Vec<Moving> {
        let now = subject.now.pose.position;
        let axis = direction(subject.now.pose.heading);
        let end = modes[0].centres(now)[STEPS - 1] - now;
        if subject.now.speed.abs() < STANDS.0 && end.norm() < STANDS.1 {
            self.endings.count(Ending::Standing);
            return vec![Moving { speed: 0.0, acceleration: 0.0, ..subject.now }; STEPS];
        }
        let back = subject.now.speed < -DECIDES_TO_REVERSE
            || subject.now.speed < DECIDES_TO_REVERSE && end.dot(&axis) < -0.7 * end.norm();
        if back {
            self.endings.count(Ending::Backwards);
            return self.follow_backwards(subject, &modes[0], obstacles);
        }
        let subject = &Subject { now: Moving { speed: subject.now.speed.abs(), ..subject.now }, ..*subject };
        let mut best: Option<(Attempt, usize)> = None;
        for (i, mode) in modes.iter().enumerate() {
            let Some(attempt) = self.attempt(subject, mode, obstacles) else { continue };
            let clear = attempt.excess <= self.settings.low_slack && attempt.solve != Solve::Failed;
            if clear {
                let ending = if i == 0 { Ending::of(attempt.solve) } else { Ending::OtherMode };
                self.endings.count(ending);
                return attempt.moves;
            }
            if best.as_ref().is_none_or(|(b, _)| attempt.excess < b.excess - 0.1) {
                best = Some((attempt, i));
            }
        }
        let Some((attempt, _)) = best else {
            self.endings.count(Ending::Braking);
            return self.brake(subject, &straight(subject));
        };
        let braked = self.brake(subject, &attempt.way);
        let excess = excess(&subject.now, &braked, &attempt.spans);
        if attempt.solve == Solve::Failed || excess < attempt.excess - 0.2 {
            self.endings.count(Ending::Braking);
            return braked;
        }
        self.endings.count(Ending::HighSlack);
        attempt.moves
    }

    /// As hard as it can along a path.
    fn brake(&self, subject: &Subject<'_>, way: &Way) -> Vec<Moving> {
        let mut a = self.speeds.going_on(subject.now.speed, subject.now.acceleration);
        let accelerations = [(); STEPS].map(|()| {
            a = (a - self.settings.jerk * DT).max(-self.settings.acceleration);
            a
        });
        drive(subject.now, subject.rear, way, &accelerations, &self.settings)
    }

    /// Follows a wish that goes backwards; halts where somebody is in the way.
    fn follow_backwards(
        &mut self,
        subject: &Subject<'_>,
        mode: &Mode,
        obstacles: &[&Obstacle],
    ) -> Vec<Moving> {
        let heading = subject.now.pose.heading;
        let poses: Vec<Pose> = mode
            .centres(subject.now.pose.position)
            .into_iter()
            .map(|position| Pose { position, heading })
            .collect();
        let ability = Ability {
            acceleration: self.settings.acceleration,
            curvature: self.settings.curvature,
            jerk: self.settings.jerk,
            rear: subject.rear,
        };
        self.tracker.set_ability(ability);
        let mut moves = Vec::with_capacity(STEPS);
        self.tracker.track(subject.now, &poses, &mut moves);
        let footprint = |pose: Pose| {
            let Extent { length, width } = subject.extent;
            OrientedBox::new(pose.position, pose.heading, 2.0 * length, 2.0 * width)
        };
        let hits = |time: usize, pose: Pose| {
            let mine = footprint(pose);
            obstacles.iter().any(|o| {
                let b = &o.boxes[time];
                (b.center - mine.center).norm() < b.radius() + mine.radius() && b.separation(&mine) < 0.3
            })
        };
        let meets = (1..TIMES).any(|t| hits(t, moves[step_of(t) - 1].pose));
        if meets && !hits(0, subject.now.pose) {
            let still = vec![subject.now.pose; STEPS];
            self.tracker.track(subject.now, &still, &mut moves);
        }
        moves
    }

    /// A path and the speed along it for one mode; `None` for one that is no line.
    fn attempt(&mut self, subject: &Subject<'_>, mode: &Mode, obstacles: &[&Obstacle]) -> Option<Attempt> {
        let settings = self.settings.clone();
        let Moving { pose, speed, acceleration } = subject.now;
        let wish = Wish::new(mode, pose.position);
        let guide = wish.guide(pose.position, direction(pose.heading), subject.rear)?;
        let stop = speed * speed / (2.0 * settings.acceleration) + 0.3 * speed;
        let reach = (wish.arc[STEPS - 1].max(stop) + 2.0).clamp(6.0, 300.0);
        let sigma = wish.sigma_along(reach);
        let course = Course {
            from: pose,
            rear: subject.rear,
            curvature: subject.curvature,
            speed,
            guide: &guide,
            reach,
            sigma: &sigma,
        };
        let laid = self.bends.lay(&course, |way| sides(way, subject, &wish, obstacles, &settings));
        self.endings.programs += laid.programs + 1;
        for iterations in &laid.iterations {
            *self.endings.iterations.entry(*iterations).or_default() += 1;
        }
        let way = laid.way;
        let braking = hardest_braking(speed, self.speeds.going_on(speed, acceleration), &settings);
        let mut rows = Rows::new(braking);
        let mut wanted = wish.along(&way);
        slow_down_for_bends(&mut wanted, speed, &way);
        if let Some(end) = subject.road.and_then(|road| road_end(&way, road))
            && end < speed * speed / (2.0 * AT_ROAD_END) + 0.7 * speed + 1.0
        {
            rows.stop_at(end - 0.3);
        }
        let mut all = Vec::new();
        for obstacle in obstacles {
            let found = spans(&way, subject.extent, obstacle, obstacle.side);
            if rows.keep_clear(subject, obstacle, &found, &wanted, &settings) {
                all.push(found);
            }
        }
        rows.cap(&mut wanted);
        let problem = Wanted {
            speed,
            acceleration,
            way: &wanted,
            sigma: wish.along.as_ref(),
            ahead: &rows.ahead,
            answers: &rows.answers,
        };
        let (found, accelerations) = self.speeds.solve(&problem);
        if found.iterations > 0 {
            *self.endings.iterations.entry(found.iterations).or_default() += 1;
        }
        for solve in [laid.solve, found.solve] {
            self.endings.failed += u64::from(solve == Solve::Failed);
        }
        let moves = drive(subject.now, subject.rear, &way, &accelerations, &settings);
        let excess = excess(&subject.now, &moves, &all);
        // A path on which the solver gave up is that of the round before: it can be driven.
        let laid = if laid.solve == Solve::Failed { Solve::AlmostSolved } else { laid.solve };
        Some(Attempt { moves, way, solve: found.solve.max(laid), excess, spans: all })
    }
}

/// Straight on.
fn straight(subject: &Subject<'_>) -> Way {
    Way::drive(subject.now.pose, subject.rear, 1.0, &[0.0; super::way::STATIONS + 1])
}

/// Makes a wish slower where the path's bends ask for it.
fn slow_down_for_bends(wanted: &mut [f64; STEPS], speed: f64, way: &Way) {
    let fastest = wanted.windows(2).map(|w| (w[1] - w[0]) / DT).fold(speed, f64::max);
    let sharpest = way.stations.iter().map(|s| s.curvature.abs()).fold(0.0, f64::max);
    if fastest * fastest * sharpest <= COMFORTABLE.0 {
        return;
    }
    let mut allowed = way.stations.map(|s| (COMFORTABLE.0 / s.curvature.abs().max(1e-6)).sqrt());
    for j in (0..allowed.len() - 1).rev() {
        let length = way.stations[j + 1].arc - way.stations[j].arc;
        let before = (allowed[j + 1] * allowed[j + 1] + 2.0 * COMFORTABLE.1 * length).sqrt();
        allowed[j] = allowed[j].min(before);
    }
    let (mut arc, mut wish_before) = (0.0, 0.0);
    for w in wanted.iter_mut() {
        let (j, t) = way.locate(arc);
        let most = allowed[j] + (allowed[j + 1] - allowed[j]) * t.clamp(0.0, 1.0);
        let step = (*w - wish_before).min(most * DT);
        wish_before = *w;
        arc += step.max(0.0);
        *w = arc;
    }
}

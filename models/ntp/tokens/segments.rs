//! Recorded motions of half a second, from which vocabularies are built.

use reactsim_geometry::wrap;
use reactsim_nn::learning::{Reservoir, ScenarioDigest, for_each_track};
use reactsim_nn::perception::Class;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{AgentKind, Frame, Scenario};

use super::{ORIGIN, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, motion_between};

/// Minimum number of recorded frames of an agent (CATK).
const MIN_FRAMES: usize = 30;
/// Heading change per frame from which a motion counts as a recording fault, radians (TrajTok: 30
/// degrees).
const HEADING_JUMP: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// Resolution at which motions count as the same, in metres and radians. Without it parked cars would
/// make up most motions.
const MOTION_RESOLUTION: f64 = 1.0 / 512.0;

/// Distinct motions of half a second per class, each in the frame of its first pose.
///
/// If a class has more motions than can be kept, they are a random sample in which every motion is
/// equally likely.
#[derive(Debug)]
pub struct Segments {
    seed: u64,
    classes: [Reservoir<TokenPoses>; 3],
    pub(super) scenarios: ScenarioDigest,
}

impl Segments {
    /// Builds an empty collection that keeps at most `most` motions of every class. CATK keeps 204 800.
    pub fn new(most: usize, seed: u64) -> Self {
        let sample = |class: Class| Reservoir::new(most, seed, &format!("vocabulary/segments/{class}"));
        Self { seed, classes: Class::ALL.map(sample), scenarios: ScenarioDigest::default() }
    }

    /// Adds the motions of all agents of a scenario, including those that are not simulated: one from
    /// every fifth frame on, if all six frames are recorded.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios.add(scenario);
        for_each_track(scenario, |kind, track| self.add_track(kind, track));
    }

    /// Adds the motions of one track.
    pub fn add_track(&mut self, kind: AgentKind, track: &[Frame]) {
        let Some(class) = Class::of(kind) else { return };
        if track.iter().flatten().count() < MIN_FRAMES {
            return;
        }
        for start in (0..track.len()).step_by(TOKEN_FRAMES) {
            if let Some(motion) = track.get(start..=start + TOKEN_FRAMES).and_then(segment) {
                self.add_motion(class, motion);
            }
        }
    }

    /// Adds a motion unless the same one was added before.
    pub fn add_motion(&mut self, class: Class, motion: TokenPoses) {
        let values = motion.into_iter().flat_map(|p| [p.position.x, p.position.y, p.heading]);
        self.classes[class.index()].add(motion, values, MOTION_RESOLUTION);
    }

    /// Returns the motions of a class that are kept.
    pub fn of(&self, class: Class) -> &[TokenPoses] {
        &self.classes[class.index()].kept
    }

    /// Returns the number of distinct motions of a class that were seen, kept or not.
    pub fn seen(&self, class: Class) -> u64 {
        self.classes[class.index()].seen
    }

    /// Returns the seed of the samples.
    pub fn seed(&self) -> u64 {
        self.seed
    }
}

/// Returns the motion of six frames; `None` if one is missing or the heading jumps.
fn segment(frames: &[Frame]) -> Option<TokenPoses> {
    let mut world = [ORIGIN; TOKEN_POSES];
    for (pose, frame) in world.iter_mut().zip(frames) {
        let state = frame.filter(|s| s.is_finite())?;
        *pose = Pose::from(state);
    }
    let jumps = world.windows(2).any(|w| wrap(w[1].heading - w[0].heading).abs() >= HEADING_JUMP);
    (!jumps).then(|| world.map(|pose| motion_between(world[0], pose)))
}

//! Recorded motions of half a second: what vocabularies are built of.

use reactsim::dynamics::Pose;
use reactsim::geometry::wrap;
use reactsim::scene::{AgentKind, Frame, Scenario};

use super::{Class, ORIGIN, TOKEN_FRAMES, TOKEN_POSES, TokenPoses, motion_between};
use crate::models::learning::Reservoir;

/// Agents with fewer recorded frames are left out (CATK).
const LEAST_FRAMES: usize = 30;
/// Headings that turn by so much in a frame are faults of the recording, radians (TrajTok: 30 degrees).
const JUMP: f64 = 30.0 * std::f64::consts::PI / 180.0;
/// Motions that agree to so much in all values are one (metres, radians): parked cars would be most of all motions.
const SAME: f64 = 1.0 / 512.0;

/// Motions of half a second per class, each in the frame of its first pose, and no two the same.
///
/// Of a class with more than can be kept, a sample is kept: every motion that was seen is in it as likely as any other.
#[derive(Debug)]
pub struct Segments {
    seed: u64,
    classes: [Reservoir<TokenPoses>; 3],
    scenarios: u64,
    digest: blake3::Hasher,
}

impl Segments {
    /// No motions yet; at most so many will be kept of every class. CATK keeps 204 800.
    pub fn new(most: usize, seed: u64) -> Self {
        let sample = |class: Class| Reservoir::new(most, seed, &format!("vocabulary/segments/{class}"));
        Self { seed, classes: Class::ALL.map(sample), scenarios: 0, digest: blake3::Hasher::new() }
    }

    /// Adds the motions of all agents of a scenario, those that are not simulated too: from every fifth frame on, where all six frames
    /// are recorded.
    pub fn add(&mut self, scenario: &Scenario) {
        self.scenarios += 1;
        self.digest.update(scenario.digest().as_bytes());
        for (i, agent) in scenario.start.agents.iter().enumerate() {
            self.add_track(agent.kind, &scenario.logged(i));
        }
        for other in &scenario.unselected {
            self.add_track(other.agent.kind, &other.track);
        }
    }

    /// Adds the motions of one track.
    pub fn add_track(&mut self, kind: AgentKind, track: &[Frame]) {
        let Some(class) = Class::of(kind) else { return };
        if track.iter().flatten().count() < LEAST_FRAMES {
            return;
        }
        for start in (0..track.len()).step_by(TOKEN_FRAMES) {
            if let Some(motion) = track.get(start..=start + TOKEN_FRAMES).and_then(segment) {
                self.add_motion(class, motion);
            }
        }
    }

    /// Adds a motion, unless it is there already.
    pub fn add_motion(&mut self, class: Class, motion: TokenPoses) {
        let values = motion.into_iter().flat_map(|p| [p.position.x, p.position.y, p.heading]);
        self.classes[class.index()].add(motion, values, SAME);
    }

    /// The motions of a class.
    pub fn of(&self, class: Class) -> &[TokenPoses] {
        &self.classes[class.index()].kept
    }

    /// How many different motions of a class there were, kept or not.
    pub fn seen(&self, class: Class) -> u64 {
        self.classes[class.index()].seen
    }

    /// Scenarios that were added.
    pub fn scenarios(&self) -> u64 {
        self.scenarios
    }

    /// BLAKE3 digest over the digests of the scenarios in their order, as 64 hexadecimal digits; empty where none was added.
    pub fn digest(&self) -> String {
        if self.scenarios == 0 { String::new() } else { self.digest.finalize().to_hex().to_string() }
    }

    /// Seed of the samples.
    pub fn seed(&self) -> u64 {
        self.seed
    }
}

/// The motion of six frames; `None` where one is missing, or the heading jumps.
fn segment(frames: &[Frame]) -> Option<TokenPoses> {
    let mut world = [ORIGIN; TOKEN_POSES];
    for (pose, frame) in world.iter_mut().zip(frames) {
        let state = frame.filter(|s| s.is_finite())?;
        *pose = Pose::from(state);
    }
    let jumps = world.windows(2).any(|w| wrap(w[1].heading - w[0].heading).abs() >= JUMP);
    (!jumps).then(|| world.map(|pose| motion_between(world[0], pose)))
}

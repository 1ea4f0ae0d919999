//! Input: the elements of a scene, and how they lie to each other.

use reactsim_geometry::{Vec2, direction, into_frame, wrap};

use super::pairs::{Motion, Pairs};

/// Relation of an element to itself.
const OWN: [f32; 3] = [0.01; 3];

/// Returns the number of numbers of a relation.
pub(super) const fn relation_size(of_motion: bool) -> usize {
    if of_motion { 7 } else { 3 }
}

/// Returns the number of numbers of an agent.
pub(super) const fn agent_size(with_motion_of_av: bool) -> usize {
    if with_motion_of_av { 7 } else { 5 }
}

/// A piece of a map line.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// x, y (m) and heading (rad) of its points; as many for all lines of a scene.
    pub points: Vec<[f64; 3]>,
    /// State of the light at its first point, 0 to 7.
    pub light: usize,
    /// Type, 0 (none) to 20.
    pub kind: usize,
}

/// A scene at the current frame. Absent elements are zeros. With `zeros_are_absent`, as in the public code,
/// an element whose x is exactly 0 is taken for absent, and a coordinate that is exactly 0 stays 0 in the
/// element's own frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneInput {
    /// x, y (m), heading (rad), velocity x, y (m/s), length, width, height (m).
    pub agents: Vec<[f64; 8]>,
    /// Types: 0 absent, 1 vehicle, 2 pedestrian, 3 cyclist.
    pub kinds: Vec<usize>,
    /// Pieces of map lines.
    pub lines: Vec<Line>,
    /// x, y (m) of lights and their states, 0 to 7.
    pub lights: Vec<([f64; 2], usize)>,
    /// Latest acceleration (m/s²) and yaw rate (rad/s) of the AV, the first agent.
    pub av_motion: [f64; 2],
}

impl SceneInput {
    /// Returns the number of elements.
    pub fn len(&self) -> usize {
        self.agents.len() + self.lines.len() + self.lights.len()
    }

    /// Returns whether there are no elements.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns, by agent, velocity in its own frame and size: `[agents, 5]`, m/s and m. With `of_av`,
    /// `[agents, 7]`: also the latest acceleration and yaw rate of the AV, m/s² and rad/s, and 0 for others.
    pub(super) fn agent_features(&self, zeros_are_absent: bool, of_av: bool) -> Vec<f32> {
        let features = |(i, agent): (usize, &[f64; 8])| {
            let [_, _, yaw, vx, vy, length, width, height] = *agent;
            let own = into_frame(direction(yaw), Vec2::new(vx, vy));
            let local = |global: f64, own: f64| if zeros_are_absent && global == 0.0 { 0.0 } else { own };
            let seen = [local(vx, own.x), local(vy, own.y), length, width, height];
            let motion = if i == 0 { self.av_motion } else { [0.0; 2] };
            seen.into_iter().chain(motion).take(agent_size(of_av)).map(|v| v as f32)
        };
        self.agents.iter().enumerate().flat_map(features).collect()
    }

    /// Returns, by line, then point, the pose in the frame of the line's first point: `[lines * points, 3]`.
    pub(super) fn line_features(&self, zeros_are_absent: bool) -> Vec<f32> {
        let features = |line: &Line| {
            let [x0, y0, yaw0] = line.points.first().copied().unwrap_or_default();
            let local = move |[x, y, yaw]: [f64; 3]| {
                let own = into_frame(direction(yaw0), Vec2::new(x - x0, y - y0));
                let absent = |global: f64| zeros_are_absent && global == 0.0;
                let there = |global: f64, own: f64| if absent(global) { 0.0 } else { own as f32 };
                [there(x, own.x), there(y, own.y), there(yaw, wrap(yaw - yaw0))]
            };
            line.points.clone().into_iter().flat_map(local)
        };
        self.lines.iter().flat_map(features).collect()
    }

    /// Returns the position (m) and the heading (rad; `None` for a light) of each element.
    fn places(&self) -> (Vec<[f64; 2]>, Vec<Option<f64>>) {
        let agents = self.agents.iter().map(|a| ([a[0], a[1]], Some(a[2])));
        let lines = self.lines.iter().map(|line| {
            let [x, y, yaw] = line.points.first().copied().unwrap_or_default();
            ([x, y], Some(yaw))
        });
        let lights = self.lights.iter().map(|(at, _)| (*at, None));
        agents.chain(lines).chain(lights).unzip()
    }

    /// Lets each of the first `own` elements see those of the first `among` that come nearest to it, at most
    /// `limit`.
    pub(super) fn nearest(&self, own: usize, among: usize, limit: usize, zeros_are_absent: bool) -> Pairs {
        Pairs::nearest(&self.motions(zeros_are_absent), own, among, limit)
    }

    /// Returns the motion of each element.
    fn motions(&self, zeros_are_absent: bool) -> Vec<Motion> {
        let velocities = self.agents.iter().map(|a| Vec2::new(a[3], a[4]));
        let velocities = velocities.chain(std::iter::repeat(Vec2::new(0.0, 0.0)));
        let present = self.present(zeros_are_absent);
        let motion = |((at, velocity), present): (([f64; 2], Vec2), bool)| Motion {
            at: Vec2::new(at[0], at[1]),
            velocity,
            present,
        };
        self.places().0.into_iter().zip(velocities).zip(present).map(motion).collect()
    }

    /// Returns the relations of these pairs, `[own * each, 3]`: position of the first less that of the second
    /// in the frame of the first (m), and the difference of headings (rad), 0 with a light. With `of_motion`,
    /// `[own * each, 7]`: also the difference of velocities in this frame (m/s), and when the two come nearest
    /// within 3 s (s) and how near (m), if they keep their velocities.
    pub(super) fn relations(&self, pairs: &Pairs, zeros_are_absent: bool, of_motion: bool) -> Vec<f32> {
        let (positions, headings) = self.places();
        let motions = self.motions(zeros_are_absent);
        let present = |i: usize| motions[i].present;
        let mut relations = Vec::with_capacity(relation_size(of_motion) * pairs.own * pairs.each);
        for i in 0..pairs.own {
            let (from, yaw) = (positions[i], headings[i]);
            let axis = direction(yaw.unwrap_or(0.0));
            for j in pairs.of(i) {
                let (to, other) = (positions[j], headings[j]);
                let zero = zeros_are_absent && (from[0] == 0.0 || to[0] == 0.0);
                let seen = !zero && (zeros_are_absent || present(i) && present(j));
                if !seen {
                    relations.extend([0.0; 3]);
                } else if i == j {
                    relations.extend(OWN);
                } else {
                    let apart = into_frame(axis, Vec2::new(from[0] - to[0], from[1] - to[1]));
                    let turn = yaw.zip(other).map_or(0.0, |(yaw, other)| wrap(yaw - other));
                    relations.extend([apart.x, apart.y, turn].map(|v| v as f32));
                }
                if of_motion && seen {
                    let pace = into_frame(axis, motions[i].velocity - motions[j].velocity);
                    let (when, near) = motions[i].meeting(&motions[j]);
                    relations.extend([pace.x, pace.y, when, near].map(|v| v as f32));
                } else if of_motion {
                    relations.extend([0.0; 4]);
                }
            }
        }
        relations
    }

    /// Returns by element whether it is there.
    pub(super) fn present(&self, zeros_are_absent: bool) -> Vec<bool> {
        let agents = self.kinds.iter().map(|kind| *kind != 0);
        let first = |line: &Line| line.points.first().is_some_and(|p| p[0] != 0.0);
        let lines = self.lines.iter().map(|line| if zeros_are_absent { first(line) } else { line.kind != 0 });
        let lights = self.lights.iter().map(|(at, _)| !zeros_are_absent || at[0] != 0.0);
        agents.chain(lines).chain(lights).collect()
    }
}

//! Images around agents.

use reactsim_geometry::{OrientedBox, Vec2, direction, into_frame, left};
use reactsim_nn::perception::SceneView;
use reactsim_scene::AgentState;

use super::fill::fill;
use super::ground::Ground;
use crate::ctg::Sight;

/// Share of an image behind its agent.
const SHARE_BEHIND: f64 = 0.25;

/// Draws the image of an agent in this state: `[pixels, pixels, frames + MAP_LAYERS]`, by row (from right to
/// left of the agent), then column (from behind it to ahead). Per frame of the history, the latest first,
/// there are 1 where the agent's box is, -1 where those of others are; then the layers of the map, 0 or 1.
pub(crate) fn image(
    view: &SceneView<'_>,
    slot: usize,
    state: &AgentState,
    ground: &Ground,
    sight: &Sight,
) -> Vec<f32> {
    let frame = ImageFrame::of(state, sight);
    let (pixels, channels) = (sight.pixels, sight.channels());
    let mut image = vec![0.0f32; pixels * pixels * channels];
    for (channel, ago) in sight.history().enumerate() {
        let mut draw = |other: usize, value: f32| {
            let Some(then) = view.now.checked_sub(ago) else { return };
            let Some(state) = view.tracks[other].get(then).copied().flatten() else { return };
            let hull = state.footprint(&view.agents[other]);
            frame.draw(&hull, |pixel| image[pixel * channels + channel] = value);
        };
        (0..view.agents.len()).filter(|other| *other != slot).for_each(|other| draw(other, -1.0));
        draw(slot, 1.0);
    }
    for row in 0..pixels {
        for column in 0..pixels {
            let at = ground.layers(frame.place(column, row));
            let first = (row * pixels + column) * channels + sight.frames;
            for (cell, is_there) in image[first..].iter_mut().zip(at) {
                *cell = f32::from(is_there);
            }
        }
    }
    image
}

/// Position, direction and scale of an image.
struct ImageFrame {
    origin: Vec2,
    axis: Vec2,
    pixels: usize,
    /// Edge of a pixel, metres.
    pixel: f64,
}

impl ImageFrame {
    fn of(state: &AgentState, sight: &Sight) -> Self {
        let Sight { pixels, pixel, .. } = *sight;
        Self { origin: state.position(), axis: direction(state.heading), pixels, pixel }
    }

    /// Returns the position of the agent in pixels.
    fn offset(&self) -> Vec2 {
        Vec2::new(SHARE_BEHIND, 0.5) * self.pixels as f64
    }

    /// Returns the place of the centre of a pixel, metres.
    fn place(&self, column: usize, row: usize) -> Vec2 {
        let local = (Vec2::new(column as f64 + 0.5, row as f64 + 0.5) - self.offset()) * self.pixel;
        self.origin + self.axis * local.x + left(self.axis) * local.y
    }

    /// Visits the pixels of a box: those whose centres lie in it, and that of its own centre, however small
    /// it is.
    fn draw(&self, hull: &OrientedBox, mut visit: impl FnMut(usize)) {
        let to_pixels = |p: Vec2| into_frame(self.axis, p - self.origin) / self.pixel + self.offset();
        let center = to_pixels(hull.center);
        let (reach, edge) = (hull.radius() / self.pixel, self.pixels as f64);
        if center.x < -reach || center.y < -reach || center.x > edge + reach || center.y > edge + reach {
            return;
        }
        let ring = hull.corners().map(to_pixels).to_vec();
        fill(&[ring], self.pixels, |column, row| visit(row * self.pixels + column));
        if (0.0..edge).contains(&center.x) && (0.0..edge).contains(&center.y) {
            visit(center.y as usize * self.pixels + center.x as usize);
        }
    }
}

#[cfg(test)]
mod tests {
    use reactsim_scene::{Agent, AgentKind, Frame};

    use super::super::shapes::GroundShapes;
    use super::*;

    #[test]
    fn images_show_histories_and_the_ground() {
        let sight = Sight { pixels: 16, pixel: 1.0, frames: 2, radius: 30.0 };
        let agent =
            |width| Agent { id: "a".to_owned(), kind: AgentKind::Vehicle, length: 2.0 * width, width };
        // The agent heads for +y and has moved 2 m; the other one, to its right, has just appeared.
        let at = |x: f64, y: f64| AgentState { x, y, heading: std::f64::consts::FRAC_PI_2, vx: 0.0, vy: 2.0 };
        let own: Vec<Frame> = (0..11).map(|k| Some(at(0.5, 0.2 * f64::from(k)))).collect();
        let mut other = vec![None; 10];
        other.push(Some(at(3.5, 2.5)));
        let (agents, tracks) = (vec![agent(1.0), agent(0.5)], [own, other]);
        let view = SceneView {
            agents: &agents,
            tracks: &tracks,
            now: 10,
            first: 0,
            av_next: None,
            lights: &[],
            start: None,
            heights: None,
        };
        let shapes = GroundShapes::road(Vec2::new(-20.0, -20.0), Vec2::new(2.0, 20.0));
        let image = image(&view, 0, &at(0.5, 2.0), &Ground::of(&shapes, 30.0), &sight);
        let value = |row: usize, column: usize, channel: usize| image[(row * 16 + column) * 5 + channel];
        // Columns begin 4 m behind the agent, rows 8 m to its right.
        assert_eq!([value(8, 4, 0), value(8, 2, 0), value(8, 4, 1), value(8, 2, 1)], [1.0, 0.0, 0.0, 1.0]);
        assert_eq!([value(5, 4, 0), value(5, 4, 1), value(11, 4, 0)], [-1.0, 0.0, 0.0]);
        // The road ends 1.5 m to the right of the agent.
        assert_eq!([value(7, 9, 2), value(6, 9, 2), value(12, 9, 2)], [1.0, 0.0, 1.0]);
        assert!((0..256).all(|pixel| image[pixel * 5 + 3..pixel * 5 + 5] == [0.0, 0.0]));
    }

    #[test]
    fn boxes_lie_where_they_are_seen_from_the_agent() {
        let sight = Sight { pixels: 8, pixel: 2.0, ..Sight::default() };
        let state = AgentState { x: 5.0, y: 5.0, heading: std::f64::consts::FRAC_PI_2, vx: 0.0, vy: 0.0 };
        let frame = ImageFrame::of(&state, &sight);
        let drawn = |x: f64, y: f64, length: f64| {
            let mut found = Vec::new();
            frame.draw(&OrientedBox::new(Vec2::new(x, y), 0.0, length, length), |pixel| found.push(pixel));
            found.sort_unstable();
            found.dedup();
            found
        };
        // Four metres behind the agent the image begins; it heads for larger columns.
        assert!((frame.place(2, 4) - Vec2::new(4.0, 6.0)).norm() < 1e-9);
        assert_eq!(drawn(4.0, 6.0, 0.1), [4 * 8 + 2]);
        assert_eq!(drawn(4.0, 6.0, 2.1), [4 * 8 + 2]);
        assert_eq!(drawn(5.0, 7.0, 4.2), [3 * 8 + 2, 3 * 8 + 3, 4 * 8 + 2, 4 * 8 + 3]);
        assert!(drawn(5.0, -5.0, 4.0).is_empty());
    }
}

//! Maps that can be transformed together with a scene.

use reactsim_geometry::Vec2;

use crate::perception::{KnownMap, PieceKind};

/// Map data of a network that can be transformed together with a scene.
pub trait LearningMap {
    /// Applies `flip` to every point; it swaps left and right.
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2);

    /// Multiplies all distances and speeds by `factor`.
    fn stretch(&mut self, factor: f64);
}

impl LearningMap for KnownMap {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        for piece in &mut self.pieces {
            piece.points = piece.points.map(flip);
            // Road edges have the road on their left.
            if matches!(piece.kind, PieceKind::EdgeBoundary | PieceKind::EdgeMedian) {
                piece.points.reverse();
            }
        }
        for stop in &mut self.stops {
            (stop.at, stop.ahead) = (flip(stop.at), flip(stop.ahead));
        }
    }

    fn stretch(&mut self, factor: f64) {
        for piece in &mut self.pieces {
            piece.points = piece.points.map(|p| p * factor);
            piece.length *= factor;
            piece.speed_limit = piece.speed_limit.map(|v| v * factor);
        }
        for stop in &mut self.stops {
            stop.at *= factor;
        }
    }
}

impl<T: LearningMap> LearningMap for Vec<T> {
    fn mirror(&mut self, flip: fn(Vec2) -> Vec2) {
        self.iter_mut().for_each(|part| part.mirror(flip));
    }

    fn stretch(&mut self, factor: f64) {
        self.iter_mut().for_each(|part| part.stretch(factor));
    }
}

//! Pieces of the map for our own network.

use reactsim::geometry::Vec2;
use reactsim::models::ntp::tokens::curve_pieces;

use super::building::scenarios;
use reactsim::models::perception::{PieceKind, map_pieces};

#[test]
fn pieces_are_even_joined_and_near() {
    for scenario in scenarios() {
        let map = &scenario.start.map;
        let near = map_pieces(map, Vec2::zeros(), 60.0);
        let all = map_pieces(map, Vec2::zeros(), 1e5);
        assert!(
            near.len() < all.len() && near.len() > 20,
            "{}: {} of {}",
            scenario.id,
            near.len(),
            all.len()
        );
        assert!(near.iter().all(|p| all.contains(p)));
        for piece in &all {
            assert!(piece.length > 0.0 && piece.length <= 5.5 + 1e-9, "{piece:?}");
            let chords = piece.points.windows(2).map(|w| (w[1] - w[0]).norm());
            assert!(chords.clone().all(|c| c <= piece.length / 10.0 + 1e-9), "{piece:?}");
            assert!(!piece.kind.is_lane() || piece.lane.is_some());
        }
        let length: f64 = all.iter().filter(|p| p.kind.is_lane()).map(|p| p.length).sum();
        let lanes: f64 = map.lanes.iter().map(|l| l.baseline.length()).sum();
        assert!((length - lanes).abs() < 1e-6 * lanes, "{length} {lanes}");
        // The road is on the left of its edges.
        let edges = all.iter().filter(|p| matches!(p.kind, PieceKind::EdgeBoundary | PieceKind::EdgeMedian));
        let (mut right, mut count) = (0, 0);
        for edge in edges {
            let (a, b) = (edge.points[5], edge.points[6]);
            let along = (b - a).normalize();
            let beside = (a + b) / 2.0 + Vec2::new(-along.y, along.x) * 0.05;
            count += 1;
            right += usize::from(scenario.start.road().drivable(beside, &mut None) != Some(true));
        }
        assert!(count > 10 && right * 50 <= count, "{}: {right} of {count}", scenario.id);
    }
}

#[test]
fn maps_of_few_points_have_curves_too() {
    for scenario in scenarios() {
        let pieces = curve_pieces(&scenario.start);
        let lanes: f64 = scenario.start.map.lanes.iter().map(|l| l.baseline.length()).sum();
        let of_lanes = pieces.iter().filter(|p| p.kind.line_code() == 0).count() as f64;
        assert!(of_lanes > 0.8 * lanes / 5.0, "{}: {of_lanes} pieces of {lanes} m", scenario.id);
        assert!(pieces.iter().all(|p| (3..=11).contains(&p.points.len())));
    }
}

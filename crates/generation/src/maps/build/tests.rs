//! Test of a two-way road with all features, as a layout.

use reactsim_geometry::Vec2;
use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{LaneArea, LaneClass, RoadEdgeKind};

use super::*;

fn road() -> Road {
    let side = Side {
        lanes: 2,
        lane_width: 3.3,
        bike: Some(1.5),
        parking: Some(2.6),
        shoulder: 0.5,
        pavement: Some(Pavement { verge: 1.0, width: 2.0 }),
    };
    let section = Section {
        class: LaneClass::SurfaceStreet,
        speed: mph(30.0),
        forward: side,
        backward: Some(Side { lanes: 1, ..side }),
        median: Median { width: 0.2, shoulder: 0.5, raised: false },
    };
    let bend = Piece::bend(0.9, 70.0, 0.5);
    let path = Path::new(&[&[Piece::straight(60.0)], &bend[..], &[Piece::straight(60.0)]].concat());
    let middle = 0.5 * path.length();
    Road::new(path.placed(middle, Vec2::zeros(), 0.4), section)
}

#[test]
fn a_road_becomes_a_layout() {
    let road = road();
    let mut b = MapBuilder::new();
    let end = road.path.length();
    let first = road.lay(&mut b, "a", 0.0, 80.0, (true, false));
    let second = road.lay(&mut b, "b", 80.0, end, (false, true));
    first.link(&mut b, &second);
    let mut rng = stream(0, "road", 0, Purpose::Map);
    road.parking(&mut b, &mut rng, Direction::Forward, 0.0, end);
    let layout = b.finish();
    let map = &layout.map;
    assert_eq!(map.lanes.len(), 10);
    let ground = map.drivable_area.as_ref().unwrap();
    assert_eq!((ground.len(), ground[0].holes.len()), (1, 0));
    // One edge per side, open at both ends.
    assert_eq!(map.road_edges.len(), 2);
    assert!(map.road_edges.iter().all(|e| e.kind == RoadEdgeKind::Boundary));
    for lane in &map.lanes {
        let LaneArea::Polygon(ring) = &lane.area else { panic!("no outline") };
        for p in ring.iter().chain(&lane.points) {
            assert!(ground[0].contains(*p));
            assert_eq!(*p, on_grid(*p));
        }
        assert!(area(ring) > 0.0);
    }
    let lane = |id: &str| map.lanes.iter().find(|l| l.id == id).unwrap();
    assert_eq!(lane("a-f1").points.last(), lane("b-f1").points.first());
    assert_eq!(lane("b-b0").points.last(), lane("a-b0").points.first());
    assert_eq!(lane("b-f0").right[0].lane, "b-f1");
    assert_eq!(lane("b-f0").points.len(), lane("b-f1").points.len());
    let spots = &layout.parking;
    assert!(spots.len() > 15 && spots.iter().all(|p| p.length >= 5.0 && (p.width - 2.0).abs() < 1e-9));
    assert!(spots.iter().all(|s| ground[0].contains(s.position)));
    assert_eq!(layout.footways.len(), 4);
}

#[test]
fn a_raised_median_parts_the_ground() {
    let mut road = road();
    road.section.median = Median { width: 3.0, shoulder: 0.5, raised: true };
    let mut b = MapBuilder::new();
    road.lay(&mut b, "a", 0.0, road.path.length(), (true, true));
    assert_eq!(b.finish().map.drivable_area.unwrap().len(), 2);
}

#[test]
fn a_connector_joins_lanes() {
    let mut b = MapBuilder::new();
    let spec = |id: &str| Spec::lane(id, LaneClass::SurfaceStreet, 10.0);
    let from = b.lane(spec("in"), vec![Vec2::new(-20.0, 0.0), Vec2::zeros()], 1.6, 0.0, 0.0);
    let up = std::f64::consts::FRAC_PI_2;
    let to = b.lane(spec("out"), vec![Vec2::new(12.0, 12.0), Vec2::new(12.0, 40.0)], 1.8, up, up);
    let (lane, radius) = b.connect(Spec::connector("turn", LaneClass::SurfaceStreet, 7.0), from, to);
    assert!(radius > MIN_TURN_RADIUS && b.half_width(lane) == 1.6);
    assert_eq!(b.lanes_across(&[Vec2::new(4.0, 5.0), Vec2::new(4.0, -5.0)]), [lane]);
    let map = b.finish().map;
    let turn = &map.lanes[2];
    assert_eq!(
        (turn.predecessors.as_slice(), turn.successors.as_slice()),
        (&["in".into()][..], &["out".into()][..])
    );
    assert_eq!(map.lanes[0].successors, ["turn"]);
    assert_eq!(map.lanes[1].predecessors, ["turn"]);
}

//! Projection and geometry blobs.

use reactsim_test_support::shared;
use std::collections::BTreeMap;

use reactsim_geometry::Vec2;

use super::super::utm::Utm;
use super::super::wkb::{Geometry, parse};

#[test]
fn projection_agrees_with_another_program_to_a_micrometre() {
    let Some(samples) = shared("data/nuplan") else { return };
    let text = std::fs::read_to_string(samples.join("expected/projection.json")).unwrap();
    let zones: BTreeMap<String, Vec<[f64; 4]>> = serde_json::from_str(&text).unwrap();
    assert_eq!(zones.len(), 4);
    for (zone, points) in zones {
        let utm = Utm::of_epsg(zone.strip_prefix("epsg:").unwrap().parse().unwrap()).unwrap();
        for [longitude, latitude, x, y] in points {
            let p = utm.project(longitude, latitude).unwrap();
            assert!((p - Vec2::new(x, y)).norm() < 1.5e-6, "{zone} {longitude} {latitude}: {p}");
        }
    }
}

/// Checks the meridian arc from the equator to 45 degrees and a point off the meridian, from textbooks
/// (Snyder, USGS 1395, p. 269, for the Clarke ellipsoid; here for WGS 84: 4 984 944.378 m times 0.9996).
#[test]
fn projection_of_known_points() {
    let utm = Utm::of_epsg(32_631).unwrap();
    let on = utm.project(3.0, 45.0).unwrap();
    assert!((on - Vec2::new(500_000.0, 4_984_944.378 * 0.9996)).norm() < 1e-3, "{on}");
    assert_eq!(utm.project(3.0, 0.0).unwrap(), Vec2::new(500_000.0, 0.0));
    let (east, west) = (utm.project(4.5, 45.0).unwrap(), utm.project(1.5, 45.0).unwrap());
    assert!((east.x - 500_000.0 + west.x - 500_000.0).abs() < 1e-8 && east.y == west.y);
    for (longitude, latitude) in
        [(f64::NAN, 1.0), (3.0, f64::INFINITY), (45.0, 3.0), (3.0, -1.0), (500_000.0, 4e6)]
    {
        assert_eq!(utm.project(longitude, latitude), None);
    }
    assert!([4326, 32_600, 32_661, 32_701, i64::MIN].iter().all(|code| Utm::of_epsg(*code).is_none()));
}

fn blob(wkb: &[u8]) -> Vec<u8> {
    [b"GP\0\x01\xe6\x10\0\0".as_slice(), wkb].concat()
}

fn points(points: &[(f64, f64)]) -> Vec<u8> {
    points.iter().flat_map(|(x, y)| [x.to_le_bytes(), y.to_le_bytes()].concat()).collect()
}

fn read(blob: &[u8]) -> Result<Geometry, String> {
    parse(blob, &|x, y| (x.is_finite() && y.is_finite()).then(|| Vec2::new(x, y)))
}

#[test]
fn blobs_of_all_kinds() {
    let pair = points(&[(1.0, 2.0), (3.0, 4.0)]);
    let line = Geometry::Lines(vec![vec![Vec2::new(1.0, 2.0), Vec2::new(3.0, 4.0)]]);
    let plain = [b"\x01\x02\0\0\0\x02\0\0\0".as_slice(), &pair].concat();
    assert_eq!(read(&blob(&plain)).unwrap(), line);
    let multi = [b"\x01\x05\0\0\0\x01\0\0\0".as_slice(), &plain].concat();
    assert_eq!(read(&blob(&multi)).unwrap(), line);
    // With z coordinate, in both encodings.
    let high = points(&[(1.0, 2.0), (9.0, 3.0), (4.0, 9.0)]);
    for code in [1002_u32, 0x8000_0002] {
        let code = code.to_le_bytes();
        let wkb = [b"\x01".as_slice(), &code, b"\x02\0\0\0", &high].concat();
        assert_eq!(read(&blob(&wkb)).unwrap(), line);
    }
    // Big-endian, with an envelope.
    let big: Vec<u8> = [1.0_f64, 2.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    let wkb = [b"\x00\0\0\0\x01".as_slice(), &big].concat();
    let with_envelope = [b"GP\0\x03\xe6\x10\0\0".as_slice(), &[0; 32], &wkb].concat();
    assert_eq!(read(&with_envelope).unwrap(), Geometry::Point(Vec2::new(1.0, 2.0)));
}

#[test]
fn bad_blobs_are_refused() {
    let pair = points(&[(1.0, 2.0), (3.0, 4.0)]);
    let line = [b"\x01\x02\0\0\0\x02\0\0\0".as_slice(), &pair].concat();
    let whole = blob(&line);
    for end in 0..whole.len() {
        assert!(read(&whole[..end]).is_err(), "cut to {end} bytes");
    }
    let refused = |blob: &[u8]| read(blob).unwrap_err();
    assert!(refused(&[whole.clone(), vec![0]].concat()).contains("too many"));
    assert!(refused(b"GP\x01\x01\0\0\0\0").contains("version 1"));
    assert!(refused(b"GP\0\x11\0\0\0\0").contains("empty"));
    assert!(refused(b"GP\0\x0b\0\0\0\0").contains("envelope"));
    assert!(refused(&blob(b"\x01\x02\0\0\0\xff\xff\xff\xff")).contains("claims 4294967295 parts"));
    assert!(refused(&blob(b"\x01\x03\0\0\0\0\0\0\0")).contains("without rings"));
    assert!(refused(&blob(b"\x01\x07\0\0\0\0\0\0\0")).contains("type 7"));
    assert!(refused(&blob(b"\x07\x07\0\0\0\0\0\0\0")).contains("byte order"));
    let infinite = [b"\x01\x01\0\0\0".as_slice(), &points(&[(f64::INFINITY, 0.0)])].concat();
    assert!(refused(&blob(&infinite)).contains("inf"));
    // Collections do not nest.
    let mut nested = line;
    for _ in 0..3 {
        nested = [b"\x01\x05\0\0\0\x01\0\0\0".as_slice(), &nested].concat();
    }
    assert!(refused(&blob(&nested)).contains("type 5"));
}

//! GeoPackage geometry: a header, then well-known binary (OGC 12-128, clause 2.1.3; OGC 06-103, clause 8).

use crate::geometry::{Polygon, Vec2};

/// What a blob holds. Rings are closed, as stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Geometry {
    /// A point.
    Point(Vec2),
    /// Lines; several in a multi-line.
    Lines(Vec<Vec<Vec2>>),
    /// Polygons; several in a multi-polygon.
    Polygons(Vec<Polygon>),
}

/// Reads a blob; `place` turns each stored pair into a point of the map.
///
/// # Errors
/// A text that says what is wrong with the blob.
pub(super) fn parse(blob: &[u8], place: &dyn Fn(f64, f64) -> Option<Vec2>) -> Result<Geometry, String> {
    let [b'G', b'P', version, flags, ..] = *blob else {
        return Err("does not begin with `GP`".into());
    };
    if version != 0 {
        return Err(format!("has version {version} of the geometry header instead of 0"));
    }
    if flags & 0x10 != 0 {
        return Err("is empty".into());
    }
    let envelope = match (flags >> 1) & 7 {
        0 => 0,
        1 => 32,
        2 | 3 => 48,
        4 => 64,
        other => return Err(format!("has an envelope of the unknown kind {other}")),
    };
    let rest = blob.get(8 + envelope..).ok_or("ends inside its header")?;
    let mut bytes = Bytes { rest, little: true, place };
    let geometry = bytes.geometry(0)?;
    if bytes.rest.is_empty() { Ok(geometry) } else { Err(format!("has {} bytes too many", bytes.rest.len())) }
}

/// What is left of a blob.
struct Bytes<'a> {
    rest: &'a [u8],
    little: bool,
    place: &'a dyn Fn(f64, f64) -> Option<Vec2>,
}

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (first, rest) = self.rest.split_first_chunk().ok_or("ends too early")?;
        self.rest = rest;
        let mut first: [u8; N] = *first;
        if !self.little {
            first.reverse();
        }
        Ok(first)
    }

    /// A number of things of at least `size` bytes each: never more than the blob can hold.
    fn count(&mut self, size: usize) -> Result<usize, String> {
        let count = u32::from_le_bytes(self.take()?) as usize;
        if count > self.rest.len() / size {
            return Err(format!("claims {count} parts in its last {} bytes", self.rest.len()));
        }
        Ok(count)
    }

    fn geometry(&mut self, depth: u32) -> Result<Geometry, String> {
        self.little = match self.take::<1>()? {
            [0] => false,
            [1] => true,
            [other] => return Err(format!("has the unknown byte order {other}")),
        };
        let code = u32::from_le_bytes(self.take()?);
        let (extended, plain) = (code & 0xe000_0000, code & 0x1fff_ffff);
        if extended & 0x2000_0000 != 0 {
            self.take::<4>()?;
        }
        // Height and measure are told by the thousands or by the highest bits; both are passed over.
        let more = match plain / 1000 {
            0 => u32::from(extended & 0x8000_0000 != 0) + u32::from(extended & 0x4000_0000 != 0),
            1 | 2 => 1,
            3 => 2,
            _ => return Err(format!("holds a geometry of the unknown type {code}")),
        };
        match plain % 1000 {
            1 => Ok(Geometry::Point(self.point(more)?)),
            2 => Ok(Geometry::Lines(vec![self.points(more, 2)?])),
            3 => {
                let rings = self.count(4)?;
                let exterior = match rings {
                    0 => return Err("is a polygon without rings".into()),
                    _ => self.points(more, 4)?,
                };
                let holes = (1..rings).map(|_| self.points(more, 4)).collect::<Result<_, _>>()?;
                Ok(Geometry::Polygons(vec![Polygon { exterior, holes }]))
            }
            5 | 6 if depth == 0 => {
                let (mut lines, mut polygons) = (Vec::new(), Vec::new());
                for _ in 0..self.count(9)? {
                    match self.geometry(1)? {
                        Geometry::Lines(more) => lines.extend(more),
                        Geometry::Polygons(more) => polygons.extend(more),
                        Geometry::Point(_) => return Err("holds a point among lines or polygons".into()),
                    }
                }
                match (lines.is_empty(), polygons.is_empty()) {
                    (false, true) => Ok(Geometry::Lines(lines)),
                    (true, false) => Ok(Geometry::Polygons(polygons)),
                    _ => Err("holds nothing, or lines and polygons at once".into()),
                }
            }
            other => Err(format!("holds a geometry of type {other} instead of a point, lines or polygons")),
        }
    }

    fn points(&mut self, more: u32, fewest: usize) -> Result<Vec<Vec2>, String> {
        let count = self.count(16 + 8 * more as usize)?;
        if count < fewest {
            return Err(format!("has a line or ring of {count} points instead of at least {fewest}"));
        }
        (0..count).map(|_| self.point(more)).collect()
    }

    fn point(&mut self, more: u32) -> Result<Vec2, String> {
        let (x, y) = (f64::from_le_bytes(self.take()?), f64::from_le_bytes(self.take()?));
        for _ in 0..more {
            self.take::<8>()?;
        }
        (self.place)(x, y)
            .ok_or_else(|| format!("has the point ({x}, {y}), which is outside of the map's zone"))
    }
}

//! GeoPackage geometry: a header, then well-known binary (OGC 12-128, clause 2.1.3; OGC 06-103, clause 8).

use reactsim_geometry::{Polygon, Vec2};

/// Geometry of a blob. Rings are closed, as stored.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Geometry {
    Point(Vec2),
    /// Lines; several in a multi-line.
    Lines(Vec<Vec<Vec2>>),
    /// Polygons; several in a multi-polygon.
    Polygons(Vec<Polygon>),
}

/// Parses a blob; `place` converts each stored pair of coordinates to a point of the map.
///
/// # Errors
/// A description of the defect, to be appended to "a blob that".
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
    let mut reader = BlobReader { rest, little: true, place };
    let geometry = reader.geometry(0)?;
    if reader.rest.is_empty() {
        Ok(geometry)
    } else {
        Err(format!("has {} bytes too many", reader.rest.len()))
    }
}

struct BlobReader<'a> {
    rest: &'a [u8],
    little: bool,
    place: &'a dyn Fn(f64, f64) -> Option<Vec2>,
}

impl BlobReader<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (first, rest) = self.rest.split_first_chunk().ok_or("ends too early")?;
        self.rest = rest;
        let mut first: [u8; N] = *first;
        if !self.little {
            first.reverse();
        }
        Ok(first)
    }

    /// Reads a number of elements of at least `size` bytes each, which the rest of the blob must be able to
    /// hold.
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
        // Z and M coordinates are indicated by the thousands or by the highest bits; both are skipped.
        let extra = match plain / 1000 {
            0 => u32::from(extended & 0x8000_0000 != 0) + u32::from(extended & 0x4000_0000 != 0),
            1 | 2 => 1,
            3 => 2,
            _ => return Err(format!("holds a geometry of the unknown type {code}")),
        };
        match plain % 1000 {
            1 => Ok(Geometry::Point(self.point(extra)?)),
            2 => Ok(Geometry::Lines(vec![self.points(extra, 2)?])),
            3 => {
                let rings = self.count(4)?;
                let exterior = match rings {
                    0 => return Err("is a polygon without rings".into()),
                    _ => self.points(extra, 4)?,
                };
                let holes = (1..rings).map(|_| self.points(extra, 4)).collect::<Result<_, _>>()?;
                Ok(Geometry::Polygons(vec![Polygon { exterior, holes }]))
            }
            5 | 6 if depth == 0 => {
                let (mut lines, mut polygons) = (Vec::new(), Vec::new());
                for _ in 0..self.count(9)? {
                    match self.geometry(1)? {
                        Geometry::Lines(part) => lines.extend(part),
                        Geometry::Polygons(part) => polygons.extend(part),
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

    fn points(&mut self, extra: u32, min_count: usize) -> Result<Vec<Vec2>, String> {
        let count = self.count(16 + 8 * extra as usize)?;
        if count < min_count {
            return Err(format!("has a line or ring of {count} points instead of at least {min_count}"));
        }
        (0..count).map(|_| self.point(extra)).collect()
    }

    fn point(&mut self, extra: u32) -> Result<Vec2, String> {
        let (x, y) = (f64::from_le_bytes(self.take()?), f64::from_le_bytes(self.take()?));
        for _ in 0..extra {
            self.take::<8>()?;
        }
        (self.place)(x, y)
            .ok_or_else(|| format!("has the point ({x}, {y}), which is outside of the map's zone"))
    }
}

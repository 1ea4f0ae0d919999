//! Clipping of lines and rings to a rectangle, and simplification.

use reactsim_geometry::{Bounds, Vec2, point_segment};

/// Returns the parts of a line within a rectangle (Liang and Barsky, 1984).
pub(super) fn line(points: &[Vec2], within: &Bounds) -> Vec<Vec<Vec2>> {
    let mut parts: Vec<Vec<Vec2>> = Vec::new();
    let mut open = false;
    for pair in points.windows(2) {
        let Some((a, b, cut)) = segment(pair[0], pair[1], within) else {
            open = false;
            continue;
        };
        match parts.last_mut() {
            Some(part) if open => part.push(b),
            _ => parts.push(vec![a, b]),
        }
        open = !cut;
    }
    parts
}

/// Returns the part of a segment within a rectangle, and whether its end was cut off.
fn segment(a: Vec2, b: Vec2, within: &Bounds) -> Option<(Vec2, Vec2, bool)> {
    let d = b - a;
    let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
    for (from, step, low, high) in
        [(a.x, d.x, within.min.x, within.max.x), (a.y, d.y, within.min.y, within.max.y)]
    {
        if step == 0.0 {
            if from < low || from > high {
                return None;
            }
        } else {
            let (s, t) = ((low - from) / step, (high - from) / step);
            enter = enter.max(s.min(t));
            leave = leave.min(s.max(t));
        }
    }
    (enter <= leave).then(|| (a + d * enter, a + d * leave, leave < 1.0))
}

/// Returns the part of a ring within a rectangle (Sutherland and Hodgman, 1974); empty if they are
/// disjoint.
pub(super) fn ring(points: &[Vec2], within: &Bounds) -> Vec<Vec2> {
    let mut ring = points.to_vec();
    for side in 0..4 {
        let depth = |p: Vec2| match side {
            0 => p.x - within.min.x,
            1 => within.max.x - p.x,
            2 => p.y - within.min.y,
            _ => within.max.y - p.y,
        };
        let mut kept = Vec::with_capacity(ring.len() + 4);
        for (i, &p) in ring.iter().enumerate() {
            let before = ring[(i + ring.len() - 1) % ring.len()];
            let (d0, d1) = (depth(before), depth(p));
            if (d0 < 0.0) != (d1 < 0.0) {
                kept.push(before + (p - before) * (d0 / (d0 - d1)));
            }
            if d1 >= 0.0 {
                kept.push(p);
            }
        }
        ring = kept;
    }
    if ring.len() < 3 { Vec::new() } else { ring }
}

/// Simplifies a line, within `tolerance` of the original (Douglas and Peucker, 1973).
pub(super) fn thin(points: &[Vec2], tolerance: f64) -> Vec<Vec2> {
    if points.len() < 3 {
        return points.to_vec();
    }
    let mut keep = vec![false; points.len()];
    (keep[0], keep[points.len() - 1]) = (true, true);
    let mut todo = vec![(0, points.len() - 1)];
    while let Some((first, last)) = todo.pop() {
        let (mut far, mut at) = (tolerance * tolerance, None);
        for i in first + 1..last {
            let (d2, _) = point_segment(points[i], points[first], points[last]);
            if d2 > far {
                (far, at) = (d2, Some(i));
            }
        }
        if let Some(i) = at {
            keep[i] = true;
            todo.extend([(first, i), (i, last)]);
        }
    }
    points.iter().zip(keep).filter_map(|(p, keep)| keep.then_some(*p)).collect()
}

/// Returns the parts of a segment inside a ring as pairs of entry and exit points.
pub(super) fn inside(a: Vec2, b: Vec2, ring: &[Vec2]) -> Vec<(Vec2, Vec2)> {
    let d = b - a;
    let mut cuts: Vec<f64> = Vec::new();
    for (i, &p) in ring.iter().enumerate() {
        let q = ring[(i + 1) % ring.len()];
        let (sp, sq) = (d.perp(&(p - a)), d.perp(&(q - a)));
        if (sp < 0.0) != (sq < 0.0) {
            let hit = p + (q - p) * (sp / (sp - sq));
            cuts.push((hit - a).dot(&d) / d.norm_squared());
        }
    }
    cuts.sort_by(f64::total_cmp);
    cuts.chunks_exact(2).map(|c| (a + d * c[0], a + d * c[1])).collect()
}

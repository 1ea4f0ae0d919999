//! Signed distance of evaluated objects to the nearest other object. Boxes have rounded corners; heights are
//! ignored.

use reactsim_scene::FUTURE;

use super::footprint::RoundedBox;
use super::gap::signed_distance;
use super::objects::Motion;

/// Distance in metres where an object is invalid or alone.
pub(super) const NO_PARTNER_DISTANCE: f32 = 1e10;
/// Bounds of a distance are widened by this much, in metres, so that rounding cannot exclude the nearest
/// object.
const BOUND_SLACK: f32 = 1e-3;
/// Bounds are also widened by this share of the distance and of the coordinates, whose rounding moves
/// corners.
const RELATIVE_SLACK: f32 = 1e-6;

/// Computes the signed distances of an evaluated object at the steps 1 to 80, in metres; negative if boxes
/// overlap.
///
/// Exact distances are computed only for objects that can be the nearest one by their inner and outer
/// circles.
pub(super) fn distances(motion: &Motion, boxes: &[RoundedBox], object: usize) -> [f32; FUTURE] {
    let (own, own_box) = (&motion.futures[object], &boxes[object]);
    let partners = || (0..boxes.len()).filter(|&other| other != object);
    // Distances between centres, and the smallest upper bound over all partners.
    let mut centers = vec![[f32::INFINITY; FUTURE]; boxes.len()];
    let mut nearest = [f32::INFINITY; FUTURE];
    let slack: [f32; FUTURE] =
        std::array::from_fn(|k| BOUND_SLACK + RELATIVE_SLACK * (own.x[k].abs() + own.y[k].abs()));
    for other in partners() {
        let (theirs, centers) = (&motion.futures[other], &mut centers[other]);
        for (k, center) in centers.iter_mut().enumerate() {
            let (dx, dy) = (theirs.x[k] - own.x[k], theirs.y[k] - own.y[k]);
            *center = (dx * dx + dy * dy).sqrt();
        }
        if !motion.is_all_valid() {
            for (k, center) in centers.iter_mut().enumerate() {
                *center = if motion.is_valid(other, k) { *center } else { f32::INFINITY };
            }
        }
        let radii = own_box.inner_radius + boxes[other].inner_radius;
        for k in 0..FUTURE {
            nearest[k] = nearest[k].min(centers[k] * (1.0 + RELATIVE_SLACK) - radii + slack[k]);
        }
    }
    let mut own_corners = [None; FUTURE];
    let mut distances = [f64::INFINITY; FUTURE];
    for other in partners() {
        let (theirs, their_box) = (&motion.futures[other], &boxes[other]);
        let radii = own_box.outer_radius + their_box.outer_radius;
        for k in 0..FUTURE {
            let bound = centers[other][k] * (1.0 - RELATIVE_SLACK) - radii - slack[k];
            // Not finite where the partner is invalid.
            if !(bound <= nearest[k]) || bound == f32::INFINITY {
                continue;
            }
            let corners = own_corners[k]
                .get_or_insert_with(|| own_box.core_corners([own.x[k], own.y[k]], own.heading[k]));
            let their_corners = their_box.core_corners([theirs.x[k], theirs.y[k]], theirs.heading[k]);
            let core = signed_distance(corners, &their_corners);
            let distance = core - f64::from(own_box.radius) - f64::from(their_box.radius);
            if distance < distances[k] {
                distances[k] = distance;
                nearest[k] = nearest[k].min(distance as f32 + slack[k]);
            }
        }
    }
    let mut result = [NO_PARTNER_DISTANCE; FUTURE];
    for (k, result) in result.iter_mut().enumerate() {
        if distances[k].is_finite() && motion.is_valid(object, k) {
            *result = distances[k] as f32;
        }
    }
    result
}

/// Returns the signed distances as [`distances`] does, without bounds.
#[cfg(test)]
pub(super) fn distances_to_all(motion: &Motion, boxes: &[RoundedBox], object: usize) -> [f32; FUTURE] {
    let corners = |i: usize, k: usize| {
        let future = &motion.futures[i];
        boxes[i].core_corners([future.x[k], future.y[k]], future.heading[k])
    };
    std::array::from_fn(|k| {
        let partners = (0..boxes.len()).filter(|&other| other != object && motion.is_valid(other, k));
        let distance = |other: usize| {
            let core = signed_distance(&corners(object, k), &corners(other, k));
            core - f64::from(boxes[object].radius) - f64::from(boxes[other].radius)
        };
        let nearest = partners.map(distance).min_by(f64::total_cmp);
        nearest.filter(|_| motion.is_valid(object, k)).map_or(NO_PARTNER_DISTANCE, |d| d as f32)
    })
}

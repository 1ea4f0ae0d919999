//! Lanes: baselines, links between them, and the removal of lanes without extent.

use std::collections::{BTreeSet, HashMap};

use reactsim_geometry::Polyline;

use super::checks::Builder;
use crate::{Lane, LaneArea, LaneNeighbor, LaneParts, NeighborParts, SceneError, levels};

/// Maximum number of link comparisons while lanes without extent are removed; real maps have few such lanes.
const MAX_LINK_COMPARISONS: usize = 50_000_000;

/// Indices of lanes by id.
pub(super) type LaneIndex = HashMap<String, usize>;

impl Builder {
    /// Checks and shifts lanes, and resolves their links.
    pub(super) fn lanes(
        &mut self,
        mut parts: Vec<LaneParts>,
        heights: &mut Vec<Vec<f64>>,
    ) -> Result<(Vec<Lane>, LaneIndex), SceneError> {
        let mut seen = BTreeSet::new();
        for (i, lane) in parts.iter().enumerate() {
            let field = || format!("map.lanes[{i}].id");
            self.check_new_name(&mut seen, field, &lane.id, "an id that no other lane has")?;
        }
        let mut baselines = Vec::with_capacity(parts.len());
        let (mut kept_heights, mut without_extent) = (Vec::new(), BTreeSet::new());
        for (i, lane) in parts.iter_mut().enumerate() {
            self.shift_points(&mut lane.points, || format!("map.lanes[{i}].points"))?;
            if let Ok(line) = Polyline::new(&lane.points) {
                baselines.push(line);
                kept_heights.extend(heights.get(i).map(|h| levels::of_polyline(&lane.points, h)));
            } else {
                without_extent.insert(lane.id.clone());
            }
        }
        *heights = kept_heights;
        self.splice(&mut parts, |id| !without_extent.contains(id))?;
        let index: LaneIndex = parts.iter().enumerate().map(|(i, l)| (l.id.clone(), i)).collect();
        let mut lanes = Vec::with_capacity(parts.len());
        for (i, (lane, baseline)) in parts.into_iter().zip(baselines).enumerate() {
            lanes.push(self.lane(i, lane, baseline, &index)?);
        }
        Ok((lanes, index))
    }

    fn lane(
        &mut self,
        i: usize,
        lane: LaneParts,
        baseline: Polyline,
        index: &LaneIndex,
    ) -> Result<Lane, SceneError> {
        let mut area = lane.area;
        match &mut area {
            LaneArea::Polygon(ring) => self.shift_points(ring, || format!("map.lanes[{i}].polygon"))?,
            LaneArea::Corridor { half_width } if half_width.is_finite() && *half_width > 0.0 => {}
            LaneArea::Corridor { half_width } => {
                let field = format!("map.lanes[{i}].half_width");
                return Err(self.error(field, half_width, "a finite positive width"));
            }
        }
        if let Some(limit) = lane.speed_limit.filter(|v| !(v.is_finite() && *v > 0.0)) {
            let field = format!("map.lanes[{i}].speed_limit");
            return Err(self.error(field, limit, "a positive speed or none"));
        }
        let by_id = |id: &String| index.get(id).copied();
        let neighbor = |n: &NeighborParts| {
            Some(LaneNeighbor {
                lane: by_id(&n.lane)?,
                self_start: n.self_start,
                self_end: n.self_end,
                other_start: n.other_start,
                other_end: n.other_end,
            })
        };
        Ok(Lane {
            id: lane.id,
            kind: lane.kind,
            class: lane.class,
            speed_limit: lane.speed_limit,
            baseline,
            area,
            successors: self.resolve(&lane.successors, by_id),
            predecessors: self.resolve(&lane.predecessors, by_id),
            left: self.resolve(&lane.left, neighbor),
            right: self.resolve(&lane.right, neighbor),
        })
    }

    /// Converts links; links to missing lanes are dropped and counted.
    fn resolve<L, T>(&mut self, links: &[L], convert: impl Fn(&L) -> Option<T>) -> Vec<T> {
        let found: Vec<T> = links.iter().filter_map(convert).collect();
        for _ in found.len()..links.len() {
            self.repaired("links to missing lanes");
        }
        found
    }

    /// Removes lanes without extent and joins the lanes that they linked, so that the graph stays connected.
    fn splice(&mut self, lanes: &mut Vec<LaneParts>, keep: impl Fn(&str) -> bool) -> Result<(), SceneError> {
        let mut comparisons_left = MAX_LINK_COMPARISONS;
        while let Some(i) = lanes.iter().position(|l| !keep(&l.id)) {
            let gone = lanes.remove(i);
            self.repaired("lanes without extent");
            for lane in lanes.iter_mut() {
                let compared = 1
                    + comparisons(&lane.successors, &gone.id, &gone.successors)
                    + comparisons(&lane.predecessors, &gone.id, &gone.predecessors)
                    + lane.left.len()
                    + lane.right.len();
                let Some(rest) = comparisons_left.checked_sub(compared) else {
                    let found = "too many lanes without extent, or links through them".to_owned();
                    return Err(self.error("map.lanes".into(), found, "lanes of two points or more"));
                };
                comparisons_left = rest;
                join(&mut lane.successors, &gone.id, &gone.successors, &lane.id);
                join(&mut lane.predecessors, &gone.id, &gone.predecessors, &lane.id);
                lane.left.retain(|n| n.lane != gone.id);
                lane.right.retain(|n| n.lane != gone.id);
            }
        }
        Ok(())
    }
}

/// Returns the approximate number of comparisons that [`join`] makes.
fn comparisons(links: &[String], gone: &str, replacements: &[String]) -> usize {
    if !links.iter().any(|l| l == gone) {
        return links.len();
    }
    (replacements.len() + 1).saturating_mul(links.len() + replacements.len()).min(usize::MAX / 4)
}

/// Replaces the link `gone` by `replacements`, without repeats and without a link to `own` itself.
fn join(links: &mut Vec<String>, gone: &str, replacements: &[String], own: &str) {
    if !links.iter().any(|l| l == gone) {
        return;
    }
    links.retain(|l| l != gone);
    for link in replacements {
        if link != own && link != gone && !links.contains(link) {
            links.push(link.clone());
        }
    }
}

//! The drivable ground.

use reactsim_geometry::{OrientedEdges, Vec2};

use super::{Area, Areas};

/// The drivable ground of a map.
#[derive(Clone, Debug)]
pub enum DrivableArea {
    /// The union of areas; each of them is open.
    Areas(Areas),
    /// The left side of road edges, and driveways, which edges run past.
    RoadEdges {
        /// Edges.
        edges: OrientedEdges,
        /// Driveways.
        driveways: Areas,
    },
    /// The map does not record it.
    Unknown,
}

impl DrivableArea {
    /// Returns the ground inside `areas`.
    pub fn of_areas(areas: Vec<Area>) -> Self {
        Self::Areas(Areas::new(areas))
    }

    /// Returns the ground left of road edges, and on driveways.
    pub(crate) fn of_road_edges<'a>(
        edges: impl IntoIterator<Item = &'a [Vec2], IntoIter: Clone>,
        driveways: Vec<Area>,
    ) -> Self {
        Self::RoadEdges { edges: OrientedEdges::new(edges), driveways: Areas::new(driveways) }
    }

    /// Returns whether `p` is on drivable ground; `None` if it is unknown. `hint`: the road edge that was
    /// found for a point nearby; it only shortens the search.
    pub fn contains(&self, p: Vec2, hint: &mut Option<u32>) -> Option<bool> {
        match self {
            Self::Areas(areas) => Some(areas.contains(p)),
            Self::RoadEdges { edges, driveways } => {
                let nearest = edges.nearest(p, *hint)?;
                *hint = Some(nearest.segment);
                Some(!nearest.outside || driveways.contains(p))
            }
            Self::Unknown => None,
        }
    }

    /// Returns whether drivable ground is less than `distance` metres from `p`; `None` if it is unknown.
    pub fn is_within(&self, p: Vec2, distance: f64) -> Option<bool> {
        match self {
            Self::Areas(areas) => Some(areas.is_within(p, distance)),
            Self::RoadEdges { edges, driveways } => {
                let nearest = edges.nearest(p, None)?;
                let is_near = nearest.distance < distance || driveways.is_within(p, distance);
                Some(if nearest.outside { is_near } else { 0.0 < distance })
            }
            Self::Unknown => None,
        }
    }
}

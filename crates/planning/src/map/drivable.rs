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
    pub fn of_road_edges<'a>(
        edges: impl IntoIterator<Item = &'a [Vec2], IntoIter: Clone>,
        driveways: Vec<Area>,
    ) -> Self {
        Self::RoadEdges { edges: OrientedEdges::new(edges), driveways: Areas::new(driveways) }
    }

    /// Returns whether `p` is on drivable ground; `None` if it is unknown.
    pub fn contains(&self, p: Vec2) -> Option<bool> {
        match self {
            Self::Areas(areas) => Some(areas.contains(p)),
            Self::RoadEdges { edges, driveways } => {
                Some(!edges.nearest(p, None)?.outside || driveways.contains(p))
            }
            Self::Unknown => None,
        }
    }

    /// Returns the distance from `p` to the drivable ground, metres, 0 on it; `None` if it is unknown.
    pub fn distance(&self, p: Vec2) -> Option<f64> {
        match self {
            Self::Areas(areas) => Some(areas.distance(p)),
            Self::RoadEdges { edges, driveways } => {
                let nearest = edges.nearest(p, None)?;
                Some(if nearest.outside { nearest.distance.min(driveways.distance(p)) } else { 0.0 })
            }
            Self::Unknown => None,
        }
    }
}

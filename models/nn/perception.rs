//! Perception: what an agent perceives of a scene, as features of networks.
//!
//! A `SceneView` is a scene at one frame as agents see it. `Body::at` describes one agent in it: its
//! own motion (`body`, `observe`), its lane and the paths that it may take (`lane`), and agents and stops
//! on these paths (`corridor`). A `KnownMap` is the part of the map around the AV, cut into
//! [`MapPiece`]s; its `Places` are what agents drive along or stop at, with the successors of lanes.
//! `Nearest` selects neighbours, `PointIndex` among many points; `forecast` continues the motion of the AV;
//! `denoised` removes the noise of recorded positions.
//! Nothing here depends on a network: each chooses the features that it reads.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod body;
mod class;
pub mod corridor;
mod denoise;
mod features;
mod forecast;
mod known_map;
mod known_motion;
pub mod lane;
mod lane_graph;
mod map_pieces;
mod matching_box;
mod nearest;
mod observe;
mod place;
mod places;
mod point_index;
mod rings;
mod velocity;
mod view;
mod widths;

pub use body::Body;
pub use class::Class;
pub use denoise::denoised;
pub use features::put;
pub use forecast::forecast;
pub use known_map::{KnownMap, Stop};
pub use known_motion::KnownMotion;
pub use map_pieces::MAX_LINE_LENGTH;
pub use map_pieces::{MapPiece, PIECE_POINTS, PieceKind, map_pieces};
pub use nearest::{Nearest, millionths};
pub use place::{PLACE_FEATURES, Place, Role};
pub use places::Places;
pub use point_index::PointIndex;
pub use rings::{closed, edge_rings};
pub use velocity::velocity_at;
pub use view::SceneView;
pub use widths::BODY_FEATURES;

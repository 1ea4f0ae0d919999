//! Perception: what an agent perceives of a scene, as features of networks.
//!
//! A `SceneView` is a scene at one frame as agents see it. `Body::at` describes one agent in it: its
//! own motion (`body`, `observe`), its lane and the paths that it may take (`lane`), and agents and stops
//! on these paths (`corridor`). A `KnownMap` is the part of the map around the AV, cut into
//! [`MapPiece`]s; its `Places` are what agents drive along or stop at, with the successors of lanes.
//! `Nearest` selects neighbours; `forecast` continues the motion of the AV. Nothing here knows a network:
//! each chooses which features it reads.

mod body;
mod class;
pub(crate) mod corridor;
mod features;
mod forecast;
mod known_map;
mod known_motion;
pub(crate) mod lane;
mod lane_graph;
mod map_pieces;
mod nearest;
mod observe;
mod place;
mod places;
mod rings;
mod velocity;
mod view;
mod widths;

pub(crate) use body::Body;
pub use class::Class;
pub(crate) use features::put;
pub(crate) use forecast::forecast;
pub(crate) use known_map::{KnownMap, Stop};
pub use known_motion::KnownMotion;
pub(crate) use map_pieces::MAX_LINE_LENGTH;
pub use map_pieces::{MapPiece, PIECE_POINTS, PieceKind, map_pieces};
pub(crate) use nearest::Nearest;
pub(crate) use place::{PLACE_FEATURES, Place, Role};
pub(crate) use places::Places;
pub(crate) use rings::{closed, edge_rings};
pub(crate) use velocity::velocity_at;
pub(crate) use view::SceneView;
pub(crate) use widths::BODY_FEATURES;

//! Motion tokens: vocabularies, their construction, and matching of recorded motion.
//!
//! A token is half a second of motion: six poses, 0.1 s apart, in the frame of the first one. Read
//! [`Vocabulary`] first.

mod build_error;
mod errors;
pub(crate) mod file;
mod k_disks;
mod kinematic;
mod map;
pub(crate) mod map_vocabulary;
mod matching;
mod motion;
mod segments;
mod token_set;
mod tokenizer;
mod trajtok;
mod vocabulary;

pub use build_error::BuildError;
pub use errors::{ErrorSummary, MatchingErrors};
pub use k_disks::{KDisks, Quality};
pub use kinematic::{ArcGrid, Band, Kinematic, PolarGrid};
pub use map::{CURVE_POINTS, CurveKind, CurvePiece, LightCode, curve_pieces};
pub use map_vocabulary::{MapVocabulary, MapVocabularyBuilder};
pub use matching::{PreparedTrack, TOKEN_STEPS, TokenNoise, TokenTrack, fill_gaps, token_of_motion};
pub use motion::{ORIGIN, motion_between, moved};
pub use segments::Segments;
pub use tokenizer::Tokenizer;
pub use trajtok::{EndGrid, TrajTok};
pub use vocabulary::Vocabulary;

use reactsim_scene::dynamics::Pose;

/// Number of frames that a token spans: it ends 0.5 s after it starts.
pub const TOKEN_FRAMES: usize = 5;
/// Number of poses of a token: the start and five frames.
pub const TOKEN_POSES: usize = TOKEN_FRAMES + 1;
/// Poses of one token at 0, 0.1 … 0.5 s, in the frame of the first, which is the origin.
pub type TokenPoses = [Pose; TOKEN_POSES];

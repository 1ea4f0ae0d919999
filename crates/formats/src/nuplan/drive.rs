//! The drive of the AV in a log, without the other agents, and the tokens of logs.

use std::path::Path;

use reactsim_geometry::{Vec2, direction};

use super::log::Log;
use super::parts::AXLE_TO_CENTER;
use super::sqlite::Database;
use super::token::Token;
use super::{library, window};
use crate::error::{Cause, FormatError};
use crate::frames::LengthChoice;

/// Number of frames from the first one of a scenario of the benchmark to the current one, in rows of a log.
pub(crate) const ROWS_BEFORE: usize = window::ROWS_PER_FRAME * reactsim_scene::CURRENT;

/// Pose of the AV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position of the rear axle, metres.
    pub axle: Vec2,
    /// Radians.
    pub heading: f64,
}

impl Pose {
    /// Returns the centre of the box.
    pub fn center(&self) -> Vec2 {
        self.axle + direction(self.heading) * AXLE_TO_CENTER
    }
}

/// The frames of a log.
pub(crate) struct Drive(Log);

impl Drive {
    /// Reads the frames of a log with the poses of the AV.
    pub(crate) fn read(path: &Path) -> Result<Self, FormatError> {
        Log::read_drive(path).map(Self)
    }

    pub(crate) fn map_name(&self) -> &str {
        &self.0.map_name
    }

    /// Returns the row with this token, or with a pose with it.
    pub(crate) fn row_of(&self, token: Token) -> Option<usize> {
        self.0.frames.iter().position(|frame| frame.token == token || frame.ego.token == token)
    }

    /// Returns the tokens of a row and of its scene; `None` beyond the end.
    pub(crate) fn tokens(&self, row: usize) -> Option<(Token, Token)> {
        self.0.frames.get(row).map(|frame| (frame.token, frame.scene))
    }

    /// Returns the poses in the 91 frames of the benchmark around a row.
    pub(crate) fn window(&self, row: usize) -> Result<Vec<Pose>, Cause> {
        if row >= self.0.frames.len() {
            return Err(Cause::value("`lidar_pc`", "at its end", "rows after the frame; choose another one"));
        }
        let pose = |row: usize| {
            let ego = &self.0.frames[row].ego;
            let is_finite = [ego.x, ego.y, ego.heading].iter().all(|v| v.is_finite());
            let wrong = || Cause::value(format!("`ego_pose` of row {}", ego.token), "NaN", "a finite pose");
            let pose = Pose { axle: Vec2::new(ego.x, ego.y), heading: ego.heading };
            if is_finite { Ok(pose) } else { Err(wrong()) }
        };
        let (rows, _) = window::rows(&self.0, row, LengthChoice::default())?;
        rows.into_iter().map(pose).collect()
    }
}

/// Reads the tokens of the scenes of a log.
pub(crate) fn scenes(path: &Path) -> Result<Vec<Token>, FormatError> {
    let mut scenes = Vec::new();
    let database = Database::open(path)?;
    let read = database.each("scene", &["token"], |row| {
        scenes.push(row.must_token(0)?);
        Ok(())
    });
    read.map_err(|cause| FormatError::file(path, cause)).map(|()| scenes)
}

impl Log {
    /// Reads the map's name and the frames of a log; nothing else is filled.
    fn read_drive(path: &Path) -> Result<Self, FormatError> {
        let database = Database::open(path)?;
        let mut log = Self { path: path.to_owned(), ..Self::default() };
        let refuse = |cause| FormatError::file(path, cause);
        log.map_name = library::name_in(&database).map_err(refuse)?;
        log.sweeps(&database).map_err(refuse)?;
        Ok(log)
    }
}

//! What decides which frames of a log become scenarios, read without boxes, poses and lights.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use super::library;
use super::log::{clock_lidars, inner_scenes};
use super::sqlite::Database;
use super::token::Token;
use crate::error::{Cause, FormatError};

/// Frames of a log with their scenes and tags.
pub(super) struct LogIndex {
    pub(super) map_name: String,
    /// Rows of the clock in order of time: time in microseconds, token, token of the scene.
    pub(super) sweeps: Vec<(i64, Token, Token)>,
    /// Scenes whose frames the devkit offers as scenario starts.
    pub(super) inner: BTreeSet<Token>,
    /// Types of the tags by row.
    pub(super) tags: BTreeMap<Token, Vec<String>>,
    /// Pose that is the goal of a scene.
    goals: BTreeMap<Token, Token>,
}

impl LogIndex {
    /// Reads the index of a log. Without `with_goals`, no scene has a goal.
    pub(super) fn read(path: &Path, with_goals: bool) -> Result<Self, FormatError> {
        let database = Database::open(path)?;
        Self::of(&database, with_goals).map_err(|cause| FormatError::file(path, cause))
    }

    fn of(database: &Database, with_goals: bool) -> Result<Self, Cause> {
        let clocks = clock_lidars(database)?;
        let mut sweeps = Vec::new();
        database.each("lidar_pc", &["token", "lidar_token", "timestamp", "scene_token"], |row| {
            if clocks.contains(&row.must_token(1)?) {
                sweeps.push((row.must_whole(2)?, row.must_token(0)?, row.must_token(3)?));
            }
            Ok(())
        })?;
        sweeps.sort_unstable();
        let (mut names, mut goals) = (BTreeMap::new(), BTreeMap::new());
        database.each("scene", &["token", "name", "goal_ego_pose_token"], |row| {
            names.insert(row.must_token(0)?, row.text(1)?);
            if let Some(goal) = row.token(2)?.filter(|_| with_goals) {
                goals.insert(row.must_token(0)?, goal);
            }
            Ok(())
        })?;
        if !goals.is_empty() {
            let wanted: BTreeSet<Token> = goals.values().copied().collect();
            let mut found = BTreeSet::new();
            database.each("ego_pose", &["token"], |row| {
                found.extend(row.token(0)?.filter(|token| wanted.contains(token)));
                Ok(())
            })?;
            goals.retain(|_, pose| found.contains(pose));
        }
        let mut tags: BTreeMap<Token, Vec<String>> = BTreeMap::new();
        database.each("scenario_tag", &["token", "lidar_pc_token", "type"], |row| {
            tags.entry(row.must_token(1)?).or_default().push(row.text(2)?);
            Ok(())
        })?;
        let inner = inner_scenes(names.iter().map(|(token, name)| (name.as_str(), *token)));
        Ok(Self { map_name: library::name_in(database)?, sweeps, inner, tags, goals })
    }

    /// Returns whether a scene has a goal that is a pose of the log.
    pub(super) fn has_goal(&self, scene: Token) -> bool {
        self.goals.contains_key(&scene)
    }
}

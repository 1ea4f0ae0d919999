//! A nuPlan log (`.db`), read as a whole: real logs hold some hundred thousand boxes, and an index for
//! partial reading is not guaranteed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use reactsim_geometry::math;
use reactsim_scene::{AgentKind, LightState, named_enum};

use super::library;
use super::sqlite::{Cells, Database};
use super::token::Token;
use crate::error::{Cause, FormatError};

/// Channel of the lidar whose rows define the clock.
const CLOCK_CHANNEL: &str = "MergedPointCloud";

#[derive(Debug, Default)]
pub(super) struct Log {
    pub(super) path: PathBuf,
    pub(super) map_name: String,
    /// Rows of the clock (20 Hz) in order of time.
    pub(super) frames: Vec<Sweep>,
    /// All boxes by frame, then by track.
    pub(super) boxes: Vec<BoxRow>,
    /// Index in `boxes` of the first box of each frame; one more entry than frames.
    pub(super) first_box: Vec<usize>,
    /// Category of each track.
    pub(super) tracks: BTreeMap<Token, Category>,
    /// Lights by frame and lane connector.
    pub(super) lights: BTreeMap<usize, BTreeMap<i64, LightState>>,
    /// Tags by frame: type, and the agent concerned.
    pub(super) tags: BTreeMap<usize, Vec<(String, Option<Token>)>>,
    /// Names of the scenes, by which they are sorted.
    pub(super) scenes: BTreeMap<Token, String>,
}

/// A row of `lidar_pc` with the ego's pose.
#[derive(Debug)]
pub(super) struct Sweep {
    pub(super) token: Token,
    /// Time in microseconds since 1970.
    pub(super) timestamp: i64,
    /// Token of its scene.
    pub(super) scene: Token,
    pub(super) ego: Ego,
}

/// A row of `ego_pose`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ego {
    pub(super) token: Token,
    /// Rear axle, easting, metres.
    pub(super) x: f64,
    /// Rear axle, northing, metres.
    pub(super) y: f64,
    /// Heading, radians.
    pub(super) heading: f64,
    /// Longitudinal velocity (forward), m/s.
    pub(super) longitudinal: f64,
    /// Lateral velocity (to the left), m/s.
    pub(super) lateral: f64,
    /// EPSG code of x and y.
    pub(super) epsg: Option<i64>,
}

/// A row of `lidar_box`.
#[derive(Debug)]
pub(super) struct BoxRow {
    frame: usize,
    pub(super) token: Token,
    pub(super) track: Token,
    /// Centre x, y and heading; length and width; velocity along x and y: metres, radians and m/s, map frame.
    pub(super) values: [f64; 7],
}

/// Names of the values of a box.
pub(super) const BOX_VALUES: [&str; 7] = ["x", "y", "yaw", "length", "width", "vx", "vy"];

named_enum! {
    name, from_name;
    /// Object category of nuPlan.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Category {
        Vehicle = "vehicle",
        Bicycle = "bicycle",
        Pedestrian = "pedestrian",
        TrafficCone = "traffic_cone",
        Barrier = "barrier",
        CzoneSign = "czone_sign",
        GenericObject = "generic_object",
    }
}

impl Category {
    /// Returns the agent kind of the category (ReactSim-Bench, "Scenario Data").
    pub(super) fn kind(self) -> AgentKind {
        match self {
            Self::Vehicle => AgentKind::Vehicle,
            Self::Bicycle => AgentKind::Cyclist,
            Self::Pedestrian => AgentKind::Pedestrian,
            Self::TrafficCone | Self::Barrier | Self::CzoneSign | Self::GenericObject => AgentKind::Other,
        }
    }
}

impl Log {
    /// Reads a log.
    pub(super) fn read(path: &Path) -> Result<Self, FormatError> {
        let database = Database::open(path)?;
        let mut log = Self { path: path.to_owned(), ..Self::default() };
        log.fill(&database).map_err(|cause| FormatError::file(path, cause))?;
        Ok(log)
    }

    fn fill(&mut self, database: &Database) -> Result<(), Cause> {
        self.map_name = library::name_in(database)?;
        self.sweeps(database)?;
        let of_token: BTreeMap<Token, usize> =
            self.frames.iter().enumerate().map(|(i, f)| (f.token, i)).collect();
        // Boxes, lights and tags of sweeps that are not part of the clock are ignored.
        let frame = |row: &Cells<'_>| Ok(of_token.get(&row.must_token(1)?).copied());
        database.each("scene", &["token", "name"], |row| {
            self.scenes.insert(row.must_token(0)?, row.text(1)?);
            Ok(())
        })?;
        self.objects(database, &frame)?;
        self.lights(database, &frame)?;
        database.each("scenario_tag", &["token", "lidar_pc_token", "type", "agent_track_token"], |row| {
            if let Some(frame) = frame(row)? {
                self.tags.entry(frame).or_default().push((row.text(2)?, row.token(3)?));
            }
            Ok(())
        })?;
        self.tags.values_mut().for_each(|tags| tags.sort());
        Ok(())
    }

    /// Reads the rows of the clock with their poses.
    pub(super) fn sweeps(&mut self, database: &Database) -> Result<(), Cause> {
        let clocks = clock_lidars(database)?;
        let mut poses = BTreeMap::new();
        let columns = ["token", "x", "y", "qw", "qx", "qy", "qz", "vx", "vy", "epsg"];
        database.each("ego_pose", &columns, |row| {
            let token = row.must_token(0)?;
            let q = [row.number(3)?, row.number(4)?, row.number(5)?, row.number(6)?];
            let ego = Ego {
                token,
                x: row.number(1)?,
                y: row.number(2)?,
                heading: yaw(q),
                longitudinal: row.number(7)?,
                lateral: row.number(8)?,
                epsg: row.whole(9)?,
            };
            poses.insert(token, ego);
            Ok(())
        })?;
        let columns = ["token", "lidar_token", "timestamp", "ego_pose_token", "scene_token"];
        database.each("lidar_pc", &columns, |row| {
            if !clocks.contains(&row.must_token(1)?) {
                return Ok(());
            }
            let pose = row.must_token(3)?;
            let ego = *poses.get(&pose).ok_or_else(|| row.wrong(3, "the token of a row of `ego_pose`"))?;
            let (token, timestamp) = (row.must_token(0)?, row.must_whole(2)?);
            self.frames.push(Sweep { token, timestamp, scene: row.must_token(4)?, ego });
            Ok(())
        })?;
        self.frames.sort_by_key(|f| (f.timestamp, f.token));
        Ok(())
    }

    fn objects(
        &mut self,
        database: &Database,
        frame: &dyn Fn(&Cells<'_>) -> Result<Option<usize>, Cause>,
    ) -> Result<(), Cause> {
        let mut categories = BTreeMap::new();
        database.each("category", &["token", "name"], |row| {
            let name = row.text(1)?;
            // Unknown categories that no track uses are allowed.
            categories.insert(row.must_token(0)?, Category::from_name(&name).ok_or(name));
            Ok(())
        })?;
        database.each("track", &["token", "category_token"], |row| {
            let category = categories.get(&row.must_token(1)?);
            let category = category.ok_or_else(|| row.wrong(1, "the token of a row of `category`"))?;
            let category = category.as_ref().map_err(|name| {
                let known = Category::ALL.map(Category::name).join(", ");
                Cause::value("`category.name`", format!("`{name}`"), format!("one of {known}"))
            })?;
            self.tracks.insert(row.must_token(0)?, *category);
            Ok(())
        })?;
        let columns =
            ["token", "lidar_pc_token", "track_token", "x", "y", "yaw", "length", "width", "vx", "vy"];
        database.each("lidar_box", &columns, |row| {
            let Some(frame) = frame(row)? else { return Ok(()) };
            let track = row.must_token(2)?;
            if !self.tracks.contains_key(&track) {
                return Err(row.wrong(2, "the token of a row of `track`"));
            }
            let mut values = [0.0; 7];
            for (i, value) in values.iter_mut().enumerate() {
                *value = row.number(3 + i)?;
            }
            self.boxes.push(BoxRow { frame, token: row.must_token(0)?, track, values });
            Ok(())
        })?;
        self.boxes.sort_by_key(|b| (b.frame, b.track, b.token));
        self.first_box =
            (0..=self.frames.len()).map(|f| self.boxes.partition_point(|b| b.frame < f)).collect();
        Ok(())
    }

    fn lights(
        &mut self,
        database: &Database,
        frame: &dyn Fn(&Cells<'_>) -> Result<Option<usize>, Cause>,
    ) -> Result<(), Cause> {
        let columns = ["token", "lidar_pc_token", "lane_connector_id", "status"];
        database.each("traffic_light_status", &columns, |row| {
            let Some(frame) = frame(row)? else { return Ok(()) };
            let state = match row.text(3)?.as_str() {
                "green" => LightState::Go,
                "yellow" => LightState::Caution,
                "red" => LightState::Stop,
                _ => LightState::Unknown,
            };
            self.lights.entry(frame).or_default().insert(row.must_whole(2)?, state);
            Ok(())
        })
    }

    /// Returns the boxes of a frame, ordered by track.
    pub(super) fn boxes_at(&self, frame: usize) -> &[BoxRow] {
        &self.boxes[self.first_box[frame]..self.first_box[frame + 1]]
    }

    /// Returns the frames that the devkit offers as scenario starts: those of scenes with two scenes before
    /// and two after.
    pub(super) fn starts(&self) -> Vec<usize> {
        let inner = inner_scenes(self.scenes.iter().map(|(token, name)| (name.as_str(), *token)));
        let frames = self.frames.iter().enumerate();
        frames.filter(|(_, f)| inner.contains(&f.scene)).map(|(i, _)| i).collect()
    }
}

/// Returns the tokens of the lidars whose rows define the clock.
pub(super) fn clock_lidars(database: &Database) -> Result<BTreeSet<Token>, Cause> {
    let mut clocks = BTreeSet::new();
    database.each("lidar", &["token", "channel"], |row| {
        if row.text(1)? == CLOCK_CHANNEL {
            clocks.insert(row.must_token(0)?);
        }
        Ok(())
    })?;
    if clocks.is_empty() {
        return Err(Cause::schema(
            "`lidar.channel`",
            "without a merged cloud",
            format!("a row `{CLOCK_CHANNEL}`"),
        ));
    }
    Ok(clocks)
}

/// Returns the scenes, given with their names, that have two scenes before them and two after.
pub(super) fn inner_scenes<'a>(scenes: impl Iterator<Item = (&'a str, Token)>) -> BTreeSet<Token> {
    let mut scenes: Vec<(&str, Token)> = scenes.collect();
    scenes.sort();
    let inner = scenes.get(2..scenes.len().saturating_sub(2)).unwrap_or_default();
    inner.iter().map(|(_, token)| *token).collect()
}

/// Returns the heading in radians of a quaternion (w, x, y, z) of any norm, NaN if it is undefined. This is
/// the yaw of nuPlan's devkit, which has a minus where textbooks have a plus; for two degrees of roll and
/// pitch the difference is a milliradian.
fn yaw([w, x, y, z]: [f64; 4]) -> f64 {
    let square = w * w + x * x + y * y + z * z;
    if !(square.is_finite() && square > 1e-12) {
        return f64::NAN;
    }
    math::atan2(2.0 * (w * z - x * y) / square, 1.0 - 2.0 * (y * y + z * z) / square)
}

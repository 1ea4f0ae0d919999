//! Assembly of a scenario from the contents of a file: checks, selection of agents, coordinates, links.

mod checks;
mod lanes;

use std::sync::OnceLock;

use reactsim_geometry::{OrientedBox, left};

use self::checks::Builder;
use self::lanes::LaneIndex;
use super::headings::estimate_headings;
use super::parts::{DeviationParts, LightParts, MapParts, ScenarioParts, StopLineParts};
use super::{
    AgentKind, AgentState, DeviatedTrack, LANE_HALF_WIDTH, Lane, LaneArea, LightState, LogFuture,
    LoggedAgent, MAX_AGENTS, MapHeights, RoadMap, Scenario, SceneError, SharedMap, Start, StopLine,
    TrafficLight,
};

/// Name of the repair that counts agents that are present at the current frame with a box of size zero.
pub(super) const WITHOUT_EXTENT: &str = "agents with a box of size zero";
/// Maximum number of lane segments that are searched for the crossing points of stop lines.
const MAX_PROJECTED_SEGMENTS: usize = 200_000_000;

impl Scenario {
    /// Checks parts and assembles a scenario: shifts coordinates to the AV, selects and orders agents,
    /// resolves links.
    ///
    /// Unusual input has defined meanings: an agent with a box of size zero is not selected (see
    /// [`Self::with_all_agents`]), and states of it that are beyond the limits are absent: files fill unused
    /// slots with zeros, far from world coordinates; links, lights and stop lines of missing lanes are
    /// dropped and counted, as are links between lanes that no vehicle can drive; headings need not be
    /// wrapped; NaN velocities, and those that contradict the positions of most agents, are unknown, and are
    /// estimated from positions where there are any.
    ///
    /// # Errors
    /// [`SceneError`] names the field and the value: a wrong number of frames or a wrong rate, no AV,
    /// coordinates that are not finite or farther than 100 km from the AV, negative sizes, and ids that are
    /// repeated, empty or invalid.
    pub fn assemble(parts: ScenarioParts) -> Result<Self, SceneError> {
        let mut scenario = Self::assemble_as_stored(parts)?;
        scenario.complete();
        Ok(scenario)
    }

    /// Like [`Self::assemble`], without the estimates of velocities and the removal of links and of heights
    /// on one level, for files with digests: scenarios must match their digest before [`Self::complete`]
    /// changes them.
    ///
    /// # Errors
    /// As for [`Self::assemble`].
    pub fn assemble_as_stored(parts: ScenarioParts) -> Result<Self, SceneError> {
        let length = parts.length;
        let mut builder = Builder::new(&parts.id, length);
        builder.check_length()?;
        builder.check_name(|| "id".into(), &parts.id)?;
        builder.check_time(&parts.timestamps)?;
        builder.check_agents(&parts)?;
        let origin = builder.set_origin(&parts)?;
        let mut agents = parts.agents;
        for (i, agent) in agents.iter_mut().enumerate() {
            if !agent.agent.has_extent() {
                builder.drop_padding(&mut agent.track);
            }
            estimate_headings(&mut agent.track, length.history);
            builder.shift_track(agent.track.iter_mut().map(Option::as_mut), &format!("agents[{i}].track"))?;
        }
        let mut map = parts.map;
        builder.check_heights(&mut agents, &mut map)?;
        let mut heights = std::mem::take(&mut map.heights);
        let (lanes, index) = builder.lanes(std::mem::take(&mut map.lanes), &mut heights.lanes)?;
        let lights = builder.lights(parts.lights, &index)?;
        let stop_lines = builder.stop_lines(std::mem::take(&mut map.stop_lines), &lanes, &index)?;
        let map = RoadMap { heights, ..builder.map(map, lanes, stop_lines)? };
        let deviation = parts.deviation.map(|d| builder.deviation(d, &agents)).transpose()?;

        let (selected, unselected) = select_agents(agents, parts.av, &mut builder);
        let (obstacles, obstacle_heights) = obstacles(&unselected, length.current()).unzip();
        let start = Start {
            agents: Vec::with_capacity(selected.len()),
            history: Vec::with_capacity(selected.len()),
            obstacles,
            obstacle_numbers: Vec::new(),
            map: SharedMap::new(map),
            heights: Vec::new(),
            obstacle_heights,
            lights: lights.positions,
            light_history: lights.history,
        };
        let mut scenario = Self {
            id: parts.id,
            source: parts.source,
            origin,
            timestamps: parts.timestamps,
            tracks_to_predict: parts.tracks_to_predict,
            objects_of_interest: parts.objects_of_interest,
            start,
            log_future: LogFuture { tracks: Vec::new(), heights: Vec::new(), lights: lights.future },
            unselected,
            context_changes: false,
            deviation,
            repairs: builder.repairs,
            notes: OnceLock::new(),
        };
        selected.into_iter().for_each(|logged| scenario.add_agent(logged, length));
        if !scenario.start.has_levels() {
            scenario.drop_heights();
        }
        Ok(scenario)
    }

    /// Takes the heights of obstacles from those of the unselected agents.
    pub(super) fn find_obstacle_heights(&mut self) {
        self.start.obstacle_heights =
            obstacles(&self.unselected, self.start.current()).map(|o| o.1).collect();
    }

    /// Drops all heights: on one level they have no meaning.
    pub(super) fn drop_heights(&mut self) {
        self.start.map.edit().heights = MapHeights::default();
        self.start.heights.clear();
        self.start.obstacle_heights.clear();
        self.log_future.heights.clear();
        self.unselected.iter_mut().for_each(|a| a.heights.clear());
    }

    /// Drops heights on one level and those that contradict one another, estimates velocities that are unknown
    /// or contradict positions, and drops links between lanes that no vehicle can drive. A scenario that is
    /// complete does not change. Returns whether anything was written, be it what was there before.
    pub fn complete(&mut self) -> bool {
        let changes = [self.mend_heights(), self.estimate_velocities(), self.drop_undrivable_links()];
        changes.contains(&true)
    }
}

/// Returns the selected agents, at most [`MAX_AGENTS`], and the rest. The AV comes first, then the dynamic
/// agents present now by distance to it (ties in file order).
fn select_agents(
    agents: Vec<LoggedAgent>,
    av: usize,
    builder: &mut Builder,
) -> (Vec<LoggedAgent>, Vec<LoggedAgent>) {
    let current = builder.length.current();
    let av_now = agents[av].track[current].map(|s| s.position()).unwrap_or_default();
    let mut candidates: Vec<(f64, usize)> = Vec::new();
    for (i, a) in agents.iter().enumerate() {
        let Some(now) = a.track[current] else { continue };
        if i == av || a.agent.kind == AgentKind::Other {
            continue;
        }
        if a.agent.has_extent() {
            candidates.push(((now.position() - av_now).norm(), i));
        } else {
            builder.repaired(WITHOUT_EXTENT);
        }
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    candidates.truncate(MAX_AGENTS - 1);
    let mut slots: Vec<Option<LoggedAgent>> = agents.into_iter().map(Some).collect();
    let order = std::iter::once(av).chain(candidates.into_iter().map(|c| c.1));
    let selected = order.filter_map(|i| slots[i].take()).collect();
    (selected, slots.into_iter().flatten().collect())
}

/// Returns the boxes of the objects that are static context, with their heights.
fn obstacles(unselected: &[LoggedAgent], current: usize) -> impl Iterator<Item = (OrientedBox, Option<f64>)> {
    let others = unselected.iter().filter(|a| a.agent.kind == AgentKind::Other && a.agent.has_extent());
    let height_now = move |a: &LoggedAgent| a.heights.get(current).copied().flatten();
    others.filter_map(move |a| Some((a.track[current]?.footprint(&a.agent), height_now(a))))
}

/// Lights on lanes of the map, their states split at the current frame.
#[derive(Default)]
struct Lights {
    positions: Vec<TrafficLight>,
    history: Vec<Vec<Option<LightState>>>,
    future: Vec<Vec<Option<LightState>>>,
}

impl Builder {
    /// Checks lights, shifts them and splits their states. Lights on missing lanes are dropped and counted.
    fn lights(&mut self, parts: Vec<LightParts>, index: &LaneIndex) -> Result<Lights, SceneError> {
        let mut lights = Lights::default();
        for (i, mut light) in parts.into_iter().enumerate() {
            if light.states.len() != self.length.frames() {
                let field = format!("lights[{i}].states");
                return Err(self.frames_error(field, light.states.len()));
            }
            let Some(&lane) = index.get(&light.lane) else {
                self.repaired("lights on missing lanes");
                continue;
            };
            let stop_point = self.point(|| format!("lights[{i}].stop_point"), light.stop_point)?;
            lights.positions.push(TrafficLight { lane, stop_point });
            lights.future.push(light.states.split_off(self.length.history));
            lights.history.push(light.states);
        }
        Ok(lights)
    }

    /// Projects stop lines onto their lanes. Lines on missing lanes are dropped and counted.
    fn stop_lines(
        &mut self,
        parts: Vec<StopLineParts>,
        lanes: &[Lane],
        index: &LaneIndex,
    ) -> Result<Vec<StopLine>, SceneError> {
        let mut stop_lines = Vec::new();
        let mut segments_left = MAX_PROJECTED_SEGMENTS;
        for (i, line) in parts.into_iter().enumerate() {
            let Some(&lane) = index.get(&line.lane) else {
                self.repaired("stop lines on missing lanes");
                continue;
            };
            let at = self.point(|| format!("map.stop_lines[{i}].at"), line.at)?;
            let baseline = &lanes[lane].baseline;
            segments_left = segments_left.checked_sub(baseline.segments()).ok_or_else(|| {
                let found =
                    format!("one too many on lanes of many points, the last one of {}", baseline.segments());
                self.error(format!("map.stop_lines[{i}]"), found, "a few stop lines on each lane")
            })?;
            let s = baseline.project(at).s;
            let half = match lanes[lane].area {
                LaneArea::Corridor { half_width } => half_width,
                LaneArea::Polygon(_) => LANE_HALF_WIDTH,
            };
            let (from, to) = baseline.segment(baseline.segment_at(s));
            let (center, aside) = (baseline.at(s), left((to - from).normalize()) * half);
            stop_lines.push(StopLine { kind: line.kind, lane, s, ends: [center + aside, center - aside] });
        }
        Ok(stop_lines)
    }

    /// Shifts the shapes of a map and adds its assembled lanes and stop lines.
    fn map(&self, m: MapParts, lanes: Vec<Lane>, stop_lines: Vec<StopLine>) -> Result<RoadMap, SceneError> {
        let mut map = RoadMap {
            lanes,
            road_edges: m.road_edges,
            road_lines: m.road_lines,
            stop_lines,
            crosswalks: m.crosswalks,
            speed_bumps: m.speed_bumps,
            driveways: m.driveways,
            intersections: m.intersections,
            drivable_area: m.drivable_area,
            heights: m.heights,
        };
        self.shift_each(&mut map.road_edges, "map.road_edges", |e| &mut e.points)?;
        self.shift_each(&mut map.road_lines, "map.road_lines", |l| &mut l.points)?;
        self.shift_each(&mut map.crosswalks, "map.crosswalks", |c| &mut c.outline)?;
        self.shift_each(&mut map.speed_bumps, "map.speed_bumps", |s| &mut s.outline)?;
        self.shift_each(&mut map.driveways, "map.driveways", |s| &mut s.outline)?;
        self.shift_each(&mut map.intersections, "map.intersections", |ring| ring)?;
        for (i, polygon) in map.drivable_area.iter_mut().flatten().enumerate() {
            for ring in polygon.holes.iter_mut().chain([&mut polygon.exterior]) {
                self.shift_points(ring, || format!("map.drivable_area[{i}]"))?;
            }
        }
        Ok(map)
    }

    /// Checks a deviated AV and its certificate, and shifts both.
    fn deviation(
        &self,
        mut parts: DeviationParts,
        agents: &[LoggedAgent],
    ) -> Result<DeviatedTrack, SceneError> {
        self.shift_track(parts.track.iter_mut().map(Option::as_mut), "deviation.track")?;
        let track: Vec<AgentState> = parts.track.iter().flatten().copied().collect();
        let steps = self.length.future;
        if track.len() != steps || parts.track.len() != steps {
            let value = format!("{} states in {} frames", track.len(), parts.track.len());
            let expected = format!("{steps} states without gaps");
            return Err(self.error("deviation.track".into(), value, &expected));
        }
        if let Some(certificate) = &mut parts.certificate {
            self.certificate(certificate, agents)?;
        }
        Ok(DeviatedTrack { category: parts.category, track, certificate: parts.certificate })
    }
}

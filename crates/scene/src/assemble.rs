//! Assembly of a scenario from the contents of a file: checks, selection of agents, coordinates, links.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

use reactsim_geometry::{Polygon, Polyline, Vec2, left};

use super::limits::{MAX_BOX_SIZE, MAX_COORDINATE, MAX_HEADING, MAX_VELOCITY};
use super::parts::{LaneParts, NeighborParts, ScenarioParts};
use super::{
    AgentKind, AgentState, CURRENT, Certificate, Crosswalk, DT, DeviatedTrack, FRAMES, FUTURE, Frame,
    HISTORY, LANE_HALF_WIDTH, Lane, LaneArea, LaneNeighbor, LogFuture, LoggedAgent, MAX_AGENTS, RoadEdge,
    RoadLine, RoadMap, Scenario, SceneError, Start, StopLine, Surface, TrafficLight,
};

/// Maximum length of the name of a scenario, an agent or a lane, bytes.
const MAX_NAME_BYTES: usize = 1000;
/// Maximum number of link comparisons while lanes without extent are removed; real maps have few such lanes.
const MAX_LINK_COMPARISONS: usize = 50_000_000;
/// Maximum number of lane segments that are searched for the crossing points of stop lines.
const MAX_PROJECTED_SEGMENTS: usize = 200_000_000;
/// Maximum relative deviation of the median timestamp step from 0.1 s.
const STEP_TOLERANCE: f64 = 0.1;

impl Scenario {
    /// Checks parts and assembles a scenario: shifts coordinates to the AV, selects and orders agents,
    /// resolves links.
    ///
    /// Unusual input has defined meanings: a box of size zero marks an absent agent (it is never selected);
    /// links, lights and stop lines of missing lanes are dropped and counted; headings need not be wrapped;
    /// NaN velocities are unknown.
    ///
    /// # Errors
    /// [`SceneError`] names the field and the value: a wrong number of frames or a wrong rate, no AV,
    /// coordinates that are not finite or farther than 100 km from the AV, negative sizes, and ids that are
    /// repeated, empty or invalid.
    pub fn assemble(parts: ScenarioParts) -> Result<Self, SceneError> {
        let mut builder = Builder { id: parts.id.clone(), shift: Vec2::zeros(), repairs: BTreeMap::new() };
        builder.name(|| "id".into(), &parts.id)?;
        builder.check_time(&parts.timestamps)?;
        builder.check_agents(&parts)?;
        let av_now = match parts.agents[parts.av].track[CURRENT] {
            Some(state) => state,
            None => {
                let field = format!("agents[{}].track[{CURRENT}]", parts.av);
                return Err(builder.error(field, "absent", "the AV present at the current frame"));
            }
        };
        let origin = parts.origin.unwrap_or_else(|| av_now.position());
        builder.finite("origin", origin)?;
        builder.shift = if parts.origin.is_some() { Vec2::zeros() } else { origin };

        let mut agents = parts.agents;
        for (i, agent) in agents.iter_mut().enumerate() {
            builder.shift_track(&mut agent.track, &format!("agents[{i}].track"))?;
        }
        let lanes = builder.lanes(parts.map.lanes)?;
        let names: BTreeMap<&str, usize> =
            lanes.iter().enumerate().map(|(i, l)| (l.id.as_str(), i)).collect();

        let (mut lights, mut light_history, mut light_future) = (Vec::new(), Vec::new(), Vec::new());
        for (i, light) in parts.lights.into_iter().enumerate() {
            if light.states.len() != FRAMES {
                let field = format!("lights[{i}].states");
                return Err(builder.error(field, format!("{} frames", light.states.len()), "91 frames"));
            }
            let Some(&lane) = names.get(light.lane.as_str()) else {
                builder.repaired("lights on missing lanes");
                continue;
            };
            let stop_point = builder.point(&format!("lights[{i}].stop_point"), light.stop_point)?;
            lights.push(TrafficLight { lane, stop_point });
            light_history.push(light.states[..HISTORY].to_vec());
            light_future.push(light.states[HISTORY..].to_vec());
        }

        let mut stop_lines = Vec::new();
        let mut segments_left = MAX_PROJECTED_SEGMENTS;
        for (i, line) in parts.map.stop_lines.into_iter().enumerate() {
            let Some(&lane) = names.get(line.lane.as_str()) else {
                builder.repaired("stop lines on missing lanes");
                continue;
            };
            let at = builder.point(&format!("map.stop_lines[{i}].at"), line.at)?;
            let baseline = &lanes[lane].baseline;
            segments_left = segments_left.checked_sub(baseline.segments()).ok_or_else(|| {
                let found =
                    format!("one too many on lanes of many points, the last one of {}", baseline.segments());
                builder.error(format!("map.stop_lines[{i}]"), found, "a few stop lines on each lane")
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

        let map = RoadMap {
            road_edges: builder.each(parts.map.road_edges, "road_edges", |b, e, f| {
                Ok(RoadEdge { kind: e.kind, points: b.points(f, &e.points)? })
            })?,
            road_lines: builder.each(parts.map.road_lines, "road_lines", |b, l, f| {
                Ok(RoadLine { paint: l.paint, points: b.points(f, &l.points)? })
            })?,
            crosswalks: builder.each(parts.map.crosswalks, "crosswalks", |b, c, f| {
                Ok(Crosswalk { outline: b.points(f, &c.outline)? })
            })?,
            speed_bumps: builder.each(parts.map.speed_bumps, "speed_bumps", |b, c, f| {
                Ok(Surface { outline: b.points(f, &c.outline)? })
            })?,
            driveways: builder.each(parts.map.driveways, "driveways", |b, c, f| {
                Ok(Surface { outline: b.points(f, &c.outline)? })
            })?,
            intersections: builder
                .each(parts.map.intersections, "intersections", |b, ring, f| b.points(f, &ring))?,
            drivable_area: match parts.map.drivable_area {
                None => None,
                Some(area) => Some(builder.each(area, "drivable_area", |b, polygon, f| {
                    let holes = polygon.holes.iter().map(|h| b.points(f, h)).collect::<Result<_, _>>()?;
                    Ok(Polygon { exterior: b.points(f, &polygon.exterior)?, holes })
                })?),
            },
            stop_lines,
            lanes,
        };

        let deviation = match parts.deviation {
            None => None,
            Some(mut deviation) => {
                builder.shift_track(&mut deviation.track, "deviation.track")?;
                let track: Vec<AgentState> = deviation.track.iter().flatten().copied().collect();
                if track.len() != FUTURE || deviation.track.len() != FUTURE {
                    let value = format!("{} states in {} frames", track.len(), deviation.track.len());
                    return Err(builder.error("deviation.track".into(), value, "80 states without gaps"));
                }
                if let Some(certificate) = &mut deviation.certificate {
                    builder.certificate(certificate, &agents)?;
                }
                Some(DeviatedTrack {
                    category: deviation.category,
                    track,
                    certificate: deviation.certificate,
                })
            }
        };

        let (selected, unselected) = select_agents(agents, parts.av, &mut builder);
        let obstacles = unselected
            .iter()
            .filter(|a| a.agent.kind == AgentKind::Other && a.agent.length > 0.0 && a.agent.width > 0.0)
            .filter_map(|a| Some(a.track[CURRENT]?.footprint(&a.agent)))
            .collect();
        let mut start = Start {
            agents: Vec::with_capacity(selected.len()),
            history: Vec::with_capacity(selected.len()),
            obstacles,
            map,
            lights,
            light_history,
            index: OnceLock::new(),
        };
        let mut tracks = Vec::with_capacity(selected.len());
        for mut logged in selected {
            tracks.push(logged.track.split_off(HISTORY));
            start.agents.push(logged.agent);
            start.history.push(logged.track);
        }
        Ok(Self {
            id: parts.id,
            source: parts.source,
            origin,
            timestamps: parts.timestamps,
            tracks_to_predict: parts.tracks_to_predict,
            objects_of_interest: parts.objects_of_interest,
            start,
            log_future: LogFuture { tracks, lights: light_future },
            unselected,
            deviation,
            repairs: builder.repairs,
        })
    }
}

/// Returns the selected agents, at most [`MAX_AGENTS`], and the rest. The AV comes first, then the dynamic
/// agents present now by distance to it (ties in file order).
fn select_agents(
    agents: Vec<LoggedAgent>,
    av: usize,
    builder: &mut Builder,
) -> (Vec<LoggedAgent>, Vec<LoggedAgent>) {
    let av_now = agents[av].track[CURRENT].map(|s| s.position()).unwrap_or_default();
    let mut candidates: Vec<(f64, usize)> = Vec::new();
    for (i, a) in agents.iter().enumerate() {
        let Some(now) = a.track[CURRENT] else { continue };
        if i == av || a.agent.kind == AgentKind::Other {
            continue;
        }
        if a.agent.length > 0.0 && a.agent.width > 0.0 {
            candidates.push(((now.position() - av_now).norm(), i));
        } else {
            builder.repaired("agents with a box of size zero");
        }
    }
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    candidates.truncate(MAX_AGENTS - 1);
    let mut slots: Vec<Option<LoggedAgent>> = agents.into_iter().map(Some).collect();
    let order = std::iter::once(av).chain(candidates.into_iter().map(|c| c.1));
    let selected = order.filter_map(|i| slots[i].take()).collect();
    (selected, slots.into_iter().flatten().collect())
}

/// Checks and shifts the parts of a scenario. Every error names the field.
struct Builder {
    id: String,
    shift: Vec2,
    repairs: BTreeMap<String, u32>,
}

impl Builder {
    fn error(&self, field: String, value: impl ToString, expected: &str) -> SceneError {
        SceneError { scenario: self.id.clone(), field, value: value.to_string(), expected: expected.into() }
    }

    fn repaired(&mut self, what: &str) {
        *self.repairs.entry(what.to_owned()).or_default() += 1;
    }

    /// Checks a name, which is displayed and used in file names.
    fn name(&self, field: impl Fn() -> String, name: &str) -> Result<(), SceneError> {
        if !name.is_empty() && name.len() <= MAX_NAME_BYTES && !name.contains(char::is_control) {
            return Ok(());
        }
        let begin: String = name.chars().take(60).collect();
        let found = format!("`{}` ({} bytes)", begin.escape_debug(), name.len());
        Err(self.error(field(), found, "a name of 1 to 1000 bytes without control characters"))
    }

    fn check_time(&self, timestamps: &[f64]) -> Result<(), SceneError> {
        if timestamps.is_empty() {
            return Ok(());
        }
        if timestamps.len() != FRAMES {
            return Err(self.error(
                "timestamps".into(),
                format!("{} entries", timestamps.len()),
                "91 entries",
            ));
        }
        let mut steps: Vec<f64> = timestamps.windows(2).map(|w| w[1] - w[0]).collect();
        if let Some(i) = steps.iter().position(|s| !(s.is_finite() && *s > 0.0)) {
            let field = format!("timestamps[{}]", i + 1);
            return Err(self.error(field, timestamps[i + 1], "finite, increasing times"));
        }
        steps.sort_by(f64::total_cmp);
        let median = steps[steps.len() / 2];
        if (median - DT).abs() > STEP_TOLERANCE * DT {
            return Err(self.error(
                "timestamps".into(),
                format!("a step of {median} s"),
                "steps of 0.1 s (10 Hz)",
            ));
        }
        Ok(())
    }

    fn check_agents(&self, parts: &ScenarioParts) -> Result<(), SceneError> {
        if parts.av >= parts.agents.len() {
            let value = format!("{} of {} agents", parts.av, parts.agents.len());
            return Err(self.error("av".into(), value, "the index of an agent"));
        }
        let mut seen = BTreeSet::new();
        for (i, LoggedAgent { agent, track }) in parts.agents.iter().enumerate() {
            if track.len() != FRAMES {
                let field = format!("agents[{i}].track");
                return Err(self.error(field, format!("{} frames", track.len()), "91 frames"));
            }
            for (name, size) in [("length", agent.length), ("width", agent.width)] {
                if !(size.is_finite() && (0.0..MAX_BOX_SIZE).contains(&size)) {
                    let field = format!("agents[{i}].{name}");
                    return Err(self.error(field, size, "a size of at least 0 and less than 1000 m"));
                }
            }
            self.name(|| format!("agents[{i}].id"), &agent.id)?;
            if !seen.insert(agent.id.as_str()) {
                return Err(self.error(
                    format!("agents[{i}].id"),
                    &agent.id,
                    "an id that no other agent has",
                ));
            }
        }
        let av = &parts.agents[parts.av].agent;
        if !(av.length > 0.0 && av.width > 0.0) {
            let value = format!("{} m x {} m", av.length, av.width);
            return Err(self.error(format!("agents[{}]", parts.av), value, "a positive box size for the AV"));
        }
        Ok(())
    }

    fn finite(&self, field: &str, p: Vec2) -> Result<(), SceneError> {
        for (axis, v) in [("x", p.x), ("y", p.y)] {
            if !v.is_finite() {
                return Err(self.error(format!("{field}.{axis}"), v, "a finite coordinate"));
            }
        }
        Ok(())
    }

    fn point(&self, field: &str, p: Vec2) -> Result<Vec2, SceneError> {
        let q = p - self.shift;
        // Hot path: one test for NaN, infinity and distance. The message is built only if it fails.
        if q.x.abs() < MAX_COORDINATE && q.y.abs() < MAX_COORDINATE {
            return Ok(q);
        }
        self.finite(field, p)?;
        Err(self.error(field.to_owned(), format!("({}, {})", p.x, p.y), "a point within 100 km of the AV"))
    }

    fn points(&self, field: &str, points: &[Vec2]) -> Result<Vec<Vec2>, SceneError> {
        points.iter().map(|&p| self.point(field, p)).collect()
    }

    fn each<T, U>(
        &self,
        items: Vec<T>,
        field: &str,
        convert: impl Fn(&Self, T, &str) -> Result<U, SceneError>,
    ) -> Result<Vec<U>, SceneError> {
        items
            .into_iter()
            .enumerate()
            .map(|(i, item)| convert(self, item, &format!("map.{field}[{i}]")))
            .collect()
    }

    fn shift_track(&self, track: &mut [Frame], field: &str) -> Result<(), SceneError> {
        for (f, state) in track.iter_mut().enumerate() {
            let Some(state) = state else { continue };
            let p = self.point(&field_if_refused(field, f, state, self.shift), state.position())?;
            (state.x, state.y) = (p.x, p.y);
            if !(state.heading.abs() < MAX_HEADING) {
                return Err(self.error(format!("{field}[{f}].heading"), state.heading, "a finite heading"));
            }
            for (name, v) in [("vx", state.vx), ("vy", state.vy)] {
                if !v.is_nan() && !(v.abs() < MAX_VELOCITY) {
                    let expected = "a velocity below 1000 m/s, or NaN if unknown";
                    return Err(self.error(format!("{field}[{f}].{name}"), v, expected));
                }
            }
        }
        Ok(())
    }

    /// Checks the responses of a certificate and transforms them into the scenario frame.
    fn certificate(&self, certificate: &mut Certificate, agents: &[LoggedAgent]) -> Result<(), SceneError> {
        let mut seen = BTreeSet::new();
        for (i, response) in certificate.responses.iter_mut().enumerate() {
            let field = format!("deviation.responses[{i}]");
            if !agents.iter().any(|a| a.agent.id == response.agent) || !seen.insert(response.agent.clone()) {
                let found = format!("`{}`", response.agent);
                return Err(self.error(format!("{field}.agent"), found, "the id of an agent, each once"));
            }
            if response.track.len() != FUTURE + 1 || response.reaction_step > FUTURE {
                let found =
                    format!("{} states, reaction at {}", response.track.len(), response.reaction_step);
                return Err(self.error(field, found, "81 states and a reaction step of at most 80"));
            }
            let mut track: Vec<Frame> = response.track.iter().copied().map(Some).collect();
            self.shift_track(&mut track, &field)?;
            response.track = track.into_iter().flatten().collect();
        }
        Ok(())
    }

    fn lanes(&mut self, mut parts: Vec<LaneParts>) -> Result<Vec<Lane>, SceneError> {
        let mut seen = BTreeSet::new();
        for (i, lane) in parts.iter().enumerate() {
            self.name(|| format!("map.lanes[{i}].id"), &lane.id)?;
            if !seen.insert(lane.id.clone()) {
                return Err(self.error(
                    format!("map.lanes[{i}].id"),
                    &lane.id,
                    "an id that no other lane has",
                ));
            }
        }
        let mut baselines = BTreeMap::new();
        for (i, lane) in parts.iter().enumerate() {
            let points = self.points(&format!("map.lanes[{i}].points"), &lane.points)?;
            if let Ok(line) = Polyline::new(&points) {
                baselines.insert(lane.id.clone(), line);
            }
        }
        self.splice(&mut parts, |id| baselines.contains_key(id))?;
        let index: BTreeMap<String, usize> =
            parts.iter().enumerate().map(|(i, l)| (l.id.clone(), i)).collect();
        let mut lanes = Vec::with_capacity(parts.len());
        for (i, lane) in parts.into_iter().enumerate() {
            let mut resolve = |ids: &[String]| -> Vec<usize> {
                let found: Vec<usize> = ids.iter().filter_map(|id| index.get(id).copied()).collect();
                for _ in found.len()..ids.len() {
                    self.repaired("links to missing lanes");
                }
                found
            };
            let (successors, predecessors) = (resolve(&lane.successors), resolve(&lane.predecessors));
            let mut resolve_neighbors = |neighbors: &[NeighborParts]| -> Vec<LaneNeighbor> {
                let of = |n: &NeighborParts| {
                    Some(LaneNeighbor {
                        lane: *index.get(&n.lane)?,
                        self_start: n.self_start,
                        self_end: n.self_end,
                        other_start: n.other_start,
                        other_end: n.other_end,
                    })
                };
                let found: Vec<LaneNeighbor> = neighbors.iter().filter_map(of).collect();
                for _ in found.len()..neighbors.len() {
                    self.repaired("links to missing lanes");
                }
                found
            };
            let (left, right) = (resolve_neighbors(&lane.left), resolve_neighbors(&lane.right));
            let area = match lane.area {
                LaneArea::Polygon(ring) => {
                    LaneArea::Polygon(self.points(&format!("map.lanes[{i}].polygon"), &ring)?)
                }
                LaneArea::Corridor { half_width } if half_width.is_finite() && half_width > 0.0 => {
                    LaneArea::Corridor { half_width }
                }
                LaneArea::Corridor { half_width } => {
                    let field = format!("map.lanes[{i}].half_width");
                    return Err(self.error(field, half_width, "a finite positive width"));
                }
            };
            if let Some(limit) = lane.speed_limit.filter(|v| !(v.is_finite() && *v > 0.0)) {
                return Err(self.error(
                    format!("map.lanes[{i}].speed_limit"),
                    limit,
                    "a positive speed or none",
                ));
            }
            let baseline = baselines.remove(&lane.id).expect("lanes without a baseline were removed");
            lanes.push(Lane {
                id: lane.id,
                kind: lane.kind,
                class: lane.class,
                speed_limit: lane.speed_limit,
                baseline,
                area,
                successors,
                predecessors,
                left,
                right,
            });
        }
        Ok(lanes)
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

/// Returns the field path of a state if its position will be refused, else an empty string: this runs for
/// every recorded state.
fn field_if_refused(field: &str, frame: usize, state: &AgentState, shift: Vec2) -> String {
    let q = state.position() - shift;
    if q.x.abs() < MAX_COORDINATE && q.y.abs() < MAX_COORDINATE {
        String::new()
    } else {
        format!("{field}[{frame}]")
    }
}

//! Checks of parts, and their coordinates. Every error names the field.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::Vec2;

use crate::limits::{MAX_BOX_SIZE, MAX_COORDINATE, MAX_HEADING, MAX_VELOCITY, drop_beyond};
use crate::{AgentState, Certificate, DT, Frame, Length, LoggedAgent, MapParts, ScenarioParts, SceneError};

/// Maximum length of the name of a scenario, an agent or a lane, bytes.
const MAX_NAME_BYTES: usize = 1000;
/// Maximum relative deviation of the median timestamp step from 0.1 s.
const STEP_TOLERANCE: f64 = 0.1;
/// Maximum time from a frame to the next, seconds: a recording with a longer gap is two recordings. Shorter
/// irregular steps are noted ([`crate::Scenario::notes`]).
const MAX_STEP: f64 = 1.0;

/// Checks and shifts the parts of a scenario.
pub(super) struct Builder {
    id: String,
    shift: Vec2,
    pub(super) length: Length,
    pub(super) repairs: BTreeMap<String, u32>,
}

impl Builder {
    pub(super) fn new(id: &str, length: Length) -> Self {
        Self { id: id.to_owned(), shift: Vec2::zeros(), length, repairs: BTreeMap::new() }
    }

    /// Returns the error for a list that does not have one entry per frame.
    pub(super) fn frames_error(&self, field: String, found: usize) -> SceneError {
        self.error(field, format!("{found} frames"), &format!("{} frames", self.length.frames()))
    }

    pub(super) fn check_length(&self) -> Result<(), SceneError> {
        if self.length.is_valid() {
            return Ok(());
        }
        let Length { history, future } = self.length;
        let value = format!("{history} frames of history and {future} after them");
        let (most, last) = (Length::MAX_HISTORY, Length::MAX_FUTURE);
        Err(self.error("length".into(), value, &format!("2 to {most}, and 1 to {last}")))
    }

    pub(super) fn error(&self, field: String, value: impl ToString, expected: &str) -> SceneError {
        SceneError { scenario: self.id.clone(), field, value: value.to_string(), expected: expected.into() }
    }

    pub(super) fn repaired(&mut self, what: &str) {
        *self.repairs.entry(what.to_owned()).or_default() += 1;
    }

    /// Checks a name, which is displayed and used in file names.
    pub(super) fn check_name(&self, field: impl Fn() -> String, name: &str) -> Result<(), SceneError> {
        if !name.is_empty() && name.len() <= MAX_NAME_BYTES && !name.contains(char::is_control) {
            return Ok(());
        }
        let begin: String = name.chars().take(60).collect();
        let found = format!("`{}` ({} bytes)", begin.escape_debug(), name.len());
        Err(self.error(field(), found, "a name of 1 to 1000 bytes without control characters"))
    }

    /// Checks a name that must differ from the names in `seen`.
    pub(super) fn check_new_name<'a>(
        &self,
        seen: &mut BTreeSet<&'a str>,
        field: impl Fn() -> String,
        name: &'a str,
        expected: &str,
    ) -> Result<(), SceneError> {
        self.check_name(&field, name)?;
        if seen.insert(name) { Ok(()) } else { Err(self.error(field(), name, expected)) }
    }

    pub(super) fn check_time(&self, timestamps: &[f64]) -> Result<(), SceneError> {
        if timestamps.is_empty() {
            return Ok(());
        }
        if timestamps.len() != self.length.frames() {
            let expected = format!("{} entries", self.length.frames());
            return Err(self.error("timestamps".into(), format!("{} entries", timestamps.len()), &expected));
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
        if let Some(i) = timestamps.windows(2).position(|w| w[1] - w[0] > MAX_STEP) {
            let value = format!("{:.3} s after the frame before", timestamps[i + 1] - timestamps[i]);
            let expected = "about 0.1 s; frames are missing here, choose a window before or after the gap";
            return Err(self.error(format!("timestamps[{}]", i + 1), value, expected));
        }
        Ok(())
    }

    pub(super) fn check_agents(&self, parts: &ScenarioParts) -> Result<(), SceneError> {
        if parts.av >= parts.agents.len() {
            let value = format!("{} of {} agents", parts.av, parts.agents.len());
            return Err(self.error("av".into(), value, "the index of an agent"));
        }
        let mut seen = BTreeSet::new();
        for (i, LoggedAgent { agent, track, .. }) in parts.agents.iter().enumerate() {
            if track.len() != self.length.frames() {
                return Err(self.frames_error(format!("agents[{i}].track"), track.len()));
            }
            for (name, size) in [("length", agent.length), ("width", agent.width)] {
                if !(size.is_finite() && (0.0..MAX_BOX_SIZE).contains(&size)) {
                    let field = format!("agents[{i}].{name}");
                    return Err(self.error(field, size, "a size of at least 0 and less than 1000 m"));
                }
            }
            self.check_new_name(
                &mut seen,
                || format!("agents[{i}].id"),
                &agent.id,
                "an id that no other agent has",
            )?;
        }
        let av = &parts.agents[parts.av].agent;
        if !av.has_extent() {
            let value = format!("{} m x {} m", av.length, av.width);
            return Err(self.error(format!("agents[{}]", parts.av), value, "a positive box size for the AV"));
        }
        Ok(())
    }

    /// Returns the world point of the origin, and shifts all further points to it if they are world
    /// coordinates.
    pub(super) fn set_origin(&mut self, parts: &ScenarioParts) -> Result<Vec2, SceneError> {
        let current = self.length.current();
        let Some(av_now) = parts.agents[parts.av].track[current] else {
            let field = format!("agents[{}].track[{current}]", parts.av);
            return Err(self.error(field, "absent", "the AV present at the current frame"));
        };
        let origin = parts.origin.unwrap_or_else(|| av_now.position());
        self.check_finite("origin", origin)?;
        if parts.origin.is_none() {
            self.shift = origin;
        }
        Ok(origin)
    }

    /// Checks that heights have the shape of what they belong to. Those that are not finite are unknown.
    pub(super) fn check_heights(
        &self,
        agents: &mut [LoggedAgent],
        map: &mut MapParts,
    ) -> Result<(), SceneError> {
        for (i, LoggedAgent { track, heights, .. }) in agents.iter_mut().enumerate() {
            if !(heights.is_empty() || heights.len() == track.len()) {
                let found = format!("{} heights", heights.len());
                return Err(self.error(format!("agents[{i}].heights"), found, "one per frame"));
            }
            for (height, state) in heights.iter_mut().zip(track) {
                *height = height.filter(|z| z.abs() < MAX_COORDINATE && state.is_some());
            }
        }
        let areas = map.drivable_area.as_deref().unwrap_or_default();
        let heights = &mut map.heights;
        self.check_lines("lanes", &mut heights.lanes, &map.lanes, |l| &l.points)?;
        self.check_lines("road_edges", &mut heights.road_edges, &map.road_edges, |e| &e.points)?;
        self.check_lines("road_lines", &mut heights.road_lines, &map.road_lines, |l| &l.points)?;
        self.check_lines("crosswalks", &mut heights.crosswalks, &map.crosswalks, |c| &c.outline)?;
        self.check_lines("speed_bumps", &mut heights.speed_bumps, &map.speed_bumps, |s| &s.outline)?;
        self.check_lines("driveways", &mut heights.driveways, &map.driveways, |s| &s.outline)?;
        self.check_lines("drivable_area", &mut heights.drivable_area, areas, |a| &a.exterior)
    }

    fn check_lines<T>(
        &self,
        field: &str,
        heights: &mut [Vec<f64>],
        items: &[T],
        points: fn(&T) -> &[Vec2],
    ) -> Result<(), SceneError> {
        let field = || format!("map.heights.{field}");
        if !heights.is_empty() && heights.len() != items.len() {
            let expected = format!("{}, one per item", items.len());
            return Err(self.error(field(), format!("{} lists", heights.len()), &expected));
        }
        for (i, (heights, item)) in heights.iter_mut().zip(items).enumerate() {
            let points = points(item).len();
            if !(heights.is_empty() || heights.len() == points) {
                let expected = format!("{points}, one per point");
                return Err(self.error(
                    format!("{}[{i}]", field()),
                    format!("{} heights", heights.len()),
                    &expected,
                ));
            }
            if heights.iter().any(|z| !(z.abs() < MAX_COORDINATE)) {
                heights.clear();
            }
        }
        Ok(())
    }

    fn check_finite(&self, field: &str, p: Vec2) -> Result<(), SceneError> {
        for (axis, v) in [("x", p.x), ("y", p.y)] {
            if !v.is_finite() {
                return Err(self.error(format!("{field}.{axis}"), v, "a finite coordinate"));
            }
        }
        Ok(())
    }

    /// Shifts a point. The field is named only if the point is refused: this runs for every recorded point.
    pub(super) fn point(&self, field: impl Fn() -> String, p: Vec2) -> Result<Vec2, SceneError> {
        let q = p - self.shift;
        // One test for NaN, infinity and distance.
        if q.x.abs() < MAX_COORDINATE && q.y.abs() < MAX_COORDINATE {
            return Ok(q);
        }
        self.check_finite(&field(), p)?;
        Err(self.error(field(), format!("({}, {})", p.x, p.y), "a point within 100 km of the AV"))
    }

    pub(super) fn shift_points(
        &self,
        points: &mut [Vec2],
        field: impl Fn() -> String,
    ) -> Result<(), SceneError> {
        points.iter_mut().try_for_each(|p| self.point(&field, *p).map(|q| *p = q))
    }

    pub(super) fn shift_each<T>(
        &self,
        items: &mut [T],
        field: &str,
        points: impl Fn(&mut T) -> &mut Vec<Vec2>,
    ) -> Result<(), SceneError> {
        let mut items = items.iter_mut().enumerate();
        items.try_for_each(|(i, item)| self.shift_points(points(item), || format!("{field}[{i}]")))
    }

    pub(super) fn shift_track<'a>(
        &self,
        track: impl Iterator<Item = Option<&'a mut AgentState>>,
        field: &str,
    ) -> Result<(), SceneError> {
        for (f, state) in track.enumerate() {
            let Some(state) = state else { continue };
            let p = self.point(|| format!("{field}[{f}]"), state.position())?;
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

    /// Removes the states of an agent without an extent that are beyond the limits.
    pub(super) fn drop_padding(&self, track: &mut [Frame]) {
        drop_beyond(track, self.shift);
    }

    /// Checks the responses of a certificate and transforms them into the scenario frame.
    pub(super) fn certificate(
        &self,
        certificate: &mut Certificate,
        agents: &[LoggedAgent],
    ) -> Result<(), SceneError> {
        let mut seen = BTreeSet::new();
        for (i, response) in certificate.responses.iter_mut().enumerate() {
            let field = format!("deviation.responses[{i}]");
            if !agents.iter().any(|a| a.agent.id == response.agent) || !seen.insert(response.agent.clone()) {
                let found = format!("`{}`", response.agent);
                return Err(self.error(format!("{field}.agent"), found, "the id of an agent, each once"));
            }
            let steps = self.length.future;
            if response.track.len() != steps + 1 || response.reaction_step > steps {
                let found =
                    format!("{} states, reaction at {}", response.track.len(), response.reaction_step);
                let expected = format!("{} states and a reaction step of at most {steps}", steps + 1);
                return Err(self.error(field, found, &expected));
            }
            self.shift_track(response.track.iter_mut().map(Some), &field)?;
        }
        Ok(())
    }
}

//! Columns for the certificates of deviated AVs, shared by scenario files and deviation files.

use std::ops::Range;

use reactsim_scene::{AgentState, Certificate, Effort, Length, Response};

use super::error::Cause;
use super::table::{Batch, Column, Leaf, TableWriter, Value, View};

/// Columns of a response's states.
const STATE_COLUMNS: [&str; 5] =
    ["response_x", "response_y", "response_heading", "response_vx", "response_vy"];
/// Accessors of the values of a state, in the order of its columns.
pub const STATE_VALUES: [fn(&AgentState) -> f64; 5] = [|s| s.x, |s| s.y, |s| s.heading, |s| s.vx, |s| s.vy];

/// Returns the columns that are read back; the other columns of [`columns`] are derived from them.
pub(crate) fn read_columns() -> impl Iterator<Item = &'static str> {
    let others = [
        "has_certificate",
        "response_agent",
        "response_leader",
        "response_reaction_step",
        "response_nudge",
        "response_peak_deceleration",
        "response_clearance",
        "response_required_deceleration",
        "response_time_to_react",
    ];
    others.into_iter().chain(STATE_COLUMNS)
}

/// Returns all columns, in file order.
pub fn columns() -> Vec<Column> {
    let number = |name, nullable| Column::new(name, Leaf::Number, 1, nullable);
    let mut all = vec![
        Column::new("has_certificate", Leaf::Flag, 0, false),
        Column::new("difficulty", Leaf::Text, 0, true),
        Column::new("required_deceleration", Leaf::Number, 0, true),
        Column::new("time_to_react", Leaf::Number, 0, true),
        Column::new("needs_swerve", Leaf::Flag, 0, true),
        Column::new("response_agent", Leaf::Text, 1, false),
        Column::new("response_leader", Leaf::Text, 1, true),
        Column::new("response_reaction_step", Leaf::Whole, 1, false),
        number("response_nudge", false),
        number("response_peak_deceleration", false),
        number("response_clearance", false),
        number("response_required_deceleration", true),
        number("response_time_to_react", true),
    ];
    all.extend(STATE_COLUMNS.map(|name| Column::new(name, Leaf::Number, 2, false)));
    all
}

/// Adds the cells of one row.
pub fn encode(t: &mut TableWriter, certificate: Option<&Certificate>) {
    let responses: &[Response] = certificate.map_or(&[], |c| &c.responses);
    t.column("has_certificate").push(Value::Flag(certificate.is_some()));
    let difficulty = certificate.and_then(Certificate::difficulty);
    t.column("difficulty").push(Value::from(difficulty.map(|d| d.name())));
    let deceleration = certificate.and_then(Certificate::required_deceleration);
    t.column("required_deceleration").push(Value::from(deceleration));
    t.column("time_to_react").push(Value::from(certificate.and_then(Certificate::time_to_react)));
    t.column("needs_swerve").push(certificate.map_or(Value::Null, |c| Value::Flag(c.needs_swerve())));
    t.column("response_agent").list(responses.iter().map(|r| Value::Text(&r.agent)));
    t.column("response_leader").list(responses.iter().map(|r| Value::from(r.leader.as_deref())));
    t.column("response_reaction_step").list(responses.iter().map(|r| Value::Whole(r.reaction_step as u32)));
    t.column("response_nudge").list(responses.iter().map(|r| Value::Number(r.nudge)));
    t.column("response_peak_deceleration").list(responses.iter().map(|r| Value::Number(r.peak_deceleration)));
    t.column("response_clearance").list(responses.iter().map(|r| Value::Number(r.clearance)));
    let effort = |value: fn(Effort) -> f64| responses.iter().map(move |r| Value::from(r.effort.map(value)));
    t.column("response_required_deceleration").list(effort(|e| e.required_deceleration));
    t.column("response_time_to_react").list(effort(|e| e.time_to_react));
    for (name, value) in STATE_COLUMNS.into_iter().zip(STATE_VALUES) {
        let track = |r: &Response| r.track.iter().map(|s| Value::Number(value(s))).collect::<Vec<_>>();
        t.column(name).lists(responses.iter().map(track));
    }
}

/// Returns the certificate of every row, `None` for all rows of files without these columns. Certificates of
/// files that were written before efforts were measured have no efforts.
pub fn decode(batch: &Batch) -> Result<Vec<Option<Certificate>>, Cause> {
    let rows = batch.num_rows();
    let Some(has) = View::find(batch, "has_certificate", Leaf::Flag, 0)? else { return Ok(vec![None; rows]) };
    let responses = ResponseColumns::find(batch)?;
    let of = |row| {
        let has = has.flag(row).ok_or_else(|| null_error(has.name()))?;
        let responses = responses.row(row)?;
        match (has, responses.is_empty()) {
            (true, _) => Ok(Some(Certificate { responses })),
            (false, true) => Ok(None),
            (false, false) => {
                Err(Cause::value("`has_certificate`", "false", "true for a row with responses"))
            }
        }
    };
    (0..rows).map(of).collect()
}

struct ResponseColumns {
    agents: View,
    steps: View,
    /// Nudge, peak deceleration and clearance.
    numbers: [View; 3],
    leaders: Option<View>,
    /// Required deceleration and time to react.
    efforts: Option<[View; 2]>,
    states: Vec<View>,
}

impl ResponseColumns {
    fn find(batch: &Batch) -> Result<Self, Cause> {
        let number = |name| View::need(batch, name, Leaf::Number, 1);
        let required = View::find(batch, "response_required_deceleration", Leaf::Number, 1)?;
        let times = View::find(batch, "response_time_to_react", Leaf::Number, 1)?;
        Ok(Self {
            agents: View::need(batch, "response_agent", Leaf::Text, 1)?,
            leaders: View::find(batch, "response_leader", Leaf::Text, 1)?,
            steps: View::need(batch, "response_reaction_step", Leaf::Whole, 1)?,
            numbers: [
                number("response_nudge")?,
                number("response_peak_deceleration")?,
                number("response_clearance")?,
            ],
            efforts: required.zip(times).map(|(a, b)| [a, b]),
            states: states_views(batch, STATE_COLUMNS, 2)?,
        })
    }

    fn row(&self, row: usize) -> Result<Vec<Response>, Cause> {
        let mut views: Vec<&View> = vec![&self.agents, &self.steps];
        views.extend(&self.numbers);
        views.extend(&self.states);
        views.extend(&self.leaders);
        views.extend(self.efforts.iter().flatten());
        let ranges = parallel_ranges(row, &views)?;
        let first = |view: &View| view.range(0, row).start;
        let response = |k: usize| {
            let number = |view: &View| view.number(first(view) + k).ok_or_else(|| null_error(view.name()));
            let [nudges, peaks, clearances] = &self.numbers;
            let effort = self.efforts.as_ref().and_then(|[required, times]| {
                Some(Effort {
                    required_deceleration: required.number(first(required) + k)?,
                    time_to_react: times.number(first(times) + k)?,
                })
            });
            let agent =
                self.agents.text(first(&self.agents) + k).ok_or_else(|| null_error(self.agents.name()))?;
            let leader = self.leaders.as_ref().and_then(|v| v.text(first(v) + k));
            let step =
                self.steps.whole(first(&self.steps) + k).ok_or_else(|| null_error(self.steps.name()))?;
            Ok(Response {
                agent: agent.to_owned(),
                leader: leader.map(str::to_owned),
                reaction_step: step as usize,
                nudge: number(nudges)?,
                peak_deceleration: number(peaks)?,
                clearance: number(clearances)?,
                effort,
                track: states(&self.states, |view| view.range(1, first(view) + k))?,
            })
        };
        (0..ranges[0].len()).map(response).collect()
    }
}

/// Returns the error of a null cell in a column that has no nulls.
pub fn null_error(column: &str) -> Cause {
    Cause::value(format!("`{column}`"), "null", "a value")
}

/// Finds the columns of states, as lists of nesting depth `depth`.
pub fn states_views(batch: &Batch, names: [&'static str; 5], depth: usize) -> Result<Vec<View>, Cause> {
    names.into_iter().map(|name| View::need(batch, name, Leaf::Number, depth)).collect()
}

/// Returns the lists of one row in several columns; they must have equal lengths.
pub fn parallel_ranges(row: usize, views: &[&View]) -> Result<Vec<Range<usize>>, Cause> {
    let ranges: Vec<Range<usize>> = views.iter().map(|v| v.range(0, row)).collect();
    for (view, range) in views.iter().zip(&ranges) {
        if range.len() != ranges[0].len() {
            let field = format!("`{}`", view.name());
            let expected = format!("{} values, as many as `{}`", ranges[0].len(), views[0].name());
            return Err(Cause::value(field, format!("{} values", range.len()), expected));
        }
    }
    Ok(ranges)
}

/// Reads the states at the steps from 0 on from one list of each column. Velocities may be unknown, positions
/// and headings may not.
pub fn states(views: &[View], list: impl Fn(&View) -> Range<usize>) -> Result<Vec<AgentState>, Cause> {
    let ranges: Vec<Range<usize>> = views.iter().map(&list).collect();
    let count = ranges.first().map_or(0, Range::len);
    if let Some((view, range)) = views.iter().zip(&ranges).find(|(_, range)| range.len() != count) {
        let (field, found) = (format!("`{}`", view.name()), format!("{} states", range.len()));
        return Err(Cause::value(field, found, format!("{count} states, as many as `{}`", views[0].name())));
    }
    if !(2..=Length::MAX_FUTURE + 1).contains(&count) {
        let (field, found) = (format!("`{}`", views[0].name()), format!("{count} states"));
        let expected = format!("2 to {} states: the current one and those after it", Length::MAX_FUTURE + 1);
        return Err(Cause::value(field, found, expected));
    }
    let state = |step: usize| {
        let value = |k: usize| {
            let v = views[k].number(ranges[k].start + step).unwrap_or(f64::NAN);
            if v.is_finite() || (k > 2 && v.is_nan()) {
                return Ok(v);
            }
            Err(Cause::value(format!("`{}` at step {step}", views[k].name()), v, "a finite number"))
        };
        Ok(AgentState { x: value(0)?, y: value(1)?, heading: value(2)?, vx: value(3)?, vy: value(4)? })
    };
    (0..count).map(state).collect()
}

//! Decodes columns into records.

use std::mem::take;
use std::ops::Range;

use reactsim_formats::{
    certificates::{self, null_error, parallel_ranges, states, states_views},
    error::Cause,
    table::{Batch, Leaf, View},
};
use reactsim_geometry::Vec2;
use reactsim_scene::{AgentState, Deviation};

use super::columns::STATE;
use crate::{
    Candidate, CandidateRecord, Decision, Figure, Offsets, Pressure, ReviewMark, ScenarioRecord, Taxonomy,
};

/// The columns of a row group, by name.
pub(super) struct Rows<'a> {
    batch: &'a Batch,
}

/// Cells of plain columns, each of which must exist.
impl<'a> Rows<'a> {
    pub(super) fn new(batch: &'a Batch) -> Self {
        Self { batch }
    }

    fn plain<T>(
        &self,
        name: &'static str,
        leaf: Leaf,
        get: impl Fn(&View, usize) -> Option<T>,
    ) -> Result<Vec<T>, Cause> {
        let view = View::need(self.batch, name, leaf, 0)?;
        let each = (0..self.batch.num_rows()).map(|row| get(&view, row).ok_or_else(|| null_error(name)));
        each.collect()
    }

    pub(super) fn texts(&self, name: &'static str) -> Result<Vec<String>, Cause> {
        self.plain(name, Leaf::Text, |v, row| v.text(row).map(str::to_owned))
    }

    pub(super) fn maybe_texts(&self, name: &'static str) -> Result<Vec<Option<String>>, Cause> {
        self.plain(name, Leaf::Text, |v, row| Some(v.text(row).map(str::to_owned)))
    }

    pub(super) fn flags(&self, name: &'static str) -> Result<Vec<bool>, Cause> {
        self.plain(name, Leaf::Flag, View::flag)
    }

    pub(super) fn wholes(&self, name: &'static str) -> Result<Vec<u32>, Cause> {
        self.plain(name, Leaf::Whole, View::whole)
    }

    fn numbers(&self, name: &'static str) -> Result<Vec<f64>, Cause> {
        self.plain(name, Leaf::Number, View::number)
    }

    /// Returns the scores; NaN for none.
    pub(super) fn scores(&self) -> Result<Vec<f64>, Cause> {
        self.plain("score", Leaf::Number, |v, row| Some(v.number(row).unwrap_or(f64::NAN)))
    }

    pub(super) fn categories(&self) -> Result<Vec<Deviation>, Cause> {
        self.texts("category")?.iter().map(|name| category("category", name)).collect()
    }

    pub(super) fn intents(&self) -> Result<Vec<Option<Deviation>>, Cause> {
        let names = self.maybe_texts("intent")?;
        names.iter().map(|name| name.as_deref().map(|n| category("intent", n)).transpose()).collect()
    }

    pub(super) fn reviews(&self) -> Result<Vec<Option<ReviewMark>>, Cause> {
        let (reviewers, times) = (self.maybe_texts("reviewer")?, self.maybe_texts("reviewed_at")?);
        let decisions = self.maybe_texts("decision")?;
        let each = reviewers.into_iter().zip(times).zip(decisions);
        each.map(|((reviewer, at), decision)| match (reviewer, at, decision) {
            (Some(reviewer), Some(at), Some(name)) => {
                let marks = [Decision::Pick, Decision::Reject, Decision::Flag];
                let wrong = || Cause::value("`decision`", format!("`{name}`"), "pick, reject or flag");
                let decision = marks.into_iter().find(|d| d.name() == name).ok_or_else(wrong)?;
                Ok(Some(ReviewMark { reviewer, at, decision }))
            }
            (None, None, None) => Ok(None),
            _ => {
                Err(Cause::value("`reviewer`, `reviewed_at`, `decision`", "partly null", "all or none given"))
            }
        })
        .collect()
    }

    /// Returns the rows of each scenario, in order.
    pub(super) fn scenarios(&self) -> Result<Vec<Range<usize>>, Cause> {
        let ids = View::need(self.batch, "scenario_id", Leaf::Text, 0)?;
        let (mut ranges, mut start) = (Vec::new(), 0);
        for row in 1..=self.batch.num_rows() {
            if row == self.batch.num_rows() || ids.text(row) != ids.text(start) {
                ranges.push(start..row);
                start = row;
            }
        }
        Ok(ranges)
    }

    /// Returns the states of every row.
    fn tracks(&self) -> Result<Vec<Vec<AgentState>>, Cause> {
        let views = states_views(self.batch, STATE, 1)?;
        let list = |row| states(&views, |view| view.range(0, row));
        (0..self.batch.num_rows()).map(list).collect()
    }

    fn figures(&self) -> Result<Vec<Vec<Figure>>, Cause> {
        let filters = View::need(self.batch, "filter", Leaf::Text, 1)?;
        let values = View::need(self.batch, "figure", Leaf::Number, 1)?;
        let passed = View::need(self.batch, "passed", Leaf::Flag, 1)?;
        let of = |row| {
            let ranges = parallel_ranges(row, &[&filters, &values, &passed])?;
            let figure = |k: usize| {
                let filter =
                    filters.text(ranges[0].start + k).ok_or_else(|| null_error("filter"))?.to_owned();
                let value = values.number(ranges[1].start + k);
                Ok(Figure { filter, value, passed: passed.flag(ranges[2].start + k) })
            };
            (0..ranges[0].len()).map(figure).collect()
        };
        (0..self.batch.num_rows()).map(of).collect()
    }

    pub(super) fn records(&self) -> Result<Vec<ScenarioRecord>, Cause> {
        let scenarios = self.scenarios()?;
        let (ids, digests) = (self.texts("scenario_id")?, self.texts("scenario_digest")?);
        let (x, y) = (self.numbers("origin_x")?, self.numbers("origin_y")?);
        let mut scenes = self.maybe_texts("scene")?;
        let mut candidates = self.candidates()?.into_iter();
        let record = |rows: Range<usize>| ScenarioRecord {
            scenario_id: ids[rows.start].clone(),
            scenario_digest: digests[rows.start].clone(),
            origin: Vec2::new(x[rows.start], y[rows.start]),
            scene: scenes[rows.start].take(),
            candidates: candidates.by_ref().take(rows.len()).collect(),
        };
        Ok(scenarios.into_iter().map(record).collect())
    }

    fn candidates(&self) -> Result<Vec<CandidateRecord>, Cause> {
        let mut sources = self.texts("source")?;
        let mut maneuvers = self.texts("maneuver")?;
        let (numbers, seeds, intents) = (self.wholes("candidate")?, self.texts("seed")?, self.intents()?);
        let (categories, branches) = (self.categories()?, self.flags("cue_other_branch")?);
        let headings = self.numbers("cue_heading_change")?;
        let laterals = self.numbers("cue_lateral_offset")?;
        let longitudinals = self.numbers("cue_longitudinal_offset")?;
        let conflicts = self.plain("cue_conflict_step", Leaf::Whole, |v, row| Some(v.whole(row)))?;
        let mut tracks = self.tracks()?;
        let mut figures = self.figures()?;
        let mut rejected = self.maybe_texts("rejected_by")?;
        let mut reasons = self.texts("reason")?;
        let (scores, chosen) = (self.scores()?, self.flags("chosen")?);
        let at_fault = self.wholes("pressure_at_fault")?;
        let (overlaps, risky) = (self.wholes("pressure_overlaps")?, self.wholes("pressure_risky")?);
        let ahead = self.numbers("endpoint_longitudinal")?;
        let aside = self.numbers("endpoint_lateral")?;
        let (ade, speed) = (self.numbers("ade")?, self.numbers("mean_speed_difference")?);
        let mut reviews = self.reviews()?;
        let mut certificates = certificates::decode(self.batch)?;
        let mut read = |row: usize| -> Result<CandidateRecord, Cause> {
            Ok(CandidateRecord {
                candidate: Candidate {
                    source: take(&mut sources[row]),
                    number: numbers[row],
                    intent: intents[row],
                    maneuver: take(&mut maneuvers[row]),
                    track: take(&mut tracks[row]),
                },
                seed: seeds[row].parse().map_err(|_| {
                    Cause::value("`seed`", format!("`{}`", seeds[row]), "a whole number below 2^64")
                })?,
                taxonomy: Taxonomy {
                    category: categories[row],
                    heading_change: headings[row],
                    other_branch: branches[row],
                    lateral_offset: laterals[row],
                    longitudinal_offset: longitudinals[row],
                    conflict_step: conflicts[row],
                },
                figures: take(&mut figures[row]),
                rejected_by: take(&mut rejected[row]),
                reason: take(&mut reasons[row]),
                score: scores[row],
                chosen: chosen[row],
                pressure: Pressure { at_fault: at_fault[row], overlaps: overlaps[row], risky: risky[row] },
                offsets: Offsets {
                    endpoint_longitudinal: ahead[row],
                    endpoint_lateral: aside[row],
                    ade: ade[row],
                    mean_speed_difference: speed[row],
                },
                review: take(&mut reviews[row]),
                certificate: take(&mut certificates[row]),
            })
        };
        let record = |row: usize| -> Result<CandidateRecord, Cause> {
            let record = read(row)?;
            let (states, expected) = (record.candidate.track.len(), "as many states as the candidate has");
            let mut responses = record.certificate.iter().flat_map(|c| &c.responses).map(|r| r.track.len());
            match responses.find(|count| *count != states) {
                Some(found) => Err(Cause::value("`response_x`", format!("{found} states"), expected)),
                None => Ok(record),
            }
        };
        (0..self.batch.num_rows()).map(record).collect()
    }
}

fn category(column: &str, name: &str) -> Result<Deviation, Cause> {
    let wrong = || Cause::value(column, format!("`{name}`"), "longitudinal, lateral or directional");
    Deviation::from_name(name).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use reactsim_formats::table::{Column, TableReader, TableWriter, Value};

    use super::*;

    /// Returns the reviews of a file of two rows, of which only the first is reviewed.
    fn reviews(decision: &str) -> Result<Vec<Option<ReviewMark>>, Cause> {
        let cells =
            [("reviewer", "ana"), ("reviewed_at", "2026-01-01T12:00:00.000Z"), ("decision", decision)];
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.parquet");
        let columns = cells.map(|(name, _)| Column::new(name, Leaf::Text, 0, true)).into();
        let mut table = TableWriter::create(&path, ("reviews", 1), 2, columns).unwrap();
        for is_reviewed in [true, false] {
            for (name, text) in cells {
                table.column(name).push(Value::from(is_reviewed.then_some(text)));
            }
            table.end_row().unwrap();
        }
        table.finish().unwrap();
        let batch = TableReader::open(&path).unwrap().group(0, &[]).unwrap();
        Rows::new(&batch).reviews()
    }

    #[test]
    fn invalid_decisions_are_refused() {
        for decision in [Decision::Pick, Decision::Reject, Decision::Flag] {
            let read = reviews(decision.name()).unwrap();
            assert_eq!((read[0].as_ref().map(|r| r.decision), &read[1]), (Some(decision), &None));
        }
        for wrong in ["love", "clear", ""] {
            let expected = format!("`decision` is `{wrong}`, expected pick, reject or flag");
            assert_eq!(reviews(wrong).unwrap_err().to_string(), expected);
        }
    }
}

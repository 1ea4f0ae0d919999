//! The columns of the file.

use reactsim_formats::{
    certificates,
    table::{Column, Leaf},
};

/// All columns, in the order of the file.
pub(super) fn columns() -> Vec<Column> {
    let text = |name| Column::new(name, Leaf::Text, 0, false);
    let maybe_text = |name| Column::new(name, Leaf::Text, 0, true);
    let number = |name| Column::new(name, Leaf::Number, 0, false);
    let numbers = |name| Column::new(name, Leaf::Number, 1, false);
    let whole = |name| Column::new(name, Leaf::Whole, 0, false);
    let flag = |name| Column::new(name, Leaf::Flag, 0, false);
    let mut all = vec![
        text("scenario_id"),
        text("scenario_digest"),
        number("origin_x"),
        number("origin_y"),
        text("source"),
        whole("candidate"),
        text("seed"),
        text("maneuver"),
        maybe_text("intent"),
        text("category"),
        number("cue_heading_change"),
        flag("cue_other_branch"),
        number("cue_lateral_offset"),
        number("cue_longitudinal_offset"),
        Column::new("cue_conflict_step", Leaf::Whole, 0, true),
        numbers("x"),
        numbers("y"),
        numbers("heading"),
        numbers("vx"),
        numbers("vy"),
        Column::new("filter", Leaf::Text, 1, false),
        Column::new("figure", Leaf::Number, 1, true),
        Column::new("passed", Leaf::Flag, 1, true),
        maybe_text("rejected_by"),
        text("reason"),
        Column::new("score", Leaf::Number, 0, true),
        flag("chosen"),
        whole("pressure_at_fault"),
        whole("pressure_overlaps"),
        whole("pressure_risky"),
        number("endpoint_longitudinal"),
        number("endpoint_lateral"),
        number("ade"),
        number("mean_speed_difference"),
        maybe_text("reviewer"),
        maybe_text("reviewed_at"),
        maybe_text("decision"),
    ];
    all.extend(certificates::columns());
    all.push(maybe_text("scene"));
    all
}

/// Columns of the values of a state, in order.
pub(super) const STATE: [&str; 5] = ["x", "y", "heading", "vx", "vy"];

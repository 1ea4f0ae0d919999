//! Junctions: signalised, with signs, roundabouts, and two of them in one map.
//!
//! Ranges follow US practice, in metres:
//!
//! * Lanes are 3.0 to 3.6 wide (AASHTO, *A Policy on Geometric Design of Highways and Streets*, 2018: 10 to
//!   12 feet on urban streets), bicycle lanes 1.5 to 1.8 (AASHTO bicycle guide: 5 to 6 feet), parking
//!   strips 2.4 to 2.6 (8 to 8.5 feet), medians with a pocket 4.0 to 5.8 (AASHTO: 16 to 18 feet are
//!   adequate, less in towns). Streets cross at 70 to 110 degrees (chosen; AASHTO: as near to 90 as can
//!   be).
//! * Kerb returns have 6 to 10 m radius (AASHTO: about 15 to 25 feet for cars, 30 and more where lorries
//!   turn), so right turns are driven with 7 to 12 m.
//! * Pockets are 30 to 60 m with a taper of 22 m (chosen; AASHTO sizes storage by the queue, tapers about
//!   8:1 in towns).
//! * Crosswalks, stop lines: MUTCD 2009, sections 3B.16 and 3B.18. No parking within 16 m of a stop line.
//! * Yellow: 1 s and v / (2 · 3.05 m/s²), the formula of the ITE (MUTCD: 3 to 6 s); all-red 1 to 2 s;
//!   greens of 8 s and more, cycles of 50 to 120 s (chosen).
//! * Roundabouts: within the ranges of TRB, NCHRP Report 672 (2010): inscribed circles of 38 to 46 m with
//!   one lane and 48 to 58 m with two, circulating lanes of 4.3 to 5.5 m, crosswalks one car length before
//!   the give-way line.
//! * Ranks of movements at signs: *Highway Capacity Manual*, two-way stop control. Flows are chosen: busy,
//!   below capacity.

mod control;
mod corner;
mod draw;
mod interior;
mod joined;
mod paint;
mod roundabout;
mod signalised;
mod street;
#[cfg(test)]
mod tests;
mod unsignalised;

pub(super) use joined::{signalised_and_t, signalised_pair};
pub(super) use roundabout::{roundabout_one_lane, roundabout_two_lanes};
pub(super) use signalised::{signalised_permissive, signalised_protected, signalised_t};
pub(super) use unsignalised::{all_way_stop, priority_four_way, priority_t};

//! The small nuPlan log of the unit tests. Its source expects two modules around it: `utm` and `tests`.

#[path = "../../../src/formats/nuplan/utm.rs"]
mod utm;

mod tests;

pub(super) use self::tests::small;

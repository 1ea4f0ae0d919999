//! temp
use std::path::Path;
use super::*;
use crate::rollout::Rollout;
use crate::scene::Scenario;
pub(super) fn write_part(_p: &Path, _s: &Scenario, _n: &str, _r: &[Rollout]) -> Result<(), EvaluationError> { Ok(()) }
pub(super) fn put_together(_f: &RunFolder, _t: &Tally) -> Result<(), EvaluationError> { Ok(()) }

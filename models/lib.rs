//! All baselines and training tasks of [reactsim](https://docs.rs/reactsim), one folder per family, and what
//! they share.

pub use reactsim_baseline::non_reactive::{constant_velocity, log_replay, stop};
pub use reactsim_baseline::{
    Allowed, Baseline, Card, ModelError, ParameterRange, Parameters, Ranges, Setup, WeightsFile, weights,
};
pub use reactsim_diffusion as diffusion;
pub use reactsim_diffusion::{ctg, planner as diffusion_planner, vbd};
pub use reactsim_idm as idm;
pub use reactsim_nn as nn;
pub use reactsim_nn::{learning, perception};
pub use reactsim_ntp as ntp;
pub use reactsim_nuplan_idm as nuplan_idm;
pub use reactsim_pufferdrive as pufferdrive;
pub use reactsim_qp as qp;
pub use reactsim_qp::regression as qp_regression;

use learning::TrainingTask;

/// All baselines, in the order in which tables list them.
pub const MODELS: &[Baseline] = &[
    log_replay::ENTRY,
    constant_velocity::ENTRY,
    stop::ENTRY,
    idm::ENTRY,
    idm::STYLES,
    nuplan_idm::ENTRY,
    ntp::entries::REACTIVE,
    ntp::entries::REACTIVE_RAW,
    ntp::guarded::GUARDED,
    ntp::entries::SMART,
    ntp::entries::SMART_PROJECTED,
    ntp::entries::SMART_SMALL,
    ntp::entries::TRAJTOK_SMALL,
    ntp::entries::CATK_SMALL,
    ntp::entries::SMART_REACTIVE,
    pufferdrive::ENTRY,
    qp_regression::entries::QP_REGRESSION,
    qp_regression::entries::REGRESSION,
    qp_regression::entries::MTR,
    vbd::entries::VBD,
    vbd::entries::VBD_INPAINTING,
    ctg::entries::CTG_CLONING,
    ctg::entries::CTG_DIFFUSION,
    ctg::entries::CTG_GUIDED,
];

/// Returns the baseline with this id.
pub fn find(id: &str) -> Option<&'static Baseline> {
    MODELS.iter().find(|m| m.id == id)
}

/// All training tasks.
pub const TASKS: &[TrainingTask] = &[
    ntp::learn::TASK,
    ntp::smart::learn::TASK,
    ntp::smart::learn::catk::TASK,
    ntp::smart::learn::grpo::TASK,
    ntp::realism::TASK,
    qp_regression::learn::TASK,
    vbd::learn::TASK,
    ctg::learn::TASK,
    diffusion_planner::learn::TASK,
];

/// Returns the training task with this id or earlier name.
pub fn find_task(id: &str) -> Option<&'static TrainingTask> {
    TASKS.iter().find(|task| task.id == id || task.also.contains(&id))
}

#[cfg(test)]
mod tests {
    use super::weights::{PLANNER, manifest, shipped};
    use super::*;

    #[test]
    fn manifest_and_files_agree() {
        let rows = manifest().unwrap();
        for (i, row) in rows.iter().enumerate() {
            let reads = |id: &str| id == PLANNER || find(id).is_some_and(|b| b.needs_weights);
            assert!(reads(&row.id) && row.also.iter().all(|id| reads(id)), "{}", row.id);
            assert!(rows[..i].iter().all(|r| (&r.id, &r.file) != (&row.id, &row.file)), "{} twice", row.file);
            assert!(row.sha256.len() == 64 && row.sha256.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f')));
            assert_eq!(row.shipped, row.made.is_some(), "{}: what ships was made here", row.file);
            assert!(row.source.is_some() || row.made.is_some(), "{}", row.file);
            if row.shipped {
                let id = find(&row.id).map_or(PLANNER, |baseline| baseline.id);
                assert!(rows[..i].iter().all(|r| r.id != row.id || !r.shipped), "two files for {}", row.id);
                assert_eq!(shipped(id).unwrap().unwrap().bytes.len() as u64, row.bytes);
            }
        }
        for (name, _) in weights::embedded() {
            assert!(rows.iter().any(|r| r.file == *name && r.shipped), "{name} has no row");
        }
    }
}

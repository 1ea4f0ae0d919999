#![no_main]
//! Maps of Argoverse 2, beside a good table.

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made};

fuzz_target!(|data: &[u8]| {
    static TABLE: OnceLock<std::path::PathBuf> = OnceLock::new();
    let table = TABLE.get_or_init(|| file("scenario_made-1.parquet", &made::argoverse2_tracks()));
    file("log_map_archive_made-1.json", data);
    ask(table, "argoverse2");
});

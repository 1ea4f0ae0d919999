#![no_main]
//! Tables of Argoverse 2, beside a good map.

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made};

fuzz_target!(|data: &[u8]| {
    static MAP: OnceLock<()> = OnceLock::new();
    MAP.get_or_init(|| {
        file("log_map_archive_made-1.json", &made::argoverse2_map());
    });
    ask(&file("scenario_made-1.parquet", data), "argoverse2");
});

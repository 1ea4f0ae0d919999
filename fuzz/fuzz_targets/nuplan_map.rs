#![no_main]
//! Maps of nuPlan, byte by byte, with a good log.

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made, map_of};

fuzz_target!(|data: &[u8]| {
    static LOG: OnceLock<std::path::PathBuf> = OnceLock::new();
    let log = LOG.get_or_init(|| file("f.db", &made::nuplan_log()));
    map_of(data);
    ask(log, "nuplan");
});

#![no_main]
//! Logs and maps of nuPlan in which tables, rows and cells are changed.

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, edits, file, made, map_of};

fuzz_target!(|data: &[u8]| {
    static FILES: OnceLock<[Vec<u8>; 2]> = OnceLock::new();
    let [log, map] = FILES.get_or_init(|| [made::nuplan_log(), made::nuplan_map()]);
    let (mut log, mut map) = (file("f.db", log), map_of(map));
    edits::apply(data, [&mut log, &mut map]);
    ask(&log, "nuplan");
});

#![no_main]
//! Selections of windows of nuPlan, and the list of maps.

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made};

fuzz_target!(|data: &[u8]| {
    static FILES: OnceLock<()> = OnceLock::new();
    FILES.get_or_init(|| {
        file("logs/f.db", &made::nuplan_log());
        file("maps/town/1.0/map.gpkg", &made::nuplan_map());
    });
    // A list of maps may follow behind a zero.
    let mut parts = data.splitn(2, |b| *b == 0);
    let (selection, list) = (parts.next().unwrap_or_default(), parts.next());
    file("maps/nuplan-maps-v1.0.json", list.unwrap_or(made::LIST.as_bytes()));
    ask(&file("f.json", selection), "nuplan");
});

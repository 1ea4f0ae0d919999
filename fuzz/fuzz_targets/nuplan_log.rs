#![no_main]
//! Logs of nuPlan, byte by byte, with a good map.

use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made};

fuzz_target!(|data: &[u8]| {
    static MAPS: OnceLock<()> = OnceLock::new();
    MAPS.get_or_init(|| {
        file("maps/nuplan-maps-v1.0.json", made::LIST.as_bytes());
        file("maps/town/1.0/map.gpkg", &made::nuplan_map());
    });
    ask(&file("f.db", data), "nuplan");
});

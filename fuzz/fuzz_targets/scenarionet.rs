#![no_main]
//! ScenarioNet pickles.

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file};

fuzz_target!(|data: &[u8]| {
    ask(&file("f.pkl", data), "scenarionet");
});

#![no_main]
//! GPUDrive and Nocturne files.

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file};

fuzz_target!(|data: &[u8]| {
    ask(&file("f.json", data), "gpudrive");
});

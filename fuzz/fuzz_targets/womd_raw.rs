#![no_main]
//! Whole files of Waymo: framing and compression.

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file};

fuzz_target!(|data: &[u8]| {
    ask(&file("f.tfrecord", data), "womd");
});

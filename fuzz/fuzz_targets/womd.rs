#![no_main]
//! One record of Waymo, with the checksums that it needs.

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made};

fuzz_target!(|data: &[u8]| {
    ask(&file("f.tfrecord", &made::framed(&[data.to_vec()])), "womd");
});

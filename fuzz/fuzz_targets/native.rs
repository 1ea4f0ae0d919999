#![no_main]
//! Native files, with checksums that hold.

use libfuzzer_sys::fuzz_target;
use reactsim_fuzz::{ask, file, made};

fuzz_target!(|data: &[u8]| {
    ask(&file("f.parquet", &made::repaired(data)), "native");
});

//! Reads scenarios of any format and prints what they contain.
//!
//! ```sh
//! cargo run --release --example read_logs -- scenarios/mini
//! ```

// Examples print; the library does not.
#![allow(clippy::print_stdout, clippy::print_stderr)]

use std::env;
use std::path::PathBuf;

use reactsim::formats;
use reactsim::scene::{AgentKind, CURRENT};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini");
    let path: PathBuf = env::args_os().nth(1).map_or_else(|| default.into(), Into::into);
    for scenario in formats::open(&path)? {
        // One scenario that cannot be read does not end the file.
        let scenario = match scenario {
            Ok(scenario) => scenario,
            Err(error) => {
                eprintln!("{error}");
                continue;
            }
        };
        let vehicles = scenario.start.agents.iter().filter(|a| a.kind == AgentKind::Vehicle).count();
        let av = scenario.logged(0);
        let speed = av[CURRENT].map_or(f64::NAN, |state| state.speed());
        println!(
            "{}: {} agents ({vehicles} vehicles), {} lanes, AV at {speed:.1} m/s",
            scenario.id,
            scenario.start.agents.len(),
            scenario.start.map.lanes.len(),
        );
    }
    Ok(())
}

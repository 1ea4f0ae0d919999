//! Inputs of the format nuPlan.

use std::fs;
use std::path::{Path, PathBuf};

use reactsim_test_support::nuplan::Fixture;

/// Writes a log, its map and the list of maps to a folder.
pub(super) fn small(folder: &Path) -> Vec<PathBuf> {
    let fixture = Fixture::write();
    let town = folder.join("maps/town/1.0");
    fs::create_dir_all(&town).unwrap();
    let copies = [
        (&fixture.log, folder.join("made.db")),
        (&fixture.map, town.join("map.gpkg")),
        (&fixture.list, folder.join("maps/nuplan-maps-v1.0.json")),
    ];
    for (from, to) in &copies {
        fs::copy(from, to).unwrap();
    }
    copies.map(|(_, to)| to).into()
}

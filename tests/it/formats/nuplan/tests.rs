use std::fs;
use std::path::{Path, PathBuf};

#[expect(dead_code, reason = "only the unit tests change logs and maps by SQL")]
#[path = "../../../../src/formats/nuplan/tests/fixture.rs"]
mod fixture;

/// Writes a log, its map and the list of maps to a folder.
pub(in crate::formats) fn small(folder: &Path) -> Vec<PathBuf> {
    let fixture = fixture::Fixture::new();
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

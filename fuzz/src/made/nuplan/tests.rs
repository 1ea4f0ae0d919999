#[path = "../../../../src/formats/nuplan/tests/fixture.rs"]
mod small;

/// A log and a map as the tests of the main package make them; they are removed when this is dropped.
pub(super) struct Files {
    pub(super) log: std::path::PathBuf,
    pub(super) map: std::path::PathBuf,
    _kept: small::Fixture,
}

pub(super) fn made() -> Files {
    let made = small::Fixture::new();
    Files { log: made.log.clone(), map: made.map.clone(), _kept: made }
}

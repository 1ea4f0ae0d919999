//! `reactsim speed` measures networks and compares backends.

use crate::reference::said;

#[test]
fn backends_are_measured_and_compared() {
    let arguments = ["speed", "--limit", "1", "--models", "smart-small", "--batches", "2", "--rounds", "1"];
    let backends = if cfg!(feature = "ndarray") { "flex,ndarray" } else { "flex,flex" };
    let (table, _) = said(&[&arguments[..], &["--backends", backends]].concat(), 0);
    let rows: Vec<&str> = table.lines().skip(2).collect();
    assert_eq!(rows.len(), 2, "{table}");
    assert!(
        rows[0].starts_with("| `smart-small` | flex |") && rows[0].ends_with("| - | - | - | - |"),
        "{table}"
    );
    assert!(rows[1].contains(" % |") && !rows[1].ends_with("- |"), "{table}");
}

#[test]
fn what_cannot_be_measured_is_refused() {
    for (arguments, reason) in [
        (&["--models", "idm"][..], "`idm` has no network"),
        (&["--set", "vbd.agents=3"][..], "`vbd`, which --models does not name"),
        (&["--backends", "tpu"][..], "this program contains flex"),
        (&["--agreement", "1.5"][..], "expected 0 to 1"),
    ] {
        let (_, error) = said(&[&["speed", "--limit", "1", "--batches", "1"][..], arguments].concat(), 2);
        assert!(error.contains(reason), "{arguments:?}: {error}");
    }
}

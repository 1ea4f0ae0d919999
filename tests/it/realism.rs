//! Realism of sets of scenarios: statistics with known values, sets of any size, and the output for users.

use reactsim::formats::find_inputs;
use reactsim::generation::realism::{Comparison, Measured, Quantity, Tally, divergence, measure};
use reactsim::geometry::{Vec2, direction, smooth_step};
use reactsim::report::{realism_charts, realism_tables};
use reactsim::scene::{Agent, AgentKind, AgentState, FRAMES, LoggedAgent, Scenario, ScenarioParts};

use crate::program::program;
use crate::small_scenarios;

/// Returns a straight road of two lanes with an AV at 6 m/s, 22.5 m of gap ahead and 4.5 m behind, and a
/// neighbour at 7 m/s.
fn parts() -> ScenarioParts {
    small_scenarios::parts(0, false)
}

fn measured(parts: ScenarioParts) -> Tally {
    measure(&Scenario::assemble(parts).unwrap())
}

/// Returns another vehicle; `state` takes the seconds since the first frame.
fn vehicle(id: &str, state: impl Fn(f64) -> AgentState) -> LoggedAgent {
    LoggedAgent {
        agent: Agent { id: id.to_owned(), kind: AgentKind::Vehicle, length: 4.5, width: 2.0 },
        track: (0..FRAMES).map(|f| Some(state(0.1 * f as f64))).collect(),
        heights: Vec::new(),
    }
}

fn standing(x: f64, y: f64) -> AgentState {
    AgentState { x, y, heading: 0.0, vx: 0.0, vy: 0.0 }
}

fn mean(tally: &Tally, quantity: Quantity) -> f64 {
    tally.of(quantity).mean().unwrap_or_else(|| panic!("{quantity:?} has no values"))
}

#[track_caller]
fn near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-6, "{found} instead of {expected}");
}

#[test]
fn a_steady_road_has_the_figures_that_it_was_made_with() {
    let tally = measured(parts());
    near(mean(&tally, Quantity::Speed), 6.25);
    for nothing in [
        Quantity::Acceleration,
        Quantity::YawRate,
        Quantity::Jerk,
        Quantity::LaneOffset,
        Quantity::Stopped,
        Quantity::Parked,
        Quantity::Turning,
        Quantity::LaneChanges,
        Quantity::PedestriansNear,
    ] {
        near(mean(&tally, nothing), 0.0);
    }
    let gaps = tally.of(Quantity::Headway);
    near(gaps.quantile(0.5).unwrap(), 4.5);
    near(gaps.quantile(0.99).unwrap(), 22.5);
    near(mean(&tally, Quantity::Headway), 13.5);
    near(mean(&tally, Quantity::TimeGap), 13.5 / 6.0);
    near(mean(&tally, Quantity::MinTtc), 10.0);
    near(mean(&tally, Quantity::AgentsNear), 3.0);
    near(mean(&tally, Quantity::VehiclesNear), 3.0);
    near(mean(&tally, Quantity::AvDistance), 48.0);
    near(mean(&tally, Quantity::VehicleLength), 4.5);
}

#[test]
fn a_change_of_lane_is_counted_once() {
    let mut parts = parts();
    parts.agents[3] = vehicle("beside", |t| {
        let y = 3.5 * (1.0 - smooth_step((t - 3.0) / 3.0));
        AgentState { x: -9.0 + 7.0 * t, y, heading: 0.0, vx: 7.0, vy: 0.0 }
    });
    let rate = mean(&measured(parts), Quantity::LaneChanges);
    // Three vehicles drive 54 m each, the fourth 63 m with a little sideways motion.
    assert!((4.3..=4.5).contains(&rate), "{rate} changes per kilometre");
}

#[test]
fn weaving_in_a_lane_is_no_change() {
    let mut parts = parts();
    parts.agents[3] = vehicle("beside", |t| {
        let y = 3.5 - 1.9 * (smooth_step((t - 2.0) / 2.0) - smooth_step((t - 5.0) / 2.0));
        AgentState { x: -9.0 + 7.0 * t, y, heading: 0.0, vx: 7.0, vy: 0.0 }
    });
    near(mean(&measured(parts), Quantity::LaneChanges), 0.0);
}

#[test]
fn who_is_parked_stopped_or_turning_is_told_apart() {
    let mut parts = parts();
    parts.agents.push(vehicle("parked", |_| standing(20.0, -3.0)));
    parts.agents.push(vehicle("waiting", |_| standing(80.0, 3.5)));
    parts.agents.push(vehicle("behind it", |_| standing(73.0, 3.5)));
    parts.agents.push(vehicle("turning", |t| {
        let (radius, angle) = (20.0, 0.3 * t - 1.5);
        let p = Vec2::new(0.0, 40.0) + direction(angle) * radius;
        let v = direction(angle + std::f64::consts::FRAC_PI_2) * 6.0;
        AgentState { x: p.x, y: p.y, heading: angle + std::f64::consts::FRAC_PI_2, vx: v.x, vy: v.y }
    }));
    let tally = measured(parts);
    near(mean(&tally, Quantity::Stopped), 3.0 / 8.0);
    near(mean(&tally, Quantity::NeverMoving), 3.0 / 8.0);
    near(mean(&tally, Quantity::Parked), 1.0 / 8.0);
    near(mean(&tally, Quantity::Turning), 1.0 / 5.0);
    near(mean(&tally, Quantity::StandstillGap), 2.5);
    // 17 values of 0.3 rad/s among 5 times as many.
    near(mean(&tally, Quantity::YawRate), 0.3 / 5.0);
}

#[test]
fn who_closes_in_has_a_time_to_collision() {
    let mut parts = parts();
    parts.agents[2] = vehicle("ahead", |t| {
        let x =
            22.5 + 4.5 + 6.0 + (6.0 - 1.0 * t.min(3.0) / 2.0) * t.min(3.0) + 3.0 * (t - 3.0).max(0.0) - 6.0;
        AgentState { x, y: 0.0, heading: 0.0, vx: 6.0 - t.min(3.0), vy: 0.0 }
    });
    let tally = measured(parts);
    let least = tally.of(Quantity::MinTtc).quantile(0.01).unwrap();
    assert!(0.0 < least && least < 6.0, "{least} s");
    // Braking at 1 m/s² for three seconds; fits across the end of it give less.
    near(tally.of(Quantity::Acceleration).quantile(0.01).unwrap(), -1.0);
}

/// Perception noise in every frame must not be taken for driving.
#[test]
fn noise_is_not_acceleration() {
    let mut parts = parts();
    for (k, state) in parts.agents.iter_mut().flat_map(|a| a.track.iter_mut().flatten()).enumerate() {
        // A sequence without a period within a second.
        let noise = ((k * 7919) % 101) as f64 / 50.0 - 1.0;
        state.vx += 0.1 * noise;
        state.heading += 0.01 * noise;
    }
    let tally = measured(parts);
    let spread = |q: Quantity| {
        let h = tally.of(q);
        h.quantile(0.9).unwrap() - h.quantile(0.1).unwrap()
    };
    assert!(spread(Quantity::Acceleration) < 0.3, "{}", spread(Quantity::Acceleration));
    assert!(spread(Quantity::YawRate) < 0.03, "{}", spread(Quantity::YawRate));
}

fn set(numbers: impl Iterator<Item = usize>, jobs: usize) -> Measured {
    let records = numbers.map(|i| move || Ok::<_, String>(small_scenarios::deviating(i, false)));
    Measured::of(records, jobs, |error| panic!("{error}"))
}

#[test]
fn threads_decide_nothing() {
    let one = set(0..40, 1);
    assert_eq!(one, set(0..40, 5));
    assert_eq!((one.halves[0].scenarios, one.halves[1].scenarios), (20, 20));
    assert_eq!(one.whole().of(Quantity::AvDistance).n(), 40);
}

#[test]
fn what_can_not_be_read_is_counted() {
    let records = (0..5).map(|i| {
        move || if i == 3 { Err(format!("record {i}")) } else { Ok(small_scenarios::deviating(i, false)) }
    });
    let mut told = Vec::new();
    let set = Measured::of(records, 2, |error| told.push(error));
    assert_eq!((set.failures, told), (1, vec!["record 3".to_owned()]));
    assert_eq!(set.whole().scenarios, 4);
}

#[test]
fn a_set_is_like_itself_and_nothing_is_like_an_empty_one() {
    let (a, nothing) = (set(0..20, 2), Measured::default());
    for row in Comparison::new(("a", &a), ("a", &a)).rows {
        assert_eq!(row.divergence.unwrap_or(0.0), 0.0, "{}", row.id);
    }
    assert!(Comparison::new(("nothing", &nothing), ("a", &a)).rows.iter().all(|r| r.divergence.is_none()));
}

#[test]
fn tables_and_pictures_have_every_statistic() {
    let (a, b) = (set(0..20, 2), set(20..30, 2));
    let comparison = Comparison::new(("one|set", &a), ("another", &b));
    let text = |write: fn(&mut dyn std::io::Write, &Comparison) -> std::io::Result<()>| {
        let mut out = Vec::new();
        write(&mut out, &comparison).unwrap();
        String::from_utf8(out).unwrap()
    };
    let tables = text(realism_tables::write_markdown);
    assert!(tables.starts_with("one\\|set (20 scenarios) against another (10 scenarios)."), "{tables}");
    let svg = realism_charts::draw(&comparison).unwrap();
    assert_eq!(svg, realism_charts::draw(&comparison).unwrap());
    for quantity in Quantity::ALL {
        let title = quantity.spec().title;
        assert!(tables.contains(&format!("| {title} ")) && svg.contains(title), "{title}");
    }
    let csv = text(realism_tables::write_csv);
    assert_eq!(csv.lines().count(), 1 + 2 * Quantity::ALL.len());
    assert!(csv.lines().all(|l| l.split(',').count() == 11), "{csv}");
    let json: serde_json::Value = serde_json::from_str(&text(realism_tables::write_json)).unwrap();
    assert_eq!(json["rows"][0]["id"], "speed");
    assert_eq!(json["rows"][0]["generated"]["histogram"].as_array().unwrap().len(), 16);
}

#[test]
fn the_program_compares_files() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a.parquet"), folder.path().join("b.parquet"));
    let svg = folder.path().join("a.svg");
    small_scenarios::write(&a, (0..10).map(|i| small_scenarios::deviating(i, false)));
    small_scenarios::write(&b, (10..14).map(|i| small_scenarios::deviating(i, false)));
    let reactsim = |arguments: &[&std::ffi::OsStr]| {
        let mut program = program();
        program.args(["generate", "compare"]).args(arguments).output().unwrap()
    };
    let done =
        reactsim(&[a.as_ref(), b.as_ref(), "--limit".as_ref(), "6".as_ref(), "--svg".as_ref(), svg.as_ref()]);
    let printed = String::from_utf8(done.stdout).unwrap();
    assert!(done.status.success() && done.stderr.is_empty(), "{}", String::from_utf8_lossy(&done.stderr));
    assert!(printed.starts_with("a.parquet (6 scenarios) against b.parquet (4 scenarios)."), "{printed}");
    assert!(std::fs::read_to_string(&svg).unwrap().contains("a.parquet: 6 scenarios"));
    let missing = reactsim(&[folder.path().join("c.parquet").as_ref(), b.as_ref()]);
    assert_eq!(missing.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&missing.stderr).contains("c.parquet"));
}

/// A turn over the outer lanes of a junction is not a change of lane.
#[test]
fn turning_wide_is_no_change() {
    let mut parts = parts();
    parts.agents[3] = vehicle("beside", |t| {
        let u = smooth_step((t - 3.0) / 3.0);
        AgentState {
            x: -9.0 + 7.0 * t,
            y: 3.5 * (1.0 - u),
            heading: 0.45 * (1.0 - 2.0 * u),
            vx: 7.0,
            vy: 0.0,
        }
    });
    near(mean(&measured(parts), Quantity::LaneChanges), 0.0);
}

/// Differences by chance between halves of the recordings must be far below the limit for generated sets.
#[test]
fn halves_of_the_recordings_are_alike() {
    let Some(folder) = crate::shared("data/womd/train") else { return };
    let records = find_inputs(&folder).unwrap().into_iter();
    let records = records.flat_map(|i| i.open_undecoded().unwrap());
    let set = Measured::of(records.map(|r| move || r.and_then(|decode| decode())), 2, |e| panic!("{e}"));
    for quantity in Quantity::ALL.into_iter().filter(|q| q.decides()) {
        let of = |k: usize| set.halves[k].of(quantity).counts();
        let apart = divergence(&of(0), &of(1)).unwrap();
        assert!(apart < 0.05, "{}: {apart}", quantity.spec().id);
    }
}

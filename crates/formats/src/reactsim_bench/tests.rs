//! Files of every layout, whose AVs leave a log along a bend.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::f64::consts::PI;
use std::fs;
use std::path::PathBuf;

use reactsim_geometry::wrap;
use reactsim_scene::Deviation;
use reactsim_test_support::nuplan::{Fixture, ORIGIN, bench_name};
use reactsim_test_support::pickle::{Py, pickle};

use super::content::category_in;
use super::decide::is_clear;
use super::{BenchName, Choice, Located, Point, decide, locate, measure, sidecar};

/// Rows of the log that become current frames.
const ROWS: [u32; 6] = [22, 29, 36, 43, 50, 57];
/// Distance from the rear axle to the centre of the AV, metres.
const TO_CENTER: f64 = 1.461;

type Pose = [f64; 3];

/// Pose of the rear axle after a time, s: along a bend, faster and faster.
fn logged(time: f64) -> Pose {
    let turn = 0.05 * (6.0 * time + 0.2 * time * time);
    [-40.0 + 20.0 * turn.sin(), 20.0 - 20.0 * turn.cos(), turn]
}

/// Poses of the rear axle in the 91 frames around a row: the AV leaves the log to the other side.
fn deviated(row: u32) -> Vec<Pose> {
    let now = 0.05 * f64::from(row);
    let mut poses: Vec<Pose> = (0..=10).map(|k| logged(now - 1.0 + 0.1 * f64::from(k))).collect();
    let [mut x, mut y, mut heading] = poses[10];
    let (mut speed, mut curvature) = (6.0 + 0.4 * now, 0.05);
    for _ in 0..80 {
        let by = 0.1 * speed;
        let middle = heading + 0.5 * curvature * by;
        (x, y, heading) = (x + by * middle.cos(), y + by * middle.sin(), heading + curvature * by);
        poses.push([x, y, heading]);
        (speed, curvature) = (speed - 0.02, f64::max(curvature - 0.004, -0.06));
    }
    poses.iter().map(|[x, y, h]| [ORIGIN.0 + x, ORIGIN.1 + y, *h]).collect()
}

fn centers(poses: &[Pose]) -> Vec<Pose> {
    poses.iter().map(|[x, y, h]| [x + TO_CENTER * h.cos(), y + TO_CENTER * h.sin(), *h]).collect()
}

/// Poses relative to a position, in axes with a heading.
fn within(poses: &[Pose], [x, y, _]: Pose, turn: f64) -> Vec<Pose> {
    let (cos, sin) = (turn.cos(), turn.sin());
    let one = |p: &Pose| {
        let (dx, dy) = (p[0] - x, p[1] - y);
        [cos * dx + sin * dy, cos * dy - sin * dx, p[2] - turn]
    };
    poses.iter().map(one).collect()
}

fn array<const N: usize>(poses: &[Pose], row: impl Fn(&Pose) -> [f64; N]) -> Py {
    Py::Array(vec![poses.len(), N], poses.iter().flat_map(row).collect())
}

fn plain(poses: &[Pose]) -> Py {
    array(poses, |p| *p)
}

fn vector(poses: &[Pose]) -> Py {
    array(poses, |[x, y, h]| [*x, *y, h.cos(), h.sin()])
}

fn dict<const N: usize>(entries: [(&str, Py); N]) -> Py {
    Py::Dict(entries.map(|(key, value)| (key.to_owned(), value)).into())
}

/// The trajectory in a slot of an array of agents, of which the others are elsewhere; the columns are made of a
/// pose.
fn agents<const N: usize>(poses: &[Pose], slot: usize, row: impl Fn(&Pose) -> [f64; N]) -> Py {
    let moved = |by: f64| poses.iter().map(move |[x, y, h]| [x + by, y - by, *h]);
    let numbers = (0..4).flat_map(|i| moved(if i == slot { 0.0 } else { 9.0 + 7.0 * i as f64 }));
    Py::Array(vec![4, poses.len(), N], numbers.flat_map(|p| row(&p)).collect())
}

/// Column of each row of an object.
fn list(poses: &[Pose], column: usize) -> Py {
    Py::List(poses.iter().map(|p| Py::Num(p[column])).collect())
}

/// Layouts: name, content of the file for the poses of the rear axle and a number, and a part of what is printed, or
/// of the refusal.
type Make = fn(&[Pose], usize) -> Py;
const FOUND: &[(&str, Make, &str)] = &[
    ("global", |a, _| plain(&a[11..]), "80 × 3, `the array`, global, rear axle, first entry is frame 11"),
    ("centre", |a, _| plain(&centers(a)[10..]), "global, box centre, first entry is frame 10"),
    ("history", |a, _| dict([("ego", plain(a))]), "91 × 3, `ego`, global, rear axle, first entry is frame 0"),
    ("planner", |a, _| vector(&within(&a[11..], a[10], a[10][2])), "frame av, rear axle"),
    (
        "sine first",
        |a, _| array(&a[11..], |[x, y, h]| [*x, *y, h.sin(), h.cos()]),
        "headings as cosine and sine in columns 3 and 2",
    ),
    (
        "cache",
        |a, _| {
            let c = centers(a);
            let local = within(&c, c[10], a[10][2]);
            let past = agents(&local[..11], 0, |[x, y, h]| [*x, *y, *h, 1.0, 0.0, 5.176, 2.297, 1.7]);
            dict([
                ("agents_history", past),
                ("agents_future", agents(&local[10..], 0, |[x, y, h]| [*x, *y, *h, 1.0, 0.0])),
            ])
        },
        "81 × 5, `agents_future`, frame av, box centre, first entry is frame 10",
    ),
    (
        "agents with an index",
        |a, i| {
            let (c, slot) = (centers(a), 1 + i % 3);
            let headings: Vec<f64> = (0..4).flat_map(|_| c.iter().map(|p| p[2])).collect();
            let agent = dict([
                ("position", agents(&c, slot, |[x, y, _]| [*x, *y, 0.0])),
                ("heading", Py::Array(vec![4, 91], headings)),
                ("av_index", Py::Int(slot as i64)),
            ]);
            dict([("agent", agent)])
        },
        "`agent.position`[index of the AV], global, box centre, first entry is frame 0",
    ),
    (
        "ten columns",
        |a, _| {
            dict([("track", array(&centers(a), |[x, y, h]| [*x, *y, 0.0, 5.2, 2.3, 1.8, *h, 0.0, 0.0, 1.0]))])
        },
        "headings in column 6",
    ),
    ("2 Hz", |a, _| plain(&a[15..].iter().step_by(5).copied().collect::<Vec<_>>()), "16 × 3"),
    (
        "2 Hz from now",
        |a, _| plain(&centers(a)[10..].iter().step_by(5).copied().collect::<Vec<_>>()),
        "17 × 3",
    ),
    ("5 Hz", |a, _| plain(&a[12..].iter().step_by(2).copied().collect::<Vec<_>>()), "0.20 s apart"),
    (
        "one short",
        |a, _| plain(&a[10..90]),
        "80 × 3, `the array`, global, rear axle, first entry is frame 10",
    ),
    (
        "rows of a list",
        |a, _| Py::List(a[11..].iter().map(|p| Py::List(p.map(Py::Num).into())).collect()),
        "80 × 3",
    ),
    (
        "lists",
        |a, _| dict([("x", list(&a[11..], 0)), ("y", list(&a[11..], 1)), ("yaw", list(&a[11..], 2))]),
        "`x,y`, global, rear axle",
    ),
    (
        "records",
        |a, _| {
            let one =
                |p: &Pose| dict([("x", Py::Num(p[0])), ("y", Py::Num(p[1])), ("heading", Py::Num(p[2]))]);
            Py::List(a[11..].iter().map(one).collect())
        },
        "`x,y`, global, rear axle",
    ),
    (
        "objects",
        |a, _| {
            let pose = |p: &Pose| {
                let state = dict([("x", Py::Num(p[0])), ("y", Py::Num(p[1])), ("_heading", Py::Num(p[2]))]);
                Py::Object(Box::new(dict([("rear_axle", Py::Object(Box::new(state)))])))
            };
            Py::Tuple(vec![Py::Text("plan".to_owned()), Py::List(a[11..].iter().map(pose).collect())])
        },
        "`[1].rear_axle.x,rear_axle.y`, global, rear axle",
    ),
    ("attribute", |a, _| Py::Object(Box::new(dict([("states", plain(&a[11..]))]))), "`states`"),
    (
        "tokens as keys",
        |a, i| Py::Dict(vec![(format!("{:016x}", 0xabc + i), dict([("av", plain(&a[11..]))]))]),
        "`*.av`",
    ),
    ("offset", |a, _| plain(&within(&a[11..], centers(a)[10], 0.0)), "frame av-offset, rear axle"),
    ("first frame", |a, _| plain(&within(a, a[0], a[0][2])), "frame first, rear axle"),
    (
        "stated origin",
        |a, i| {
            let at = [a[3][0] + i as f64, a[3][1] - 4.0, 0.7];
            dict([("center", Py::List(at.map(Py::Num).into())), ("pos", plain(&within(&a[11..], at, 0.7)))])
        },
        "origin and heading in `center`",
    ),
    ("in a list", |a, _| Py::List(vec![plain(&a[11..])]), "`the array`, global, rear axle"),
    ("in a tuple", |a, _| Py::Tuple(vec![plain(&a[11..])]), "`the array`, global, rear axle"),
    (
        "list of agents",
        |a, _| {
            let of =
                |by: f64| plain(&a[11..].iter().map(|[x, y, h]| [x + by, y - by, *h]).collect::<Vec<_>>());
            dict([("agents", Py::List([9.0, 0.0, 30.0].map(of).into()))])
        },
        "`agents`[1], global, rear axle",
    ),
    (
        "names as keys",
        |a, i| {
            let key = bench_name(0, ROWS[i]).replace(".pkl", "");
            Py::Dict(vec![(key.clone(), Py::List(vec![plain(&a[11..])])), (key + "b", plain(&a[..80]))])
        },
        "`*`, global, rear axle",
    ),
    (
        "two tokens as keys",
        |a, _| {
            let far: Vec<Pose> = a[11..].iter().map(|[x, y, h]| [x + 50.0, *y, *h]).collect();
            Py::Dict([(1, plain(&far)), (2, plain(&a[11..]))].map(|(n, v)| (format!("{n:016x}"), v)).into())
        },
        "`*#2`, global, rear axle",
    ),
    (
        "headings from differences",
        |a, _| {
            let c = within(&centers(a), centers(a)[10], a[10][2]);
            let turned = |k: usize| [c[k][0], c[k][1], (c[k][1] - c[k - 1][1]).atan2(c[k][0] - c[k - 1][0])];
            plain(&(11..91).map(turned).collect::<Vec<_>>())
        },
        "frame av, box centre",
    ),
    (
        "no headings, rear axle",
        |a, _| array(&within(&a[11..], a[10], a[10][2]), |[x, y, _]| [*x, *y]),
        "frame av, rear axle",
    ),
    (
        "a column like headings",
        |a, _| array(&within(&a[11..], a[10], a[10][2]), |[x, y, h]| [*x, *y, 0.8 * h]),
        "headings from the motion",
    ),
    ("no headings", |a, _| array(&centers(a)[10..], |[x, y, _]| [*x, *y]), "headings from the motion"),
    (
        "degrees",
        |a, _| array(&a[11..], |[x, y, h]| [*x, *y, h * 180.0 / PI]),
        "headings in degrees in column 2",
    ),
    ("time first", |a, _| array(&a[10..], |[x, y, h]| [0.5, *x, *y, *h]), "x in column 1"),
    (
        "columns as rows",
        |a, _| Py::Array(vec![3, 80], (0..3).flat_map(|c| a[11..].iter().map(move |p| p[c])).collect()),
        "rear axle",
    ),
    (
        "tensor",
        |a, _| {
            let local = within(&a[11..], a[10], a[10][2]);
            dict([("pos", Py::Tensor(vec![80, 3], vec![3, 1], local.concat()))])
        },
        "`pos`, frame av, rear axle",
    ),
    (
        "part of a tensor",
        |a, _| {
            let local = within(&a[11..], a[10], a[10][2]);
            let numbers = local.iter().flat_map(|[x, y, h]| [*x, *y, *h, 3.0, 4.0]).collect();
            dict([("pos", Py::Tensor(vec![1, 80, 3], vec![400, 5, 1], numbers))])
        },
        "`pos`, frame av, rear axle",
    ),
    (
        "with the log",
        |a, i| {
            let now = 0.05 * f64::from(ROWS[i]);
            let log = (1..=80).map(|k| logged(now + 0.1 * f64::from(k)));
            let log: Vec<Pose> = log.map(|[x, y, h]| [ORIGIN.0 + x, ORIGIN.1 + y, h]).collect();
            dict([("gt", plain(&log)), ("pred", plain(&a[11..]))])
        },
        "`pred`",
    ),
];

/// Layouts that are not unique, or none.
const REFUSED: &[(&str, Make, &str)] = &[
    (
        "nothing",
        |_, i| dict([("n", Py::Int(i as i64)), ("name", Py::Text("lateral".to_owned()))]),
        "no array continues",
    ),
    (
        "noise",
        |a, i| array(&a[11..], |p| [p[0] * 1e-3, p[1] % 7.0, i as f64]),
        "the file: an array of shape (80, 3)",
    ),
    (
        "samples",
        |a, _| {
            let samples = [1.0, 0.9, 0.8].map(|by| {
                within(&a[11..], a[10], a[10][2]).iter().map(|p| [by * p[0], p[1], p[2]]).collect::<Vec<_>>()
            });
            dict([("samples", Py::Array(vec![3, 80, 3], samples.concat().concat()))])
        },
        "several layouts fit equally well",
    ),
    (
        "another one among many that are the same",
        |a, _| {
            let same = vec![within(&a[11..], a[10], a[10][2]); 14];
            let other = same[0].iter().map(|p| [0.8 * p[0], p[1], p[2]]).collect();
            dict([("samples", Py::Array(vec![15, 80, 3], [same, vec![other]].concat().concat().concat()))])
        },
        "several layouts fit equally well",
    ),
    (
        "axle or centre",
        |a, _| {
            let middle: Vec<Pose> = a
                .iter()
                .zip(&centers(a))
                .map(|(a, c)| [0.5 * (a[0] + c[0]), 0.5 * (a[1] + c[1]), a[2]])
                .collect();
            plain(&within(&middle[11..], middle[10], a[10][2]))
        },
        "frame av, box centre",
    ),
    (
        "the log alone in the frame of the AV",
        |_, i| {
            let now = 0.05 * f64::from(ROWS[i]);
            let log: Vec<Pose> = (0..=80).map(|k| logged(now + 0.1 * f64::from(k))).collect();
            plain(&within(&log[1..], log[0], log[0][2]))
        },
        "it is the logged drive",
    ),
    (
        "the log alone",
        |_, i| {
            let now = 0.05 * f64::from(ROWS[i]);
            let log = (1..=80).map(|k| logged(now + 0.1 * f64::from(k)));
            plain(&log.map(|[x, y, h]| [ORIGIN.0 + x, ORIGIN.1 + y, h]).collect::<Vec<_>>())
        },
        "it is the logged drive",
    ),
];

/// Imports the files of a layout; returns what is printed, or the refusal, and the largest error of a
/// trajectory.
fn import(
    fixture: &Fixture,
    make: Make,
    [protocol, numpy]: [u8; 2],
    choice: &Choice,
) -> Result<(String, f64), String> {
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for (i, row) in ROWS.iter().enumerate() {
        let path = folder.path().join(bench_name(0, *row));
        fs::write(&path, pickle(&make(&deviated(*row), i), protocol, numpy)).unwrap();
        files.push((path.clone(), BenchName::of(&path).unwrap()));
    }
    let files: Vec<&(PathBuf, BenchName)> = files.iter().collect();
    let located: Result<Vec<Located>, String> = locate(&fixture.log, &files).unwrap().into_iter().collect();
    let mut refused = Vec::new();
    let (files, tally) = measure(located.unwrap(), choice, &mut refused);
    assert_eq!(refused, []);
    let decided = decide(&files, &tally, choice).map_err(|error| error.to_string())?;
    let mut worst = 0.0_f64;
    for (track, row) in decided.tracks.iter().zip(ROWS) {
        for (state, [x, y, h]) in track.as_ref().unwrap().iter().zip(&centers(&deviated(row))[11..]) {
            worst = worst.max((state.x - x).hypot(state.y - y)).max(wrap(state.heading - h).abs());
        }
    }
    Ok((decided.about, worst))
}

fn fixture() -> Fixture {
    Fixture::write().drive(|row| logged(0.05 * f64::from(row)))
}

#[test]
fn every_layout_is_found_by_its_content() {
    let fixture = fixture();
    let mut wrong = String::new();
    for (i, (layout, make, expected)) in FOUND.iter().enumerate() {
        let versions = [2 + (i % 4) as u8, 1 + (i / 4 % 2) as u8];
        let tolerance = match *layout {
            "no headings" | "no headings, rear axle" | "a column like headings" => 0.2,
            "headings from differences" => 0.1,
            layout if layout.contains("Hz") || layout == "one short" => 0.05,
            layout if layout.contains("tensor") => 1e-4,
            _ => 1e-6,
        };
        let found = import(&fixture, *make, versions, &Choice::default());
        if !matches!(&found, Ok((about, error)) if about.contains(expected) && *error <= tolerance) {
            wrong.push_str(&format!("{layout}: {found:#?}, expected {expected}\n"));
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn layouts_that_are_not_unique_are_refused_with_what_decides() {
    let fixture = fixture();
    for (layout, make, expected) in REFUSED {
        let text = import(&fixture, *make, [4, 2], &Choice::default()).unwrap_err();
        assert!(text.contains(expected), "{layout}: {text}");
        assert!(text.contains("State what is meant: `array` KEY"), "{layout}: {text}");
    }
    let make = |wanted: &str| REFUSED.iter().find(|(layout, ..)| *layout == wanted).unwrap().1;
    let array = Some("samples[0]".to_owned());
    let (about, error) =
        import(&fixture, make("samples"), [4, 2], &Choice { array, ..Choice::default() }).unwrap();
    assert!(error < 1e-6, "{about}: {error}");
    let point = Some(Point::Axle);
    let (about, error) =
        import(&fixture, make("axle or centre"), [4, 2], &Choice { point, ..Choice::default() }).unwrap();
    assert!(about.contains("rear axle") && error < 1.5, "{about}: {error}");
}

#[test]
fn lists_of_categories_are_read_in_any_format() {
    let [a, b] =
        [bench_name(0, 1), bench_name(0, 2)].map(|name| name.strip_suffix(".pkl").unwrap().to_owned());
    for text in [
        format!("file,category\n{a}.pkl,lateral\n{b}.pkl,directional\n"),
        format!("{{\"lateral\": [\"{a}\"], \"directional\": [\"{b}\"]}}"),
        format!("{{\"{a}.pkl\": \"Lateral\", \"x/{b}.pkl\": \"directional\"}}"),
        format!(
            "[{{\"category\": \"lateral\", \"file\": \"{a}\"}}, {{\"category\": \"directional\", \"file\": \"{b}\"}}]"
        ),
    ] {
        let found = sidecar(&text);
        let expected = [(a.clone(), Deviation::Lateral), (b.clone(), Deviation::Directional)];
        assert_eq!(found.into_iter().collect::<Vec<_>>(), expected, "{text}");
    }
}

#[test]
fn only_texts_that_are_a_category_state_one() {
    let [a, b] = [bench_name(0, 1), bench_name(0, 2)];
    assert_eq!(sidecar(&format!("file,longitudinal,lateral,directional\n{a},1,0,0\n")).len(), 0);
    let found = sidecar(&format!("file,category\n{a},\n{b},lateral\n"));
    assert_eq!(found.into_values().collect::<Vec<_>>(), [Deviation::Lateral]);
    assert_eq!(sidecar(&format!("lateral\n{a}\n{b}\n")).len(), 2);
    assert_eq!(category_in("Lateral_deviation"), Some(Deviation::Lateral));
    assert_eq!(category_in("high_lateral_acceleration"), None);
}

#[test]
fn one_file_does_not_decide_which_frame_its_name_names() {
    let files = |count: usize| is_clear(std::iter::repeat_n(0.03, count));
    assert!(!files(1) && !files(4) && files(5));
}

#[test]
fn columns_that_are_stated_may_follow_others() {
    let make: Make = |a, _| array(&a[11..], |[x, y, h]| [1.0, 2.0, 3.0, *x, *y, *h]);
    let columns = ["a", "b", "c", "x", "y", "heading"].map(str::to_owned).to_vec();
    let choice = Choice { columns, ..Choice::default() };
    let (about, error) = import(&fixture(), make, [4, 2], &choice).unwrap();
    assert!(about.contains("x in column 3") && error < 1e-6, "{about}: {error}");
}

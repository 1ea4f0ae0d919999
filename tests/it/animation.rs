//! Animations: the content of the file that `inspect --gif` writes.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use gif::{ColorOutput, DecodeOptions, Repeat};
use reactsim::evaluation::CASE_STUDIES;
use reactsim::formats;
use reactsim::report::animation::{Animation, Panel};
use reactsim::report::birdseye::{Mark, MarkKind};
use reactsim::scene::{CURRENT, Frame, Scenario};

use crate::program::{BENCH, MINI, refused, said, text};
use crate::small_scenarios::{deviating, parts, write};

const CROSSING: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/mini/crossing.json");

/// Pixels above and below a panel.
const AROUND: usize = 46;

/// An animation as a viewer shows it: per moment all pixels (red, green, blue, alpha), and its delay.
struct Film {
    width: usize,
    height: usize,
    moments: Vec<Vec<[u8; 4]>>,
    /// Hundredths of a second.
    delays: Vec<u16>,
    forever: bool,
}

fn film(bytes: &[u8]) -> Film {
    let mut options = DecodeOptions::new();
    options.set_color_output(ColorOutput::RGBA);
    let mut decoder = options.read_info(Cursor::new(bytes)).unwrap();
    let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
    let mut screen = vec![[0_u8; 4]; width * height];
    let (mut moments, mut delays) = (Vec::new(), Vec::new());
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        let (left, top) = (usize::from(frame.left), usize::from(frame.top));
        let (wide, high) = (usize::from(frame.width), usize::from(frame.height));
        assert!(left + wide <= width && top + high <= height, "a part outside the picture");
        for (k, pixel) in frame.buffer.chunks_exact(4).enumerate() {
            if pixel[3] != 0 {
                screen[(top + k / wide) * width + left + k % wide].copy_from_slice(pixel);
            }
        }
        moments.push(screen.clone());
        delays.push(frame.delay);
    }
    assert!(moments.iter().flatten().all(|p| p[3] == 255), "every pixel is covered from the start");
    Film { width, height, moments, delays, forever: decoder.repeat() == Repeat::Infinite }
}

/// Returns the first scenario of a file.
fn first(path: &str) -> Scenario {
    formats::open(Path::new(path)).unwrap().next().unwrap().unwrap()
}

#[test]
fn a_scenario_becomes_a_film() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    for out in [path("a.gif"), path("b.gif")] {
        assert!(said(&["inspect", CROSSING, "--gif", &out], 0).0.contains("scenario"));
    }
    let bytes = fs::read(path("a.gif")).unwrap();
    assert!(bytes == fs::read(path("b.gif")).unwrap(), "the same twice");
    assert!(bytes.len() < 600_000, "{} bytes", bytes.len());
    let film = film(&bytes);
    assert_eq!((film.width, film.height), (480, 480 + AROUND));
    assert_eq!(film.moments.len(), 81);
    assert!(film.forever);
    assert!(film.delays[..80].iter().all(|d| *d == 10), "{:?}", film.delays);
    assert_eq!(film.delays[80], 100, "the end is held");
    for pair in film.moments.windows(2) {
        assert_ne!(pair[0], pair[1], "the AV moves");
    }
}

#[test]
fn what_does_not_move_stays_as_it_is() {
    // Agents that stand as in the log have no ghosts: only the time and the event change.
    let mut parts = parts(0, false);
    for agent in &mut parts.agents {
        agent.track = vec![agent.track[CURRENT]; agent.track.len()];
    }
    let scenario = Scenario::assemble(parts).unwrap();
    let tracks: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    let mark = Mark { agent: scenario.start.agents[1].id.clone(), step: 30, kind: MarkKind::AtFault };
    let panel = Panel { title: "still".into(), rollout: Some(&tracks), marks: vec![mark] };
    let animation = Animation { size: 200, ..Animation::new(&scenario, vec![panel]) };
    let film = film(&animation.encode().unwrap());
    let panel = |k: usize| film.moments[k][26 * 200..226 * 200].to_vec();
    assert!((1..30).all(|k| panel(k) == panel(0)), "nothing moves before the event");
    assert_ne!(panel(29), panel(30), "the event appears");
    assert!((31..81).all(|k| panel(k) == panel(30)), "and stays");
    let bar = |k: usize| film.moments[k][226 * 200..].to_vec();
    assert_ne!(bar(0), bar(40), "time runs");
}

#[test]
fn panels_stand_side_by_side_and_steps_can_be_left_out() {
    let scenario = first(&format!("{MINI}/platoon.json"));
    let panels = vec![Panel { title: "a".into(), ..Panel::default() }; 2];
    let animation = Animation { size: 160, every: 30, ..Animation::new(&scenario, panels) };
    let film = film(&animation.encode().unwrap());
    assert_eq!((film.width, film.height), (2 * 160 + 8, 160 + AROUND));
    assert_eq!(film.delays, [300, 300, 200, 100]);
    for moment in &film.moments {
        for row in moment.chunks_exact(film.width) {
            assert_eq!(row[..160], row[168..], "both show the same");
        }
    }
    let following = Animation { size: 160, follow: true, ..animation };
    assert_ne!(self::film(&following.encode().unwrap()).moments, film.moments);
}

#[test]
fn a_generated_scenario_is_small() {
    let bytes = Animation::new(&first(BENCH), Vec::new()).encode().unwrap();
    assert!(bytes.len() < 600_000, "{} bytes", bytes.len());
    assert_eq!(film(&bytes).moments.len(), 81);
}

#[test]
fn the_picture_of_the_readme_is_whole() {
    let bytes = fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/reacting.gif")).unwrap();
    assert!(bytes.len() < 700_000, "{} bytes", bytes.len());
    let film = film(&bytes);
    assert_eq!((film.width, film.height, film.moments.len()), (2 * 400 + 8, 400 + AROUND, 81));
}

#[test]
fn wrong_arguments_are_told_with_the_mend() {
    let error = |arguments: &[&str]| refused(&[&["inspect", CROSSING], arguments].concat());
    let nowhere = "/nowhere/at/all.gif";
    assert!(
        error(&["--gif", nowhere, "--every", "40", "--size", "100"])
            .contains("could not write /nowhere/at/all.gif")
    );
    assert!(error(&["--gif", "x.gif", "--size", "5"]).contains("100..=1200"));
    assert!(error(&["--gif", "x.gif", "--every", "0"]).contains("1..=40"));
    assert!(error(&["--gif", "x.gif", "--radius", "1"]).contains("--radius is 1, expected 5 to 1000 m"));
    assert!(error(&["--size", "200"]).contains("--gif <FILE>"));
    assert!(error(&["--follow"]).contains("--gif <FILE>"));
    assert!(error(&["--gif", "x.gif", "--simulator", "nobody"]).contains("`nobody`"));
    assert!(error(&["--simulator", "idm"]).contains("--svg <FILE>"));
    assert!(error(&["--gif", "x.gif", "--case", "cut-in"]).contains("cannot be used with"));
    assert!(error(&["--gif", "x.gif", "--rollout", "RUN"]).contains("--simulator <ID>"));
    let two = error(&["--svg", "x.svg", "--rollout", "RUN", "--simulator", "idm,stop"]);
    assert!(two.contains("give one --simulator, or draw all of them with --gif alone"), "{two}");
    let unknown = error(&["--gif", "x.gif", "--rollout", "/nowhere", "--simulator", "idm"]);
    assert!(unknown.contains("/nowhere has no rollouts.parquet: run with --keep-rollouts"), "{unknown}");
    assert!(!Path::new("x.gif").exists());
}

#[test]
fn simulators_that_are_run_on_the_spot_do_as_in_a_run() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    let run = path("run");
    said(&["run", CROSSING, "--models", "log-replay,idm", "--keep-rollouts", "--out", &run], 0);
    let draw = |more: &[&str], out: &str| {
        let picture = ["inspect", CROSSING, "--simulator", "log-replay,idm", "--gif", out];
        said(&[&picture[..], more].concat(), 0);
        fs::read(out).unwrap()
    };
    let (live, recorded) = (draw(&[], &path("live.gif")), draw(&["--rollout", &run], &path("recorded.gif")));
    assert!(live == recorded, "a run and the same on the spot differ");
    let [left, right] = film(&live).moments.last().map(|m| split(m, 480)).unwrap();
    assert_ne!(left, right, "the two simulators differ");
}

/// Splits a moment into the pixels of its two panels.
fn split(moment: &[[u8; 4]], size: usize) -> [Vec<[u8; 4]>; 2] {
    let rows = || moment.chunks_exact(2 * size + 8);
    [rows().flat_map(|r| r[..size].to_vec()).collect(), rows().flat_map(|r| r[size + 8..].to_vec()).collect()]
}

#[test]
fn every_case_study_is_in_the_shipped_benchmark() {
    for (case, category) in CASE_STUDIES.iter().zip(["longitudinal", "lateral", "directional", "directional"])
    {
        let (text, _) = said(&["inspect", "--case", case.name], 0);
        assert!(text.contains(case.scenario) && text.contains(category), "{text}");
        assert!(
            text.contains("is enough to avoid the AV") && text.contains("answers the AV, for example by"),
            "{text}"
        );
        assert!(include_str!("../../docs/benchmark-card.md").contains(case.scenario), "{case:?}");
    }
    let (_, wrong) = said(&["inspect", "--case", "nothing"], 2);
    assert!(wrong.contains("hard-stop, cut-in, turn-across, merge"), "{wrong}");
}

#[test]
fn a_scenario_without_deviated_av_has_nothing_to_react_to() {
    let home = tempfile::tempdir().unwrap();
    let path = home.path().join("plain.parquet");
    write(&path, [deviating(0, false)]);
    let (_, error) = said(&["inspect", text(&path), "--simulator", "idm", "--gif", "x.gif"], 2);
    assert!(error.contains("has no deviated AV"), "{error}");
}

//! The review page: answers and refusals of its server, and the scenes that it draws.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, UNIX_EPOCH};

use reactsim::curation::review::{Journal, ReviewError, ReviewOptions, ReviewServer, candidate_digest};
use reactsim::curation::store::Store;
use reactsim::curation::{Decision, ScenarioRecord};
use reactsim::formats;
use reactsim::web::{Stop, sketch};
use serde_json::{Value, json};

use super::hand;
use crate::small_scenarios;

/// Returns scenarios that can be drawn, with hand-made candidates.
pub(super) fn records(count: usize) -> Vec<ScenarioRecord> {
    let record = |i: usize| {
        let drawn = small_scenarios::scenario(i);
        ScenarioRecord { scene: Some(sketch(&drawn)), ..hand::scenario(&drawn.id, 6) }
    };
    (0..count).map(record).collect()
}

/// Writes a file of such scenarios to a new folder.
pub(super) fn file(count: usize) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("set.parquet");
    hand::write(&path, &records(count));
    (folder, path)
}

/// A server in a thread, which ends when this is dropped.
struct Serving {
    port: u16,
    token: String,
    stop: Stop,
    thread: Option<JoinHandle<Result<(), ReviewError>>>,
}

impl Serving {
    fn new(path: &Path, reviewer: Option<&str>) -> Self {
        let options = ReviewOptions {
            reviewer: reviewer.map(Into::into),
            clock: Box::new(|| UNIX_EPOCH + Duration::from_millis(1_772_366_400_007)),
            ..ReviewOptions::default()
        };
        let server = ReviewServer::new(Store::open(path).unwrap(), options).unwrap();
        let url = server.url();
        let rest = url.strip_prefix("http://127.0.0.1:").unwrap();
        let (port, token) = rest.trim_end_matches('/').split_once('/').unwrap();
        let (port, token) = (port.parse().unwrap(), token.to_owned());
        let stop = Stop::default();
        let handle = stop.clone();
        let thread = Some(std::thread::spawn(move || server.run(&handle)));
        Self { port, token, stop, thread }
    }

    /// Sends a request. Returns status and text of the answer, including its head.
    fn ask(&self, method: &str, path: &str, headers: &str, body: &str) -> (u16, String) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        let length = body.len();
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\n{headers}Connection: close\r\nContent-Length: {length}\r\n\r\n{body}"
        )
        .unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let status = answer.split(' ').nth(1).and_then(|s| s.parse().ok());
        (status.unwrap_or_else(|| panic!("no status: {answer:?}")), answer)
    }

    fn host(&self) -> String {
        format!("Host: 127.0.0.1:{}\r\n", self.port)
    }

    fn get(&self, path: &str) -> (u16, Value) {
        let (status, answer) = self.ask("GET", &format!("/{}/{path}", self.token), &self.host(), "");
        (status, body(&answer))
    }

    fn post(&self, path: &str, value: &Value) -> (u16, Value) {
        let headers = format!("{}Content-Type: application/json\r\n", self.host());
        let path = format!("/{}/{path}", self.token);
        let (status, answer) = self.ask("POST", &path, &headers, &value.to_string());
        (status, body(&answer))
    }
}

impl Drop for Serving {
    fn drop(&mut self) {
        self.stop.stop();
        let ended = self.thread.take().unwrap().join();
        if !std::thread::panicking() {
            ended.unwrap().unwrap();
        }
    }
}

/// Returns the body of an answer, as JSON or as a text.
fn body(answer: &str) -> Value {
    let text = answer.split_once("\r\n\r\n").unwrap().1;
    serde_json::from_str(text).unwrap_or_else(|_| text.into())
}

#[test]
fn nothing_is_answered_without_the_token() {
    let (_folder, path) = file(1);
    let server = Serving::new(&path, None);
    assert_eq!(server.token.len(), 32);
    let ask = |path: &str| server.ask("GET", path, &server.host(), "").0;
    assert_eq!(ask(&format!("/{}/", server.token)), 200);
    assert_eq!(ask(&format!("/{}/main.js", server.token)), 200);
    let wrong = "0".repeat(32);
    for path in [
        "/".to_owned(),
        "//".into(),
        "/main.js".into(),
        "/api/session".into(),
        format!("/{wrong}/"),
        format!("/{wrong}/api/session"),
        format!("/{}", server.token),
        format!("/{}/", &server.token[..31]),
        format!("/{}0/", server.token),
        // Only the page's own files are served.
        format!("/{}/set.parquet", server.token),
        format!("/{}/..%2f..%2fetc%2fpasswd", server.token),
        format!("/{}/../../../etc/passwd", server.token),
        format!("/{}/api/scenario/1", server.token),
    ] {
        assert_eq!(ask(&path), 404, "{path}");
    }
    // Another server has another token.
    let (_other, other) = file(1);
    assert_ne!(Serving::new(&other, None).token, server.token);
}

#[test]
fn only_the_servers_own_page_is_answered() {
    let (_folder, path) = file(1);
    let server = Serving::new(&path, Some("anna"));
    let page = format!("/{}/", server.token);
    let (port, own) = (server.port, server.host());
    for host in ["", "Host: evil.example\r\n", "Host: 127.0.0.1\r\n", "Host: 127.0.0.1:1\r\n"] {
        let (status, _) = server.ask("GET", &page, host, "");
        assert!(status == 403 || (host.is_empty() && status == 400), "{host}: {status}");
    }
    assert_eq!(server.ask("GET", &page, &format!("{own}Host: evil.example\r\n"), "").0, 403);
    assert_eq!(server.ask("GET", &page, &format!("Host: localhost:{port}\r\n"), "").0, 200);
    let (status, head) = server.ask("GET", &page, &own, "");
    assert_eq!(status, 200);
    for header in ["content-security-policy: default-src 'none'", "no-referrer", "no-store", "nosniff"] {
        assert!(head.contains(header), "{header}");
    }
    // Pages of other origins cannot decide: neither with their own origin nor as a plain form.
    let decide = format!("/{}/api/decide", server.token);
    let wish = r#"{"index":0,"candidate":null,"decision":"reject"}"#;
    let foreign = format!("{own}Origin: http://evil.example\r\nContent-Type: application/json\r\n");
    assert_eq!(server.ask("POST", &decide, &foreign, wish).0, 403);
    assert_eq!(server.ask("POST", &decide, &format!("{own}Content-Type: text/plain\r\n"), wish).0, 415);
    let ours = format!("{own}Origin: http://127.0.0.1:{port}\r\nContent-Type: application/json\r\n");
    assert_eq!(server.ask("POST", &decide, &ours, wish).0, 200);
}

#[test]
fn decisions_are_written_and_taken_back() {
    let (_folder, path) = file(3);
    let all = records(3);
    let server = Serving::new(&path, None);
    let (status, session) = server.get("api/session");
    assert_eq!(status, 200);
    assert_eq!(session["overview"]["scenarios"].as_array().unwrap().len(), 3);
    assert_eq!(session["overview"]["filters"], json!(["pressure"]));
    assert_eq!(session["reviewer"], Value::Null);
    let wish = json!({"index": 1, "candidate": 3, "decision": "pick"});
    assert_eq!(server.post("api/decide", &wish).0, 422, "nobody has said who decides");
    assert_eq!(server.post("api/reviewer", &json!({"name": "  "})).0, 422);
    assert_eq!(server.post("api/reviewer", &json!({"name": " anna "})), (200, "anna".into()));
    let (status, standing) = server.post("api/decide", &wish);
    assert_eq!((status, &standing["verdict"]["decision"]), (200, &"pick".into()));
    for (wrong, status) in [
        (json!({"index": 1, "candidate": 77, "decision": "pick"}), 422),
        (json!({"index": 3, "candidate": null, "decision": "reject"}), 422),
        (json!({"index": 1, "candidate": null, "decision": "pick"}), 422),
        (json!({"index": 1, "candidate": 3, "decision": "love"}), 422),
        (json!({"candidate": 3}), 422),
    ] {
        assert_eq!(server.post("api/decide", &wrong).0, status, "{wrong}");
    }
    let flag = json!({"index": 1, "candidate": 0, "decision": "flag", "note": "too late?"});
    assert_eq!(server.post("api/decide", &flag).0, 200);
    // The journal on the disk while the server runs.
    let journal = Journal::path_for(&path);
    let (decisions, _) = Journal::read_all(&[&journal]).unwrap();
    let line = decisions[&all[1].scenario_id].verdict(&all[1].scenario_digest).unwrap();
    assert_eq!(
        (line.decision, line.candidate, line.note.as_deref()),
        (Decision::Flag, Some(0), Some("too late?"))
    );
    assert_eq!((line.reviewer.as_str(), line.at.as_str()), ("anna", "2026-03-01T12:00:00.007Z"));
    assert_eq!(line.candidate_digest, Some(candidate_digest(&all[1].candidates[0].candidate)));
    let (status, standing) = server.post("api/undo", &json!({}));
    assert_eq!((status, &standing["verdict"]["candidate"]), (200, &3.into()));
    // A file can be under review only once at a time.
    let second = ReviewServer::new(Store::open(&path).unwrap(), ReviewOptions::default());
    assert!(matches!(second, Err(ReviewError::Locked { .. })));
    drop(server);
    let server = Serving::new(&path, Some("ben"));
    let (_, session) = server.get("api/session");
    assert_eq!(session["standings"][0]["verdict"]["candidate"], 3);
    assert_eq!(server.post("api/undo", &json!({})), (200, Value::Null), "ben has decided nothing");
}

#[test]
fn a_pick_of_another_trajectory_is_stale() {
    let (folder, path) = file(1);
    let server = Serving::new(&path, Some("anna"));
    server.post("api/decide", &json!({"index": 0, "candidate": 3, "decision": "pick"}));
    assert_eq!(server.get("api/scenario/0").1["stale"], false);
    drop(server);
    let mut all = records(1);
    all[0].candidates[3].candidate.track[40].x += 1.0;
    hand::write(&path, &all);
    let server = Serving::new(&path, Some("anna"));
    assert_eq!(server.get("api/scenario/0").1["stale"], true);
    let (decisions, _) = Journal::read_all(&[Journal::path_for(&path)]).unwrap();
    let opinions = &decisions[&all[0].scenario_id];
    assert!(matches!(opinions.verdict_for(&all[0], false), Some((_, false))));
    assert!(matches!(opinions.verdict_for(&records(1)[0], false), Some((_, true))));
    drop((server, folder));
}

#[test]
fn a_scene_is_the_same_every_time_and_gives_the_tracks_back() {
    let scenario = small_scenarios::scenario(3);
    let text = sketch(&scenario);
    assert_eq!(text, sketch(&small_scenarios::scenario(3)));
    let value: Value = serde_json::from_str(&text).unwrap();
    let agents = value["agents"].as_array().unwrap();
    assert_eq!(agents.len(), scenario.start.agents.len());
    for (i, agent) in agents.iter().enumerate() {
        assert_eq!(agent["id"], scenario.start.agents[i].id.as_str());
        for span in agent["t"].as_array().unwrap() {
            let numbers: Vec<i64> = span.as_array().unwrap().iter().map(|v| v.as_i64().unwrap()).collect();
            let mut state = [0; 4];
            for (k, step) in numbers[1..].chunks(4).enumerate() {
                state.iter_mut().zip(step).for_each(|(sum, d)| *sum += d);
                let logged = scenario.logged(i)[numbers[0] as usize + k].unwrap();
                let expected = [logged.x, logged.y, logged.heading * 10.0, logged.speed()];
                assert_eq!(state, expected.map(|v| (v * 100.0).round() as i64));
            }
        }
    }
    // The road of 600 m is cut to the surroundings of the AV, and straight lines are two points.
    let edge = value["edges"][0][1].as_array().unwrap();
    assert_eq!(edge.len(), 4);
    assert!(edge[2].as_i64().unwrap() < 60_000);
}

#[test]
fn scenes_of_real_logs_are_small() {
    let Some(folder) = crate::shared("data/womd/train") else { return };
    for scenario in formats::open(&folder).unwrap().filter_map(Result::ok).take(20) {
        let text = sketch(&scenario);
        assert!(text.len() < 150_000, "{}: {} bytes", scenario.id, text.len());
        assert!(serde_json::from_str::<Value>(&text).is_ok());
    }
}

//! The loop of requests and answers.

use std::io;

use super::environment::Environment;
use super::realism::LogCache;
use super::requests::existing;
use super::scenarios::ScenarioCache;
use super::wire::{Answer, failed, refused};
use super::world::World;
use super::{realism, requests, scores};
use crate::external::{Frame, FrameWriter, Parent};

/// Answers the requests of the parent process until its stream ends. A request that cannot be answered gives
/// an answer of the type `error`, and the next one is read. Simulators of the parent are asked before the
/// answer.
///
/// # Errors
/// If the parent writes something other than frames, or does not read any more.
pub fn serve(parent: &Parent) -> io::Result<()> {
    let mut session = Session::default();
    while let Some(bytes) = parent.receive()? {
        parent.send(session.answer(bytes, parent).to_frame().map_err(io::Error::other)?)?;
    }
    Ok(())
}

/// State of the process between requests.
#[derive(Default)]
struct Session {
    scenarios: ScenarioCache,
    logs: LogCache,
    environment: Option<Environment>,
    world: Option<World>,
}

impl Session {
    fn answer(&mut self, bytes: Vec<u8>, parent: &Parent) -> FrameWriter {
        let frame = match Frame::read(bytes) {
            Ok(frame) => frame,
            Err(error) => return failed(error.into()),
        };
        let mut answer = self.result(&frame, parent).unwrap_or_else(failed);
        if let Some(number) = frame.optional_text("seq") {
            answer.text("seq", number);
        }
        answer
    }

    fn result(&mut self, request: &Frame, parent: &Parent) -> Answer {
        match request.text("type")? {
            "score" => scores::score(request, &mut self.scenarios),
            "wosac" => realism::score(request, &mut self.logs),
            "wosac-summary" => realism::summarise(request),
            "environment" => requests::create(request, &mut self.environment, parent),
            "reset" => requests::reset(request, existing(&mut self.environment)?),
            "step" => requests::step(request, existing(&mut self.environment)?),
            "begin" => requests::begin(request, existing(&mut self.environment)?),
            "tracks" => requests::tracks(request, existing(&mut self.environment)?),
            "draw" => requests::draw(request, existing(&mut self.environment)?),
            "world" => requests::create_world(request, &mut self.world, parent),
            "world-reset" => requests::reset_world(request, existing(&mut self.world)?),
            "world-step" => requests::step_world(request, existing(&mut self.world)?),
            "world-tracks" => requests::world_tracks(existing(&mut self.world)?),
            "world-draw" => requests::draw_world(request, existing(&mut self.world)?),
            other => refused(format_args!(
                "unknown request `{other}`: expected score, wosac, wosac-summary, environment, reset, step, \
                 begin, tracks, draw, world, world-reset, world-step, world-tracks or world-draw"
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write};
    use std::sync::Arc;
    use std::thread;

    use parking_lot::Mutex;
    use serde_json::{Value, json};

    use super::*;
    use crate::external::{Values, read_frame};
    use crate::scene::FUTURE;

    /// A request: its type, its arguments and a tensor.
    type Sent<'a> = (&'a str, Value, Option<(&'static str, Values)>);

    /// A stream in memory.
    #[derive(Clone, Default)]
    struct Written(Arc<Mutex<Vec<u8>>>);

    impl Write for Written {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.0.lock().write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn request(seq: usize, (kind, arguments, tensor): &Sent<'_>) -> Vec<u8> {
        let mut frame = FrameWriter::new(kind);
        frame.text("seq", seq.to_string());
        frame.tensor("arguments", Values::bytes(arguments.to_string().into_bytes()));
        if let Some((name, values)) = tensor {
            frame.tensor(name, values.clone());
        }
        frame.to_frame().unwrap()
    }

    fn next(from: &mut dyn io::Read) -> Option<Frame> {
        read_frame(from, || 1 << 30).unwrap().map(|bytes| Frame::read(bytes).unwrap())
    }

    /// Sends requests; returns the answers.
    fn answers(requests: &[Sent<'_>]) -> Vec<Frame> {
        let input: Vec<u8> = requests.iter().enumerate().flat_map(|(seq, sent)| request(seq, sent)).collect();
        let output = Written::default();
        let parent = Parent::new(Cursor::new(input), output.clone());
        serve(&parent).unwrap();
        drop(parent);
        let output = output.0.lock();
        let mut rest = output.as_slice();
        let found: Vec<Frame> = std::iter::from_fn(|| next(&mut rest)).collect();
        let numbers: Vec<&str> = found.iter().map(|answer| answer.text("seq").unwrap()).collect();
        assert_eq!(numbers, (0..requests.len()).map(|seq| seq.to_string()).collect::<Vec<_>>());
        found
    }

    fn document(answer: &Frame) -> Value {
        serde_json::from_slice(answer.bytes("document").unwrap()).unwrap()
    }

    fn error(answer: &Frame) -> String {
        assert_eq!(answer.text("type").unwrap(), "error");
        document(answer).as_str().unwrap().to_owned()
    }

    /// Arguments of an environment with small arrays.
    fn environment(action: &Value, simulator: &str) -> Value {
        let sizes = json!({ "agents": 3, "frames": 2, "lanes": 4, "points": 3, "lights": 1, "route": 2 });
        let traffic = json!({
            "simulator": simulator, "batches": 2, "external_limit": null, "weights": {}, "parameters": {},
            "replan": "2hz", "av_lookahead": true, "seed": 0,
        });
        let common = json!({
            "reading": { "paths": [] }, "ids": [], "limit": 2, "traffic": traffic, "action": action,
            "sizes": sizes, "scores": true, "metric_options": {},
        });
        json!({ "common": common, "every": 1, "end_at": [] })
    }

    fn begin(slot: usize, scenario: usize) -> Value {
        json!({ "slot": slot, "scenario": scenario, "rollout": 0 })
    }

    #[test]
    fn wrong_requests_are_answered_with_their_fault() {
        let none = json!({ "episodes": [] });
        let unknown = json!({ "reading": { "paths": [] }, "scenario": "x", "simulator": "s", "agents": ["a"],
            "allow": [], "pose": null, "metric_options": {} });
        let found = answers(&[
            ("paint", json!({}), None),
            ("step", none, None),
            ("score", json!({}), None),
            ("score", unknown, None),
        ]);
        assert_eq!(
            error(&found[0]),
            "unknown request `paint`: expected score, wosac, wosac-summary, environment, reset, step, begin, \
             tracks, draw, world, world-reset, world-step, world-tracks or world-draw"
        );
        assert_eq!(error(&found[1]), "there is no environment: create one first");
        assert!(error(&found[2]).starts_with("the arguments of the request: missing field `reading`"));
        assert_eq!(error(&found[3]), "no scenario `x` in the shipped benchmark");
    }

    #[test]
    fn episodes_are_stepped_restarted_and_scored() {
        let both = json!({ "episodes": [begin(0, 0), begin(1, 1)] });
        let actions = || Some(("actions", Values::f64(&[2, 2], [0.5, 0.0, -1.0, 0.01])));
        let mut requests =
            vec![("environment", environment(&json!("bicycle"), "idm"), None), ("reset", both, None)];
        let none = json!({ "episodes": [] });
        requests.extend((0..FUTURE).map(|_| ("step", none.clone(), actions())));
        requests.push(("step", none.clone(), actions()));
        requests.push(("step", json!({ "episodes": [begin(0, 1), begin(1, 1)] }), actions()));
        requests.push(("tracks", json!({ "slot": 1 }), None));
        let found = answers(&requests);
        let description = document(&found[0]);
        assert_eq!(description["scenarios"].as_array().unwrap().len(), 2);
        assert_eq!(found[1].shape("agents").unwrap(), [2, 3, 2, 7]);
        let last = &found[1 + FUTURE];
        let ends = document(last);
        assert!(ends["1"]["rows"][0]["metrics"]["aav-collision"]["count"].is_u64());
        assert_eq!(document(&found[FUTURE]), json!({}));
        assert_eq!(error(&found[2 + FUTURE]), "the episode in slot 0 is over: reset it");
        assert_eq!(found[3 + FUTURE].text("type").unwrap(), "stepped");
        assert_eq!(found[4 + FUTURE].shape("states").unwrap()[1..], [11, 5]);
    }

    #[test]
    fn episodes_begin_without_a_step_of_the_others() {
        let both = json!({ "episodes": [begin(0, 0), begin(1, 1)] });
        let actions = || Some(("actions", Values::f64(&[2, 2], [0.5, 0.0, -1.0, 0.01])));
        let found = answers(&[
            ("environment", environment(&json!("bicycle"), "idm"), None),
            ("reset", both, None),
            ("step", json!({ "episodes": [] }), actions()),
            ("begin", json!({ "episodes": [begin(1, 0)] }), None),
            ("tracks", json!({ "slot": 0 }), None),
            ("tracks", json!({ "slot": 1 }), None),
            ("step", json!({ "episodes": [] }), actions()),
            ("begin", json!({ "episodes": [begin(2, 0)] }), None),
        ]);
        // The first observation of the same episode.
        let rows = found[1].floats("agents", &[2, 3, 2, 7]).unwrap();
        assert_eq!(found[3].floats("agents", &[1, 3, 2, 7]).unwrap(), rows[..3 * 2 * 7]);
        assert_eq!(found[4].shape("states").unwrap()[1], 12);
        assert_eq!(found[5].shape("states").unwrap()[1], 11);
        assert_eq!(found[6].text("type").unwrap(), "stepped");
        assert_eq!(error(&found[7]), "there is no slot 2, expected 0 to 1");
    }

    #[test]
    fn episodes_are_drawn() {
        let one = json!({ "episodes": [begin(0, 0)] });
        let none = || json!({ "episodes": [] });
        let actions = || Some(("actions", Values::f64(&[1, 2], [0.5, 0.0])));
        let draw = |slot: usize, every: Option<usize>| json!({ "slot": slot, "size": 100, "radius": null, "follow": true, "every": every });
        let found = answers(&[
            ("environment", environment(&json!("bicycle"), "idm"), None),
            ("reset", one, None),
            ("draw", draw(0, None), None),
            ("step", none(), actions()),
            ("draw", draw(0, None), None),
            ("draw", draw(0, Some(1)), None),
            ("draw", draw(1, None), None),
        ]);
        assert_eq!(found[2].shape("rgb").unwrap(), [146, 100, 3]);
        assert_ne!(found[2].bytes("rgb").unwrap(), found[4].bytes("rgb").unwrap());
        assert!(found[5].bytes("gif").unwrap().starts_with(b"GIF89a"));
        assert_eq!(error(&found[6]), "there is no slot 1, expected 0 to 0");
    }

    #[test]
    fn impossible_settings_and_actions_are_refused() {
        let one = || json!({ "episodes": [begin(0, 0)] });
        let far = Some(("actions", Values::f64(&[1, 5], [900.0, 0.0, 0.0, 0.0, 0.0])));
        let found = answers(&[
            ("environment", environment(&json!({ "plan": { "poses": 0 } }), "idm"), None),
            ("environment", environment(&json!("state"), "idm"), None),
            ("reset", json!({ "episodes": [begin(0, 7)] }), None),
            ("step", one(), Some(("actions", Values::f64(&[0, 5], [])))),
            ("reset", one(), None),
            ("step", json!({ "episodes": [] }), far),
            ("tracks", json!({ "slot": 0 }), None),
        ]);
        assert_eq!(error(&found[0]), "a plan has 0 poses, expected 1 to 80: at least `every`");
        assert_eq!(error(&found[2]), "there is no scenario 7, expected 0 to 1");
        assert_eq!(error(&found[3]), "there is no slot 0, and no other");
        assert!(error(&found[5]).contains("expected at most 8.0 m"), "{}", error(&found[5]));
        assert_eq!(found[6].shape("states").unwrap()[1..], [11, 5]);
    }

    #[test]
    fn simulators_of_the_parent_are_asked_before_the_answer() {
        let ((from_parent, mut to_child), (mut from_child, to_parent)) =
            (io::pipe().unwrap(), io::pipe().unwrap());
        let program = thread::spawn(move || serve(&Parent::new(from_parent, to_parent)));
        let mut ask = |seq, sent: Sent<'_>, fails: &str| {
            to_child.write_all(&request(seq, &sent)).unwrap();
            let mut asked = Vec::new();
            loop {
                let frame = next(&mut from_child).unwrap();
                let kind = frame.text("type").unwrap();
                if frame.optional_text("to").is_none() {
                    return (asked, frame);
                }
                assert_eq!((frame.text("to").unwrap(), frame.text("worker").unwrap()), ("mine", "0"));
                asked.push(kind.to_owned());
                let replies = [("hello", "welcome"), ("begin", "begun"), ("end", "ended")];
                let reply = replies.into_iter().find(|(asked, _)| *asked == kind && kind != fails);
                let mut answer = FrameWriter::new(reply.map_or("failed", |(_, reply)| reply));
                answer.text("seq", frame.text("seq").unwrap()).text("name", "any").text("error", "not today");
                to_child.write_all(&answer.to_frame().unwrap()).unwrap();
            }
        };
        let actions = || Some(("actions", Values::f64(&[1, 2], [0.5, 0.0])));
        let one = || json!({ "episodes": [begin(0, 0)] });
        let none = || json!({ "episodes": [] });
        let new = environment(&json!("bicycle"), "mine=@stdio");
        let (asked, answer) = ask(0, ("environment", new, None), "");
        assert_eq!((asked, answer.text("type").unwrap()), (vec!["hello".to_owned()], "environment"));
        let (asked, answer) = ask(1, ("reset", one(), None), "begin");
        assert_eq!(asked, ["begin", "end"]);
        assert!(error(&answer).starts_with("simulator `mine`: scenario `"), "{}", error(&answer));
        let (asked, _) = ask(2, ("reset", one(), None), "");
        assert_eq!(asked, ["begin"]);
        let (asked, answer) = ask(3, ("step", none(), actions()), "");
        assert_eq!(asked, ["plan"]);
        assert!(error(&answer).ends_with("no plan at step 0: not today"), "{}", error(&answer));
        let (_, answer) = ask(4, ("step", none(), actions()), "");
        assert_eq!(error(&answer), "the episode in slot 0 is over: reset it");
        let (asked, _) = ask(5, ("reset", one(), None), "");
        assert_eq!(asked, ["end", "begin"]);
        drop(to_child);
        program.join().unwrap().unwrap();
    }
}

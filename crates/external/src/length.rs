//! Lengths of episodes in messages.

use reactsim_rollout::Beginning;
use reactsim_scene::Length;

use super::document::FrameWriter;
use super::replies::Description;

/// Returns the length of an episode.
pub(super) fn of(episode: &Beginning<'_>) -> Length {
    Length { history: episode.start.current() + 1, future: episode.future }
}

/// Adds the length of the scenarios of a message, unless it is that of the benchmark.
pub(super) fn add(message: &mut FrameWriter, length: Length) {
    if length != Length::BENCHMARK {
        message.text("length", format!("[{}, {}]", length.history, length.future));
    }
}

/// Checks that a program supports scenarios of a length.
///
/// # Errors
/// A text with the length of the scenario, and with what a program states to support other lengths.
pub(super) fn check(description: &Description, length: Length) -> Result<(), String> {
    if description.any_length || length == Length::BENCHMARK {
        return Ok(());
    }
    Err(format!(
        "the program `{}` supports only {}; the scenario has {length}: a program that supports other lengths \
         states `lengths` `any` in `welcome` (docs/external-protocol.md)",
        description.name,
        Length::BENCHMARK
    ))
}

#[cfg(test)]
mod tests {
    use std::io::{self, Write};
    use std::thread::{self, JoinHandle};

    use reactsim_rollout::{
        Controller, Observation, Protocol, Replan, Request, Rollout, RolloutError, Settings, roll_out,
    };
    use reactsim_scene::{Agent, AgentKind, AgentState, LoggedAgent, Scenario, ScenarioParts};

    use super::*;
    use crate::{
        Command, ExternalPlanner, ExternalSettings, ExternalSimulator, Frame, Parent, RunOutline,
        SceneExtras, Values, read_frame, scene_frame,
    };

    fn scenario(id: &str, history: usize, future: usize) -> Scenario {
        let length = Length { history, future };
        let agent = |id: &str, y: f64| LoggedAgent {
            agent: Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.5, width: 2.0 },
            track: vec![Some(AgentState { x: 0.0, y, heading: 0.0, vx: 0.0, vy: 0.0 }); length.frames()],
            heights: Vec::new(),
        };
        let agents = vec![agent("av", 0.0), agent("a", 5.0)];
        Scenario::assemble(ScenarioParts { id: id.into(), length, agents, ..ScenarioParts::default() })
            .unwrap()
    }

    /// A request: its type, its `length`, and the shape of its history or its states.
    type Received = (String, Option<String>, Vec<usize>);

    /// Starts a program that states `lengths` and plans `poses` poses, or the steps that it is asked for; it
    /// returns what it received.
    fn program(lengths: &'static str, poses: Option<usize>) -> (Parent, JoinHandle<Vec<Received>>) {
        let ((from_child, to_parent), (from_parent, to_child)) = (io::pipe().unwrap(), io::pipe().unwrap());
        let answer = move || {
            let (mut reader, mut writer, mut received) = (from_parent, to_parent, Vec::new());
            while let Ok(Some(bytes)) = read_frame(&mut reader, || 1 << 30) {
                let frame = Frame::read(bytes).unwrap();
                let kind = frame.text("type").unwrap().to_owned();
                if kind == "bye" {
                    continue;
                }
                let replies =
                    [("hello", "welcome"), ("begin", "begun"), ("plan", "planned"), ("end", "ended")];
                let (_, reply) = replies.into_iter().find(|(request, _)| *request == kind).unwrap();
                let mut answer = FrameWriter::new(reply);
                let role = frame.optional_text("role").unwrap_or_default();
                answer.text("seq", frame.text("seq").unwrap()).text("name", "any").text("role", role);
                if !lengths.is_empty() {
                    answer.text("lengths", lengths);
                }
                let mut shape = Vec::new();
                if kind == "begin" {
                    shape = frame.shape("history").unwrap().to_vec();
                } else if kind == "plan" {
                    shape = frame.shape("states").unwrap().to_vec();
                    let steps = poses.unwrap_or_else(|| frame.text("steps").unwrap().parse().unwrap());
                    let (b, n) = (shape[0], shape[1]);
                    answer.tensor("states", Values::f64(&[b, n, steps, 3], vec![0.0; b * n * steps * 3]));
                    answer.tensor("trajectory", Values::f64(&[1, steps, 3], vec![0.0; steps * 3]));
                }
                received.push((kind, frame.optional_text("length").map(str::to_owned), shape));
                writer.write_all(&answer.to_frame().unwrap()).unwrap();
            }
            received
        };
        (Parent::new(from_child, to_child), thread::spawn(answer))
    }

    fn outline() -> RunOutline {
        RunOutline { intervals: vec![30], protocols: vec!["realism"] }
    }

    /// Rolls out scenarios together; returns the results and what the program received.
    fn run(
        lengths: &'static str,
        workers: usize,
        scenarios: &[Scenario],
    ) -> (Vec<Result<Rollout, RolloutError>>, Vec<Received>) {
        let (parent, received) = program(lengths, None);
        let command = Command::Parent(parent);
        let settings = ExternalSettings { workers, ..ExternalSettings::new("mine", command) };
        let simulator = ExternalSimulator::start(settings, outline()).unwrap();
        let requests = scenarios.iter().map(|scenario| Request { scenario, av: None, rollout: 0 }).collect();
        let replan = Replan::every(30).unwrap();
        let settings = Settings { protocol: Protocol::Realism, replan, ..Settings::default() };
        let results = roll_out(requests, &Controller::Fair(Box::new(simulator)), &settings);
        (results, received.join().unwrap())
    }

    #[test]
    fn scenarios_of_any_length_are_planned_to_their_end() {
        let scenarios = [scenario("a", 11, 150), scenario("b", 11, 80), scenario("c", 2, 60)];
        // Without a process for each length, they are rolled out one after the other.
        for workers in [3, 1] {
            let (results, received) = run("any", workers, &scenarios);
            let frames: Vec<usize> = results.iter().map(|r| r.as_ref().unwrap().tracks[1].len()).collect();
            assert_eq!(frames, [161, 91, 62], "{workers} workers");
            let begun: Vec<&Received> = received.iter().filter(|(kind, ..)| kind == "begin").collect();
            let last = &begun[begun.len() - 3..];
            let texts: Vec<Option<&str>> = last.iter().map(|(_, length, _)| length.as_deref()).collect();
            assert_eq!(texts, [Some("[11, 150]"), None, Some("[2, 60]")]);
            let histories: Vec<usize> = last.iter().map(|(.., shape)| shape[2]).collect();
            assert_eq!(histories, [11, 11, 2]);
            let plans = received.iter().filter(|(kind, ..)| kind == "plan");
            assert_eq!(plans.map(|(.., shape)| shape[2]).sum::<usize>(), 120 + 60 + 30);
        }
    }

    #[test]
    fn programs_that_do_not_support_a_length_are_not_asked() {
        let (results, received) = run("", 1, &[scenario("a", 11, 150)]);
        let error = results[0].as_ref().unwrap_err().to_string();
        assert!(
            error.contains(
                "the program `any` supports only 11 frames of history and 80 steps; the scenario has 11 \
                 frames of history and 150 steps: a program that supports other lengths states `lengths`"
            ),
            "{error}"
        );
        assert_eq!(received.iter().map(|(kind, ..)| kind.as_str()).collect::<Vec<_>>(), ["hello"]);
        let (results, _) = run("", 1, &[scenario("b", 11, 80)]);
        assert_eq!(results[0].as_ref().unwrap().tracks[0].len(), 91);
        let (parent, _received) = program("8", None);
        let settings = ExternalSettings::new("mine", Command::Parent(parent));
        let error = ExternalSimulator::start(settings, outline()).err().unwrap().to_string();
        assert!(error.contains("`welcome`: `lengths` is \"8\" instead of `any`, or nothing"), "{error}");
    }

    #[test]
    fn planners_may_plan_to_the_end_of_a_long_scenario() {
        let plan = |lengths, poses, (history, future): (usize, usize)| {
            let (parent, received) = program(lengths, Some(poses));
            let settings = ExternalSettings::new("mine", Command::Parent(parent));
            let planner = ExternalPlanner::start(settings, outline()).unwrap();
            let scenario = scenario("a", history, future);
            let tracks = scenario.start.history.clone();
            let seen = Observation::new(&scenario.start, &tracks, &[], None);
            let planned = planner.begin(0, scenario.length(), None).plan(&seen, 5, &[], [0.0; 7]);
            drop(planner);
            received.join().unwrap();
            planned.map(|planned| planned.poses.len())
        };
        assert_eq!(plan("any", 150, (11, 150)), Ok(150));
        assert_eq!(plan("any", 80, (2, 20)), Ok(80));
        assert_eq!(plan("", 80, (11, 80)), Ok(80));
        let most = |most: usize| {
            Err(format!(
                "`planned` cannot be used: `trajectory` has {} poses; it needs 5, the steps until the next \
                 plan, to {most}",
                most + 1
            ))
        };
        assert_eq!(plan("any", 151, (11, 150)), most(150));
        assert_eq!(plan("", 81, (11, 80)), most(80));
        assert!(plan("", 80, (11, 150)).unwrap_err().contains("supports only 11 frames of history"));
    }

    #[test]
    fn scenes_state_other_lengths() {
        for (history, future, text) in [(11, 80, None), (21, 600, Some("[21, 600]"))] {
            let scene = scene_frame(&scenario("a", history, future), 0, SceneExtras::Future { av: None });
            let mut scene = scene;
            scene.text("seq", "0");
            let frame = Frame::read(scene.to_frame().unwrap()[8..].to_vec()).unwrap();
            assert_eq!(frame.optional_text("length"), text);
            assert_eq!(frame.shape("history").unwrap(), [1, 2, history, 5]);
            assert_eq!(frame.shape("future").unwrap(), [1, 2, future, 5]);
            assert_eq!(frame.shape("light_future").unwrap(), [0, future]);
        }
    }
}

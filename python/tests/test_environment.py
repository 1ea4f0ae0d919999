"""Environments and scores of rollouts in memory, with the program."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import MappingProxyType
from typing import Any, Dict, List

import numpy as np
import pytest
import reactsim
from fakes import IMPORTED, MINI, SMALL, executable, is_running, other_lengths
from reactsim.process import ProgramProcess
from stop import Stop

pytestmark = [pytest.mark.program, pytest.mark.usefixtures("with_program")]


@pytest.fixture(scope="module")
def results(with_program: None, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Two rollouts of each small scenario."""
    out = tmp_path_factory.mktemp("run") / "run"
    return reactsim.run(baselines=["idm"], scenarios=MINI, out=out, rollouts=2, progress=False)


SCRIPT = """
import numpy as np
import reactsim

class Careful(reactsim.Simulator):
    '''Slows down at random; remembers its random numbers.'''

    name = "careful"

    def begin(self, scenes):
        self.draws = [scenes.rng(i) for i in range(len(scenes))]

    def plan(self, seen):
        now = seen.states[:, :, -1]
        draws = [draw.random(128)[: now.shape[1]] for draw in self.draws]
        factors = 0.9 + 0.1 * np.array(draws)[:, :, None, None]
        time = reactsim.DT * np.arange(1, seen.steps + 1)[:, None]
        plan = np.repeat(now[:, :, None, :3], seen.steps, axis=2)
        plan[..., :2] += factors * np.nan_to_num(now[:, :, None, 3:]) * time
        return plan

if __name__ == "__main__":
    reactsim.serve(Careful)
"""
SPACE: Dict[str, Any] = {"__name__": "careful"}
exec(SCRIPT, SPACE)
Careful = SPACE["Careful"]


class Raising(Stop):  # type: ignore[misc]
    name = "raising"

    def plan(self, now: reactsim.Observation) -> Any:
        raise ZeroDivisionError("nothing to divide")


class Named(Stop):  # type: ignore[misc]
    name = "idm"


@pytest.fixture(scope="module")
def own(with_program: None) -> Dict[str, Any]:
    """States of the second rollout of each small scenario with `Careful`."""
    run = reactsim.run(Careful(), MINI, rollouts=2, seed=3, progress=False)
    return {r.scenario: r.states for r in run.rollouts() if r.rollout == 1}


def states_of(results: Any, scenario: str) -> Any:
    return np.stack([rollout.states for rollout in results.rollouts(scenario=scenario)])


def check_metrics(
    scores: reactsim.RolloutScores, results: Any, scenario: str, rollout: int, metrics: Any = None
) -> None:
    """Compares metrics, by default all, with those of a rollout of a run."""
    row = {"scenario": scenario, "rollout": rollout}
    (row,) = [r for r in results.rows.to_dict("records") if row.items() <= r.items()]
    for metric in metrics or scores.metrics:
        value = scores.metrics[metric]
        assert value == row[metric] or (value is None and not row[metric] == row[metric]), metric


def replayed(env: Any, scenario: reactsim.Scenario, rollout: int) -> Any:
    """Drives the deviated AV of a scenario; returns the states and the last info."""
    env.reset(options={"scenario": scenario.id, "rollout": rollout})
    assert scenario.av is not None
    for state in scenario.av:
        *_, truncated, info = env.step(state)
    assert truncated
    return env.states[:, 11:], info


class TestScoreStates:
    def test_numbers_are_those_of_score(self, results: Any, tmp_path: Path) -> None:
        rollouts = results.folder / "rollouts.parquet"
        scored = reactsim.score(rollouts, MINI, out=tmp_path / "scored", progress=False)
        events = scored.events.to_dict("records")
        for scenario in reactsim.scenarios(MINI):
            scores = reactsim.score_states(scenario, states_of(results, scenario.id))
            assert len(scores.rollouts) == 2
            for index, rollout in enumerate(scores.rollouts):
                check_metrics(rollout, scored, scenario.id, index)
                found = [
                    event["metric"]
                    for event in events
                    if event["scenario"] == scenario.id and event["rollout"] == index
                ]
                assert [event.metric for event in rollout.events] == found
            own = scored.rows[scored.rows["scenario"] == scenario.id]
            assert scores.metrics["min-ade"] == own[own["rollout"].isna()]["min-ade"].item()

    def test_agents_are_found_by_their_ids(self, results: Any) -> None:
        scenario = next(reactsim.scenarios(MINI))
        states = states_of(results, scenario.id)
        whole = reactsim.score_states(scenario, states)
        by_id = dict(zip(scenario.agents, np.moveaxis(states, 1, 0)))
        backwards = {agent: by_id[agent] for agent in reversed(scenario.agents)}
        assert reactsim.score_states(scenario, backwards) == whole

    def test_checks_and_options_are_those_of_the_command_line(self, results: Any) -> None:
        scenario = next(reactsim.scenarios(MINI))
        states = states_of(results, scenario.id)
        moved = states + np.array([100.0, 0.0, 0.0, 0.0, 0.0])
        with pytest.raises(reactsim.ReactsimError, match="`allow` other-av"):
            reactsim.score_states(scenario, moved)
        with pytest.raises(reactsim.ReactsimError, match="unknown metric option `a`"):
            reactsim.score_states(scenario, states, metric_options={"a": 1})
        with pytest.raises(reactsim.ReactsimError, match="unknown check `a`: expected one of"):
            reactsim.score_states(scenario, states, allow="a")
        allowed = ["other-av", "coordinates", "jumps"]
        scores = reactsim.score_states(scenario, moved, allow=allowed)
        assert scores.rollouts[0].outcomes["allowed-other-av"] == 1

    def test_wrong_arrays_are_refused(self, results: Any) -> None:
        scenario = next(reactsim.scenarios(MINI))
        states = states_of(results, scenario.id)
        infinite = states.copy()
        infinite[0, 1, 2, 0] = np.inf
        for wrong, text in [
            (states[:, 1:], "expected .rollouts, "),
            (states[:, :, :7], "expected .rollouts, "),
            (states.astype(str), "expected numbers"),
            (infinite, r"states\[0, 1, 2\]` is .inf"),
            ({}, "empty mapping"),
        ]:
            with pytest.raises(ValueError, match=text):
                reactsim.score_states(scenario, wrong)

    def test_masked_states_are_absent(self, results: Any) -> None:
        scenario = next(reactsim.scenarios(MINI))
        states = states_of(results, scenario.id)
        absent = states.copy()
        absent[:, -1, 40:] = np.nan
        mask = np.zeros(states.shape, np.bool_)
        mask[:, -1, 40:] = True
        masked = np.ma.MaskedArray(states, mask)
        expected = reactsim.score_states(scenario, absent, allow="missing-agents")
        for given in (masked, list(masked), dict(zip(scenario.agents, masked.swapaxes(0, 1)))):
            assert reactsim.score_states(scenario, given, allow="missing-agents") == expected
        partly = np.ma.MaskedArray(states, np.zeros(states.shape, np.bool_))
        partly[0, 1, 2, 0] = np.ma.masked
        with pytest.raises(ValueError, match=r"states\[0, 1, 2\]` is .nan"):
            reactsim.score_states(scenario, partly)

    def test_answers_are_of_any_size(self) -> None:
        scenario = next(reactsim.scenarios(limit=1))
        checks = "other-av jumps coordinates units time agent-order headings teleports freeze"
        allow = [*checks.split(), "float32", "missing-agents", "rear-axle", "partial"]
        # Every agent is in contact with every other one: the events are larger than a header.
        n = len(scenario.agents)
        states = np.zeros((max(2, 2_000_000 // n**2), n, 80, 3))
        scores = reactsim.score_states(scenario, states, allow=allow)
        assert len(scores.rollouts) == len(states)
        assert sum(len(rollout.events) for rollout in scores.rollouts) > 500_000

    def test_the_av_is_that_of_the_deviations(self, tmp_path: Path) -> None:
        logs, deviations = tmp_path / "logs.parquet", tmp_path / "deviations.parquet"
        reactsim.command("generate", preset="train", count=12, seed=3, out=logs, progress=False)
        reactsim.curate(logs, deviations, progress=False)
        folder = tmp_path / "run"
        run = reactsim.run(
            baselines=["idm"], scenarios=logs, deviations=deviations, out=folder, progress=False
        )
        (scenario, *_) = reactsim.scenarios(logs, deviations=deviations)
        states = states_of(run, scenario.id)
        scores = reactsim.score_states(scenario, states)
        metrics = ("aav-collision", "over-reaction", "undisturbed-loss")
        check_metrics(scores.rollouts[0], run, scenario.id, 0, metrics)
        assert any(scores.rollouts[0].metrics[m] is not None for m in ("undisturbed-loss", "ade"))
        logged = states.copy()
        assert scenario.future is not None
        logged[:, 0] = scenario.future[0]
        with pytest.raises(reactsim.ReactsimError, match="from the prescribed trajectory"):
            reactsim.score_states(scenario, logged)
        allowed = reactsim.score_states(scenario, logged, allow=["other-av", "jumps"])
        assert allowed.rollouts[0].metrics["undisturbed-loss"] is None


def pid_of(process: ProgramProcess) -> int:
    return process._program.pid


class TestProcess:
    def test_it_ends_when_it_is_closed_or_collected(self) -> None:
        first, second = ProgramProcess(), ProgramProcess()
        pids = [pid_of(first), pid_of(second)]
        first.close()
        with pytest.raises(reactsim.ReactsimError, match="is closed"):
            first.request("score", {})
        del second
        gc.collect()
        assert not any(map(is_running, pids))

    def test_a_wrong_request_does_not_end_it(self) -> None:
        process = ProgramProcess()
        for kind in ("nothing", "score", "step", "reset"):
            with pytest.raises(reactsim.ReactsimError):
                process.request(kind, {})
        with pytest.raises(reactsim.ReactsimError, match="unknown request `nothing`: expected"):
            process.request("nothing", {})
        with pytest.raises(TypeError, match="is a PosixPath"):
            process.request("nothing", {"a": MINI})
        process.close()

    def test_its_end_is_an_error(self) -> None:
        process = ProgramProcess()
        os.kill(pid_of(process), signal.SIGKILL)
        with pytest.raises(reactsim.ReactsimError, match=r"signal 9 \(SIGKILL\)"):
            process.request("score", {})

    def test_it_belongs_to_one_process_and_one_thread(self) -> None:
        process = ProgramProcess()
        with process._lock, pytest.raises(reactsim.ReactsimError, match="answers another thread"):
            process.request("score", {})
        child = os.fork()
        if child == 0:
            try:
                process.request("score", {})
            except reactsim.ReactsimError as error:
                os._exit(0 if "after a fork" in str(error) else 1)
            os._exit(2)
        assert os.waitpid(child, 0)[1] == 0
        # The copy of the child did not end the process.
        with pytest.raises(reactsim.ReactsimError, match="unknown request"):
            process.request("nothing", {})
        process.close()


@pytest.fixture
def ffmpeg(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A stand-in for `ffmpeg`, which writes what it is given."""
    monkeypatch.setenv("PATH", str(tmp_path))
    write = "import sys; open(sys.argv[-1], 'wb').write(sys.stdin.buffer.read())"
    return executable(tmp_path / "ffmpeg", write, sys.executable)


@pytest.fixture
def closing() -> Any:
    """Closes environments after the test."""
    opened: List[Any] = []

    def keep(env: Any) -> Any:
        opened.append(env)
        return env

    yield keep
    for env in opened:
        env.close()


@pytest.mark.usefixtures("results")
class TestEnv:
    @pytest.fixture(autouse=True)
    def gymnasium(self) -> None:
        pytest.importorskip("gymnasium")

    @pytest.mark.parametrize("action", ["bicycle", "plan"])
    def test_it_is_an_environment(self, action: str, closing: Any) -> None:
        from gymnasium.utils.env_checker import check_env

        env = closing(reactsim.Env(MINI, action=action, poses=5, **SMALL))
        check_env(env, skip_render_check=True)

    def test_flat_observations_and_normalized_actions(self, closing: Any) -> None:
        from gymnasium.utils.env_checker import check_env

        plain = closing(reactsim.Env(MINI, **SMALL))
        env = closing(reactsim.Env(MINI, flat=True, normalized=True, **SMALL))
        check_env(env, skip_render_check=True)
        one = {"scenario": 0, "rollout": 0}
        seen, flat = plain.reset(options=one)[0], env.reset(options=one)[0]
        for _ in range(5):
            assert np.array_equal(flat, np.concatenate([seen[name].ravel() for name in seen]))
            seen, flat = plain.step(np.array([3.0, -0.15]))[0], env.step(np.array([0.5, -0.5]))[0]
        assert np.array_equal(plain.states, env.states, equal_nan=True)
        with pytest.raises(ValueError, match="`normalized` is for actions with bounds"):
            reactsim.Env(MINI, action="state", normalized=True)

    def test_bounds_of_plans_grow_with_their_duration(self) -> None:
        from reactsim.environment import bounds

        for poses, metres in [(10, 400.0), (80, 400.0), (160, 800.0)]:
            assert bounds("plan", poses).tolist() == [[metres, metres, np.pi]] * poses

    def test_episodes_and_pictures_last_as_long_as_their_scenario(
        self, closing: Any, tmp_path: Path
    ) -> None:
        lengths = other_lengths(tmp_path)
        sizes = {**SMALL, "every": 30, "frames": 12}
        env = closing(reactsim.Env(tmp_path, render_mode="rgb_array", **sizes))
        for name, (history, steps) in lengths.items():
            seen, _ = env.reset(options={"scenario": name})
            # Frames before the first one are absent.
            present = min(history, 12)
            assert seen["av"][:, 6].tolist() == [0.0] * (12 - present) + [1.0] * present
            assert env.states.shape[1] == history
            picture = env.render()
            for decision in range(1, steps // 30 + 1):
                truncated = env.step(np.zeros(2))[3]
                assert truncated == (decision == steps // 30)
                assert env.states.shape[1] == history + 30 * decision
                before, picture = picture, env.render()
                assert not np.array_equal(before, picture)
            assert env.save_gif(tmp_path / "episode.gif", size=100)[:6] == b"GIF89a"

    @pytest.mark.parametrize(
        ("given", "frames", "steps"),
        [
            ({"future": 90}, 21, 90),
            ({"history": 11, "future": "6s"}, 11, 60),
            ({"future": "log"}, 21, 150),
        ],
    )
    def test_episodes_are_as_long_as_is_asked(
        self, closing: Any, tmp_path: Path, given: Dict[str, Any], frames: int, steps: int
    ) -> None:
        other_lengths(tmp_path)
        log = tmp_path / "long.json"
        env = closing(reactsim.Env(log, every=30, **given, **SMALL))
        envs = closing(reactsim.VectorEnv(log, num_envs=2, jobs=2, every=30, **given, **SMALL))
        env.reset()
        envs.reset()
        for decision in range(1, steps // 30 + 1):
            *_, terminated, truncated, info = env.step(np.zeros(2))
            assert not terminated and truncated == (decision == steps // 30)
            assert envs.step(np.zeros((2, 2)))[3].tolist() == [truncated] * 2
        assert env.states.shape[1] == frames + steps
        assert info["scores"].metrics["aav-collision"] is not None

    def test_lengths_that_a_log_does_not_have_are_refused(self, tmp_path: Path) -> None:
        other_lengths(tmp_path)
        with pytest.raises(reactsim.ReactsimError, match="short"):
            reactsim.Env(tmp_path / "short.json", future="10s")
        with pytest.raises(reactsim.ReactsimError, match="`future`"):
            reactsim.Env(limit=1, future="10s")

    def test_scenarios_that_cannot_be_read_are_left_out(self, closing: Any, tmp_path: Path) -> None:
        other_lengths(tmp_path)
        kinds: tuple[Any, ...] = (reactsim.Env, reactsim.VectorEnv, reactsim.ParallelEnv)
        for kind in kinds:
            with pytest.warns(UserWarning, match=r"1 skipped, the first: .*short\.json") as warned:
                env = closing(kind(tmp_path, future="10s"))
            assert warned[0].filename == __file__
            assert len(env.scenarios) == 1

    def test_stable_baselines_has_no_objections(
        self, closing: Any, recwarn: pytest.WarningsRecorder
    ) -> None:
        checker = pytest.importorskip("stable_baselines3.common.env_checker")
        env = closing(reactsim.Env(MINI, flat=True, normalized=True, **SMALL))
        recwarn.clear()
        checker.check_env(env)
        assert [str(warning.message) for warning in recwarn] == []

    def test_pictures_show_the_episode(self, closing: Any, ffmpeg: Path, tmp_path: Path) -> None:
        env = closing(reactsim.Env(MINI, render_mode="rgb_array", **SMALL))
        env.reset(seed=1)
        first = env.render()
        assert first.shape == (480 + 46, 480, 3) and first.dtype == np.uint8
        env.step(np.array([1.0, 0.0]))
        assert not np.array_equal(env.render(), first)
        gif = env.save_gif(tmp_path / "episode.gif", size=100, every=2)
        assert gif[:6] == b"GIF89a" and gif == (tmp_path / "episode.gif").read_bytes()
        env.save_mp4(tmp_path / "episode.mp4", size=100, every=2)
        assert (tmp_path / "episode.mp4").read_bytes() == gif
        several = closing(
            reactsim.VectorEnv(MINI, num_envs=2, jobs=2, render_mode="rgb_array", **SMALL)
        )
        several.reset(seed=1, options={"scenarios": [0, 1]})
        pictures = several.render()
        assert len(pictures) == 2 and not np.array_equal(*pictures)
        gif = several.save_gif(tmp_path / "second.gif", 1)
        assert gif[:6] == b"GIF89a"
        several.save_mp4(tmp_path / "second.mp4", 1)
        assert (tmp_path / "second.mp4").read_bytes() == gif
        ffmpeg.unlink()
        with pytest.raises(reactsim.ReactsimError, match="need the program `ffmpeg`"):
            env.save_mp4(tmp_path / "episode.mp4", size=100, every=2)
        silent = closing(reactsim.Env(MINI, **SMALL))
        assert silent.render() is None
        with pytest.raises(ValueError, match="expected None or 'rgb_array'"):
            reactsim.Env(MINI, render_mode="human")
        with pytest.raises(ValueError, match="`size` is 9, expected a whole number, 100 to 1200"):
            env.save_gif(tmp_path / "small.gif", size=9)

    def test_gymnasium_makes_environments(self, closing: Any) -> None:
        import gymnasium

        env = closing(
            gymnasium.make("reactsim/Drive-v0", scenarios=MINI, simulator="stop", **SMALL)
        )
        assert isinstance(env.unwrapped, reactsim.Env)
        assert env.reset(seed=1)[1]["scenario"] in env.unwrapped.scenarios
        envs = closing(gymnasium.make_vec("reactsim/Drive-v0", 3, scenarios=MINI, **SMALL))
        assert isinstance(envs, reactsim.VectorEnv) and envs.num_envs == 3

    def test_processes_share_the_episodes(self, closing: Any) -> None:
        settings: Dict[str, Any] = {"num_envs": 5, "end_at": "off-road", "every": 4, **SMALL}
        one = closing(reactsim.VectorEnv(MINI, jobs=1, **settings))
        three = closing(reactsim.VectorEnv(MINI, jobs=3, **settings))
        assert [len(env._core.processes) for env in (one, three)] == [1, 3]
        one.reset(seed=1), three.reset(seed=1)
        actions = np.tile(np.array([1.0, 0.02]), (5, 1))
        ended = 0
        for _ in range(25):
            first, second = one.step(actions), three.step(actions)
            assert all(np.array_equal(first[0][name], second[0][name]) for name in first[0])
            for k in (1, 2, 3):
                assert np.array_equal(first[k], second[k])
            assert list(first[4]) == list(second[4])
            for name, values in first[4].items():
                if name in ("scores", "scenario"):
                    assert values.tolist() == second[4][name].tolist()
                else:
                    assert np.array_equal(values, second[4][name], equal_nan=True), name
            ended += int(first[2].sum() + first[3].sum())
        assert ended > 3
        for index in range(5):
            assert np.array_equal(one.states(index), three.states(index), equal_nan=True)
        wrong = actions.copy()
        wrong[4, 1] = np.nan
        running = np.flatnonzero(~three._is_over)
        wrong[running[-1], 1] = np.nan
        before = [three.states(index).shape for index in range(5)]
        with pytest.raises(reactsim.ReactsimError, match=f"slot {running[-1]} is nan, expected"):
            three.step(wrong)
        assert [three.states(index).shape for index in range(5)] == before
        three.step(actions)
        for given, text in [
            ({"simulator": Stop()}, "expected 1 for simulators of one's own"),
            ({"action": "state"}, "expected 1 for simulators with states as actions"),
            ({"jobs": 3}, "`jobs` is 3, expected a whole number, 1 to 2"),
        ]:
            with pytest.raises(ValueError, match=text):
                reactsim.VectorEnv(MINI, **{"num_envs": 2, "jobs": 2, **given, **SMALL})

    @pytest.mark.parametrize("jobs", [1, 2])
    def test_restarted_episodes_take_no_step(self, jobs: int, closing: Any) -> None:
        envs = closing(reactsim.VectorEnv(MINI, num_envs=3, jobs=jobs, every=40, **SMALL))
        single = closing(reactsim.Env(MINI, every=40, **SMALL))
        envs.reset(seed=1)
        with pytest.raises(reactsim.ReactsimError, match="no episode is over"):
            envs.restart()
        actions = np.zeros((3, 2))
        envs.step(actions)
        assert envs.step(actions)[3].all()
        seen = envs.restart()
        episode = {name: envs._episodes[1][name] for name in ("scenario", "rollout")}
        expected, _ = single.reset(options=episode)
        assert all(np.array_equal(seen[name][1], expected[name]) for name in seen)
        assert [envs.states(index).shape[1] for index in range(3)] == [11, 11, 11]
        seen, _, _, truncated, infos = envs.step(actions)
        assert not truncated.any() and infos["_speed"].all()
        flags = [infos[f"_{name}"] for name in envs._core.measures]
        assert not any(np.shares_memory(flags[0], other) for other in flags[1:])
        expected = single.step(actions[0])[0]
        assert all(np.array_equal(seen[name][1], expected[name]) for name in seen)

    def test_the_traffic_is_that_of_run(self, results: Any, closing: Any) -> None:
        env = closing(reactsim.Env(MINI, action="state", **SMALL))
        metrics = ("aav-collision", "aav-ttc", "aa-collision", "offroad", "direction")
        for scenario in reactsim.scenarios(MINI):
            states, info = replayed(env, scenario, 1)
            assert np.array_equal(states, states_of(results, scenario.id)[1], equal_nan=True)
            check_metrics(info["scores"], results, scenario.id, 1, metrics)

    def test_mixed_traffic_is_that_of_run(self, tmp_path: Path, closing: Any) -> None:
        mix = "mix:constant-velocity=1+idm=1"
        out = tmp_path / "run"
        results = reactsim.run(baselines=[mix], scenarios=MINI, out=out, progress=False)
        assert set(results.rows["simulator"]) == {mix}
        env = closing(reactsim.Env(MINI, "mix:idm=1, constant-velocity=1", action="state", **SMALL))
        for scenario in reactsim.scenarios(MINI):
            states, _ = replayed(env, scenario, 0)
            assert np.array_equal(states, states_of(results, scenario.id)[0], equal_nan=True)

    def test_an_own_simulator_is_traffic_as_in_run(
        self,
        own: Dict[str, Any],
        closing: Any,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        monkeypatch.setenv("PYTHONPATH", str(IMPORTED))
        script = tmp_path / "mine.py"
        script.write_text(SCRIPT)
        sources = [Careful(), Careful, f"command={sys.executable} {script}"]
        for simulator in sources:
            env = closing(reactsim.Env(MINI, simulator, action="state", seed=3, **SMALL))
            for scenario in reactsim.scenarios(MINI):
                states, info = replayed(env, scenario, 1)
                assert info["scores"].metrics["aav-collision"] is not None
                assert np.array_equal(states, own[scenario.id], equal_nan=True)
            # An episode may begin before the last one is over.
            env.reset()
            env.step(np.array([0.0, 0, 0, 0, 0]) + env.states[0, -1])
            env.reset()

    def test_nothing_of_the_future_reaches_an_own_simulator(self, closing: Any) -> None:
        seen: List[Any] = []

        class Curious(Stop):  # type: ignore[misc]
            def plan(self, now: reactsim.Observation) -> Any:
                seen.append((now.states.copy(), now.av_next.copy()))
                return super().plan(now)

        scenario = next(reactsim.scenarios(MINI))
        for lookahead in (True, False):
            seen.clear()
            env = closing(
                reactsim.Env(MINI, Curious(), action="state", av_lookahead=lookahead, **SMALL)
            )
            env.reset(options={"scenario": scenario.id})
            assert seen == []
            assert scenario.av is not None
            for state in scenario.av[:6]:
                env.step(state)
            assert [states.shape[2] for states, _ in seen] == [11, 16]
            for step, (_, av_next) in zip((0, 5), seen):
                expected = scenario.av[step, :3] if lookahead else np.full(3, np.nan)
                assert np.array_equal(av_next[0, :3], expected, equal_nan=True)

    def test_own_simulators_that_fail_are_errors(
        self, closing: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("PYTHONPATH", str(IMPORTED))

        class Wrong(Stop):  # type: ignore[misc]
            name = "wrong"

            def plan(self, now: reactsim.Observation) -> Any:
                return super().plan(now)[:, :, :2]

        class Unable(Stop):  # type: ignore[misc]
            name = "unable"

            def plan(self, now: reactsim.Observation) -> Any:
                return reactsim.Plan(super().plan(now), errors={0: "too many agents"})

        class Unready(Stop):  # type: ignore[misc]
            name = "unready"

            def begin(self, scenes: reactsim.Scenes) -> None:
                raise ValueError("no map")

        action = np.zeros(2)
        for simulator, text in [
            (Raising(), r"simulator `raising`: (.|\n)*ZeroDivisionError: nothing to divide"),
            (Wrong(), r"simulator `wrong`: (.|\n)*Wrong.plan returned an array of shape"),
        ]:
            for settings in ({}, {"num_envs": 2}):
                kind: Any = reactsim.VectorEnv if settings else reactsim.Env
                env = closing(kind(MINI, simulator, **settings, **SMALL))
                env.reset(seed=1)
                actions = np.zeros((2, 2)) if settings else action
                with pytest.raises(reactsim.ReactsimError, match=text) as caught:
                    env.step(actions)
                is_raised = isinstance(simulator, Raising)
                assert isinstance(caught.value.__cause__, ZeroDivisionError) == is_raised
                with pytest.raises(reactsim.ReactsimError, match="is over: reset it"):
                    env.step(actions)
                env.reset()
        env = closing(reactsim.Env(MINI, Unable(), **SMALL))
        env.reset(seed=1)
        *_, truncated, info = env.step(action)
        assert truncated
        assert "simulator `unable`: " in info["failure"] and "too many agents" in info["failure"]
        env = closing(reactsim.Env(MINI, Unready(), **SMALL))
        with pytest.raises(reactsim.ReactsimError, match=r"`unready`: (.|\n)*ValueError: no map"):
            env.reset()
        script = tmp_path / "slow.py"
        script.write_text(SCRIPT.replace("now = ", "__import__('time').sleep(60)\n        now = "))
        slow = f"slow={sys.executable} {script}"
        env = closing(reactsim.Env(MINI, slow, external_limit="5s", **SMALL))
        env.reset(seed=1)
        began = time.monotonic()
        with pytest.raises(reactsim.ReactsimError, match=r"`slow`: .* no `planned` within 5 s"):
            env.step(action)
        assert time.monotonic() - began < 30.0
        wrong: List[Any] = [
            ({"simulator": reactsim.Planner()}, ValueError, "Planner is a planner, expected a sim"),
            ({"simulator": object()}, TypeError, "it has no method `plan`"),
            ({"simulator": Stop(), "external_limit": "2s"}, ValueError, "is for commands"),
            (
                {"external_limit": "2s"},
                reactsim.ReactsimError,
                "is for commands: the baseline `idm`",
            ),
            ({"agent": 3}, TypeError, r"^Env\(\) got an unexpected keyword argument 'agent'"),
            ({"batches": 3}, TypeError, r"^Env\(\) got an unexpected keyword argument 'batches'"),
            ({"simulator": "mine=exit 3"}, reactsim.ReactsimError, "`mine` did not start"),
            ({"simulator": Named()}, reactsim.ReactsimError, "idm"),
            (
                {"simulator": Stop(), "parameters": {"a.b": 1}},
                reactsim.ReactsimError,
                "no baseline",
            ),
        ]
        for given, error, text in wrong:
            with pytest.raises(error, match=text):
                reactsim.Env(MINI, **given, **SMALL)
        with pytest.raises(reactsim.ReactsimError, match="`num_envs` is 257: at most 256"):
            reactsim.VectorEnv(MINI, "mine=exit 3", num_envs=257, **SMALL)
        with pytest.raises(TypeError, match=r"^ParallelEnv\(\) got an unexpected keyword"):
            reactsim.ParallelEnv(MINI, agent=3)

    def test_observations_are_in_the_frame_of_the_av(self, closing: Any) -> None:
        env = closing(reactsim.Env(MINI, action="state", **SMALL))
        scenario = next(reactsim.scenarios(MINI))
        seen, _ = env.reset(options={"scenario": scenario.id})
        now = scenario.history[0, -1]
        assert np.allclose(seen["av"][-1, :4], [0, 0, 1, 0], atol=1e-6)
        assert seen["av"][-1, 4] == pytest.approx(np.hypot(now[3], now[4]), abs=0.1)
        others = scenario.history[1:, -1, :2] - now[:2]
        nearest = min(np.hypot(*other) for other in others)
        assert np.hypot(*seen["agents"][0, -1, :2]) == pytest.approx(nearest, rel=1e-5)
        assert np.array_equal(seen["av_size"], scenario.sizes[0].astype(np.float32))

    def test_nothing_of_the_future_is_observed(self, tmp_path: Path, closing: Any) -> None:
        # The route is the path of the log, which the copy without a future does not have.
        past = tmp_path / "past.parquet"
        reactsim.command("convert", MINI, history_only=True, out=past, progress=False)
        seen = []
        for source in (MINI, past):
            env = closing(reactsim.Env(source, **{**SMALL, "route": 0}))
            one, _ = env.reset(options={"scenario": 0, "rollout": 0})
            for _ in range(10):
                one, *_ = env.step(np.array([-1.0, 0.0]))
            seen.append(one)
        for name in ("av", "agents", "lanes"):
            assert np.array_equal(seen[0][name], seen[1][name]), name

    def test_wrong_use_is_refused(self, closing: Any) -> None:
        env = closing(reactsim.Env(MINI, **SMALL))
        with pytest.raises(reactsim.ReactsimError, match="call `reset` first"):
            env.step(np.zeros(2))
        env.reset(seed=1)
        for action, text in [
            (np.zeros(3), r"shape \(3,\), expected \(2,\)"),
            (np.array(["a", "b"]), "expected numbers"),
        ]:
            with pytest.raises(ValueError, match=text):
                env.step(action)
        with pytest.raises(reactsim.ReactsimError, match="is NaN, expected a finite number"):
            env.step(np.array([np.nan, 0.0]))
        env.step(np.zeros(2))
        for wrong, text in [
            ({"scenario": "nowhere"}, "no scenario `nowhere`"),
            ({"scenario": 99}, "`scenario` is 99, expected a whole number, 0 to "),
            ({"scenario": 0.7}, "`scenario` is 0.7, expected a whole number"),
            ({"rollout": -1}, "`rollout` is -1, expected a whole number, 0 to 4294967295"),
            ({"rollout": True}, "`rollout` is True"),
            ({"other": 1}, "expected `scenario` and `rollout`"),
        ]:
            with pytest.raises(ValueError, match=text):
                env.reset(options=wrong)
        env.close()
        with pytest.raises(reactsim.ReactsimError, match="is closed"):
            env.reset()
        for settings, error in [
            ({"action": "fly"}, ValueError),
            ({"reward": {"joy": 1.0}}, ValueError),
            ({"every": 0}, reactsim.ReactsimError),
            ({"simulator": "nobody"}, reactsim.ReactsimError),
            ({"ids": ["nowhere"]}, reactsim.ReactsimError),
            ({"end_at": ["noon"]}, reactsim.ReactsimError),
            ({"limit": 1.5}, ValueError),
            ({"seed": -1}, ValueError),
        ]:
            with pytest.raises(error):
                reactsim.Env(MINI, **settings)  # type: ignore[arg-type]

    def test_numbers_of_numpy_are_numbers(self, closing: Any) -> None:
        one, seed = np.int64(1), np.uint32(3)
        env = closing(reactsim.Env(MINI, limit=one, seed=seed, every=one, scores=np.bool_(True)))
        _, info = env.reset(options={"scenario": np.int32(0), "rollout": seed})
        assert info["rollout"] == 3
        assert len(list(reactsim.scenarios(MINI, limit=one))) == 1  # type: ignore[arg-type]

    @pytest.mark.parametrize("name", ["current_frame", "window_step", "all_agents"])
    def test_choices_without_effect_are_refused(self, name: str) -> None:
        kinds: tuple[object, ...] = (reactsim.Env, reactsim.VectorEnv, reactsim.ParallelEnv)
        for kind in kinds:
            with pytest.raises(reactsim.ReactsimError, match=f"leave `{name}` out"):
                kind(limit=2, **{name: 5 if name != "all_agents" else True})  # type: ignore[operator]
            with pytest.raises(ValueError, match=f"`{name}` is given with a `Scenario`"):
                kind(next(reactsim.scenarios(MINI)), **{name: 5})  # type: ignore[operator]

    def test_a_state_too_far_away_changes_nothing(self, closing: Any) -> None:
        env = closing(reactsim.Env(MINI, action="state", **SMALL))
        scenario = next(reactsim.scenarios(MINI))
        env.reset(options={"scenario": scenario.id})
        with pytest.raises(reactsim.ReactsimError, match=r"expected at most 8\.0 m"):
            env.step(np.array([900.0, 0, 0, 0, 0]))
        assert env.states.shape[1] == 11
        env.step(scenario.history[0, -1])
        assert env.states.shape[1] == 12

    def test_contacts_end_episodes(self, closing: Any) -> None:
        # Full speed ahead ends in an object or off the road in one of the scenarios.
        env = closing(reactsim.Env(MINI, "stop", end_at=["contact", "off-road"], **SMALL))
        ends = []
        for scenario in env.scenarios:
            env.reset(options={"scenario": scenario})
            over, steps = False, 0
            while not over:
                _, _, terminated, truncated, info = env.step(np.array([6.0, 0.0]))
                over, steps = terminated or truncated, steps + 1
            assert terminated == bool(info["contact"] or info["off_road"] == 1.0)
            assert terminated or steps == 80
            metrics = info["scores"].metrics
            assert metrics["aav-collision"] is not None and metrics["offroad"] is not None
            assert all(event.step <= steps for event in info["scores"].events)
            if terminated and steps < 80:
                assert metrics["av-score"] is None
            ends.append(terminated)
            with pytest.raises(reactsim.ReactsimError, match="it is over"):
                env.step(np.zeros(2))
        assert any(ends)

    def test_a_vector_has_the_episodes_of_single_environments(self, closing: Any) -> None:
        single = closing(reactsim.Env(MINI, **SMALL))
        several = closing(reactsim.VectorEnv(MINI, num_envs=3, **SMALL))
        seen, _ = several.reset(seed=1, options={"scenarios": [0, 1, 2], "rollouts": [0, 0, 0]})
        assert several.observation_space.contains(seen)
        action = np.array([0.5, 0.01], np.float32)
        for _ in range(80):
            seen, rewards, _, truncated, infos = several.step(np.tile(action, (3, 1)))
        assert truncated.all() and infos["_scores"].all()
        for index in range(3):
            single.reset(options={"scenario": index, "rollout": 0})
            for _ in range(80):
                one, reward, *_ = single.step(action)
            assert reward == rewards[index]
            assert all(np.array_equal(one[name], seen[name][index]) for name in one)
            assert np.array_equal(single.states, several.states(index), equal_nan=True)
        seen, rewards, _, truncated, infos = several.step(np.tile(action, (3, 1)))
        assert not truncated.any() and not rewards.any() and not infos["_speed"].any()
        assert several.states(0).shape[1] == 11

    def test_episodes_of_own_simulators_begin_at_different_times(
        self, own: Dict[str, Any], closing: Any
    ) -> None:
        env = closing(
            reactsim.VectorEnv(MINI, Careful(), num_envs=3, action="state", seed=3, **SMALL)
        )
        by_id = {scenario.id: scenario for scenario in reactsim.scenarios(MINI)}
        env.reset(seed=1, options={"rollouts": [1, 1, 1]})
        core, compared, steps = env._core, 0, [0, 0, 0]
        episode = core.episode
        core.episode = lambda slot, generator: episode(slot, generator, rollout=1)
        for count in range(1, 201):
            ids = [core.scenarios[episode["scenario"]] for episode in env._episodes]
            states = np.stack([by_id[i].av[min(n, 79)] for i, n in zip(ids, steps)])  # type: ignore[index]
            is_over = env._is_over.copy()
            _, _, _, truncated, infos = env.step(states)
            assert "failure" not in infos
            for index in range(3):
                steps[index] = 0 if is_over[index] else steps[index] + 1
                if truncated[index]:
                    found = env.states(index)[:, 11:]
                    assert np.array_equal(found, own[ids[index]], equal_nan=True)
                    compared += 1
            # One episode begins anew before the others are over, and then plans when they do.
            env._is_over[1] |= count == 34
        assert compared == 6

    @pytest.mark.parametrize("every", [1, 5])
    def test_a_refused_step_moves_nobody(self, every: int, closing: Any) -> None:
        kind = {"action": "state"} if every == 1 else {"action": "plan", "poses": 10}
        envs = closing(reactsim.VectorEnv(MINI, num_envs=2, every=every, **kind, **SMALL))
        envs.reset(seed=1)
        stays = [envs.states(index)[0, -1] for index in range(2)]
        good = np.array(stays) if every == 1 else np.zeros((2, 10, 3))
        wrong = good.copy()
        wrong[1, ..., 0] = 1e300 if every == 1 else np.nan
        with pytest.raises(reactsim.ReactsimError, match="slot 1"):
            envs.step(wrong)
        assert [envs.states(index).shape[1] for index in range(2)] == [11, 11]
        envs.step(good)
        assert [envs.states(index).shape[1] for index in range(2)] == [11 + every] * 2


class TestParallelEnv:
    SIZES = MappingProxyType({name: size for name, size in SMALL.items() if name != "route"})

    @pytest.fixture(autouse=True)
    def pettingzoo(self) -> None:
        pytest.importorskip("pettingzoo")

    def test_it_is_a_parallel_environment(self, closing: Any) -> None:
        from pettingzoo.test import parallel_api_test

        env = closing(reactsim.ParallelEnv(MINI, **self.SIZES))
        parallel_api_test(env, num_cycles=100)

    def test_pictures_show_the_episode(self, closing: Any, ffmpeg: Path, tmp_path: Path) -> None:
        env = closing(reactsim.ParallelEnv(MINI, render_mode="rgb_array", **self.SIZES))
        env.reset(seed=1)
        assert env.render().shape == (480 + 46, 480, 3)
        gif = env.save_gif(tmp_path / "episode.gif", size=100)
        assert gif[:6] == b"GIF89a"
        env.save_mp4(tmp_path / "episode.mp4", size=100)
        assert (tmp_path / "episode.mp4").read_bytes() == gif

    def test_agents_that_repeat_a_run_have_its_states_and_metrics(
        self, results: Any, closing: Any
    ) -> None:
        env = closing(reactsim.ParallelEnv(MINI, action="state", **self.SIZES))
        metrics = ("aav-collision", "aav-ttc", "aa-collision", "offroad", "over-reaction")
        for scenario in env.scenarios[:3]:
            expected = states_of(results, scenario)[0]
            _, infos = env.reset(options={"scenario": scenario})
            assert [info["scenario"] for info in infos.values()] == [scenario] * len(env.agents)
            for step in range(80):
                states = expected[1:, step]
                _, _, _, truncated, infos = env.step(dict(zip(env.agents, states)))
            assert all(truncated.values()) and env.agents == []
            assert np.array_equal(env.states[:, 11:], expected, equal_nan=True)
            check_metrics(infos["agent_1"]["scores"], results, scenario, 0, metrics)

    @pytest.mark.parametrize("controlled", [1, 3])
    def test_an_own_simulator_moves_the_other_agents(
        self, own: Dict[str, Any], controlled: int, closing: Any
    ) -> None:
        settings: Dict[str, Any] = {"controlled": controlled, "seed": 3, **self.SIZES}
        env = closing(reactsim.ParallelEnv(MINI, simulator=Careful(), action="state", **settings))
        for scenario in env.scenarios:
            seen, _ = env.reset(options={"scenario": scenario, "rollout": 1})
            expected = own[scenario]
            assert len(seen) == min(controlled, len(expected) - 1)
            for step in range(80):
                states = expected[1 : 1 + len(env.agents), step]
                *_, infos = env.step(dict(zip(env.agents, states)))
            assert np.array_equal(env.states[:, 11:], expected, equal_nan=True)
            assert infos["agent_1"]["scores"].metrics["aav-collision"] is not None

        env = closing(reactsim.ParallelEnv(MINI, simulator=Raising, **settings))
        env.reset(seed=1)
        with pytest.raises(reactsim.ReactsimError, match=r"`raising`: (.|\n)*nothing to divide"):
            env.step({agent: np.zeros(2) for agent in env.agents})
        for wrong, error in [
            ({"simulator": "idm"}, ValueError),
            ({"controlled": 2}, ValueError),
            ({"seed": 2}, ValueError),
            ({"simulator": "log-replay", "controlled": 2}, reactsim.ReactsimError),
        ]:
            with pytest.raises(error):
                reactsim.ParallelEnv(MINI, **wrong)  # type: ignore[arg-type]

    def test_wrong_use_is_refused(self, closing: Any) -> None:
        env = closing(reactsim.ParallelEnv(MINI, **self.SIZES))
        with pytest.raises(reactsim.ReactsimError, match="call `reset` first"):
            env.step({})
        env.reset(seed=1)
        actions = {agent: np.zeros(2) for agent in env.agents}
        with pytest.raises(ValueError, match=r"lacks \['agent_1'\]"):
            env.step({agent: action for agent, action in actions.items() if agent != "agent_1"})
        with pytest.raises(ValueError, match=r"shape \(3,\), expected \(2,\)"):
            env.step({**actions, "agent_1": np.zeros(3)})
        for settings, error in [
            ({"action": "plan"}, ValueError),
            ({"av": "planner:idm"}, reactsim.ReactsimError),
            ({"av": "nobody"}, reactsim.ReactsimError),
        ]:
            with pytest.raises(error):
                reactsim.ParallelEnv(MINI, **settings)  # type: ignore[arg-type]


def test_environments_without_gymnasium_say_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "gymnasium", None)
    monkeypatch.delitem(__import__("sys").modules, "reactsim.environment", raising=False)
    with pytest.raises(ImportError, match=r"pip install 'reactsim\[env\]'"):
        reactsim.Env  # noqa: B018


def test_the_process_ends_with_its_parent(tmp_path: Path) -> None:
    pids = tmp_path / "pids"
    parent = os.fork()
    if parent == 0:
        process = ProgramProcess()
        # This child keeps the streams of the process open.
        child = os.fork()
        if child == 0:
            time.sleep(20.0)
            os._exit(0)
        pids.write_text(f"{pid_of(process)} {child}")
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(parent, 0)
    pid, child = map(int, pids.read_text().split())
    deadline = time.monotonic() + 15.0
    while is_running(pid) and time.monotonic() < deadline:
        time.sleep(0.1)
    os.kill(child, signal.SIGKILL)
    assert not is_running(pid)


def test_the_process_ends_with_a_parent_that_ended_before_it_started() -> None:
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    command = [reactsim.find_program(), "session", "--parent", str(ended.pid)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as program:
        assert program.wait(15.0) == 0


def test_threads_share_the_process_of_scores(results: Any) -> None:
    scenario = next(reactsim.scenarios(MINI))
    states = states_of(results, scenario.id)
    expected = reactsim.score_states(scenario, states)
    found: List[Any] = []
    threads = [
        threading.Thread(target=lambda: found.append(reactsim.score_states(scenario, states)))
        for _ in range(3)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [expected] * 3

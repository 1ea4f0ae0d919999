"""Prints how agents behave that a deviated AV does not concern, and who stands without a reason.

Reads a run with log replay and kept rollouts, and the certificates of its deviated AVs, which say whom an AV disturbs:

    reactsim run bench.parquet --models log-replay,idm,ntp-guarded --keep-rollouts --out runs/behaviour
    PYTHONPATH=python python3 benches/behaviour.py runs/behaviour bench.parquet

`ADE apart` is the mean distance to the log over agents without a response in the certificate and over steps at which both are
there: per scenario, then over scenarios. `stands` is the share of steps at which vehicles that are no AV are below 0.2 m/s, in the
log and in the rollout; `waits` is the share of vehicles that the log moves by more than 5 m in the last four seconds while they
stand all that time. Intervals are half of the 95 % interval of the mean over scenarios. Needs numpy and pyarrow.
"""

import sys
from collections import defaultdict

import numpy as np
import pyarrow.parquet as pq
import reactsim

STANDSTILL = 0.2
LAST_STEPS = 40
MOVED = 5.0


def main() -> None:
    """Reads a run and prints the table."""
    run, responders = reactsim.Results(sys.argv[1]), certificates(sys.argv[2:])
    replayed = run.rollouts(simulator="log-replay")
    logs = {r.scenario: r.states[..., :2] for r in replayed if r.rollout == 0}
    values = defaultdict(lambda: defaultdict(dict))
    for rollout in run.rollouts():
        key, ids = rollout.scenario, rollout.agents
        if rollout.rollout or key not in responders or key not in logs:
            continue
        concerned, vehicles = responders[key]
        tracks, log = rollout.states[..., :2], logs[key]
        # Slot 0 is the AV.
        apart = [i for i, agent in enumerate(ids) if i > 0 and agent not in concerned]
        distances = np.linalg.norm(tracks[apart] - log[apart], axis=-1)
        own = values[rollout.simulator]
        own["ADE apart"][key] = nanmean(distances)
        moving = [i for i, agent in enumerate(ids) if i > 0 and (vehicles is None or agent in vehicles)]
        speeds, logged = (10.0 * np.linalg.norm(np.diff(t[moving], axis=1), axis=-1) for t in (tracks, log))
        both = ~np.isnan(speeds) & ~np.isnan(logged)
        own["stands"][key] = nanmean(np.where(both, speeds < STANDSTILL, np.nan))
        own["stands in log"][key] = nanmean(np.where(both, logged < STANDSTILL, np.nan))
        late, late_log = speeds[:, -LAST_STEPS:], logged[:, -LAST_STEPS:]
        stuck = (late < STANDSTILL).all(axis=1) & (np.nan_to_num(late_log).sum(axis=1) > 10.0 * MOVED)
        own["waits"][key] = float(stuck.mean()) if len(stuck) else np.nan
    names = ["ADE apart", "stands", "stands in log", "waits"]
    print("| simulator | " + " | ".join(names) + " |\n|---|" + "--:|" * len(names))
    for simulator, own in values.items():
        print(f"| {simulator} | " + " | ".join(text(name, own[name]) for name in names) + " |")


def certificates(files: list) -> dict:
    """Returns, by scenario, the agents with a response, and the vehicles if the file names kinds of agents."""
    found = {}
    for file in files:
        table = pq.ParquetFile(file)
        names = table.schema_arrow.names
        own = "id" if "id" in names else "scenario_id"
        columns = [own, "response_agent"] + [c for c in ("agent_id", "agent_kind", "chosen") if c in names]
        for batch in table.iter_batches(256, columns=columns):
            for row in batch.to_pylist():
                if row.get("chosen", True) and row["response_agent"] is not None:
                    kinds = row.get("agent_kind")
                    vehicles = None
                    if kinds:
                        vehicles = {a for a, kind in zip(row["agent_id"], kinds) if kind == "vehicle"}
                    found[row[own]] = (set(row["response_agent"]), vehicles)
    return found


def nanmean(values: np.ndarray) -> float:
    """Returns the mean of what is known; NaN if nothing is."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if known.size else float("nan")


def text(name: str, by_scenario: dict) -> str:
    """Returns mean and half interval over scenarios."""
    values = np.array([v for v in by_scenario.values() if not np.isnan(v)])
    half = 1.96 * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.2f} ±{half:.2f}" if name == "ADE apart" else f"{values.mean():.3f} ±{half:.3f}"


if __name__ == "__main__":
    main()

"""Prints how agents behave that a deviated AV does not concern, and who stands without a reason.

Reads a run with log replay and kept rollouts, and the certificates of its deviated AVs, which say whom an AV disturbs:

    reactsim run bench.parquet --models log-replay,idm,ntp-guarded --keep-rollouts --out runs/behaviour
    python3 benches/behaviour.py runs/behaviour bench.parquet

`ADE apart` is the mean distance to the log over agents without a response in the certificate and over steps at which both are
there: per scenario, then over scenarios. `stands` is the share of steps at which vehicles that are no AV are below 0.2 m/s, in the
log and in the rollout; `waits` is the share of vehicles that the log moves by more than 5 m in the last four seconds while they
stand all that time. Intervals are half of the 95 % interval of the mean over scenarios. Needs numpy and pyarrow.
"""

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

STANDSTILL = 0.2
LAST_STEPS = 40
MOVED = 5.0


def main() -> None:
    """Reads a run and prints the table."""
    run, files = Path(sys.argv[1]), sys.argv[2:]
    responders = certificates(files)
    logs, values = {}, defaultdict(lambda: defaultdict(dict))
    for record in records(run):
        key, ids = record["scenario_id"], record["agent_id"]
        tracks = np.stack([filled(record[c]) for c in ("x", "y")], axis=-1)
        if record["simulator"] == "log-replay":
            logs[key] = (ids, tracks)
    for record in records(run):
        key, ids = record["scenario_id"], record["agent_id"]
        if key not in responders or key not in logs:
            continue
        concerned, vehicles = responders[key]
        tracks = np.stack([filled(record[c]) for c in ("x", "y")], axis=-1)
        log = logs[key][1]
        # Slot 0 is the AV.
        apart = [i for i, agent in enumerate(ids) if i > 0 and agent not in concerned]
        distances = np.linalg.norm(tracks[apart] - log[apart], axis=-1)
        own = values[record["simulator"]]
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


def records(run: Path):
    """Yields the first rollout of every scenario and simulator."""
    file = pq.ParquetFile(run / "rollouts.parquet")
    columns = ["scenario_id", "simulator", "rollout", "agent_id", "x", "y"]
    for batch in file.iter_batches(64, columns=columns):
        yield from (r for r in batch.to_pylist() if r["rollout"] == 0)


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


def filled(rows: list) -> np.ndarray:
    """Returns positions of all agents, NaN where they are absent."""
    values = [[np.nan if v is None else v for v in row] for row in rows]
    return np.array(values, dtype=float)


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

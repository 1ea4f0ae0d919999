#!/usr/bin/env python3
"""Writes the tables of docs/paper-findings.md: numbers of the paper next to `references`.

`python3 benches/paper.py` rewrites the tables; with `--check` it fails if they are out of date.
"""

import json
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "paper-findings.md"

# Main table of ReactSim-Bench (reactive protocol): A-AV Coll., A-AV risky, Acc. (%), Steer. (%).
PAPER = {
    "Log Replay": (0.9829, 1.5380, 0.16, 2.51),
    "MTR": (0.1457, 0.5819, 0.64, 14.29),
    "CTG": (0.6195, 0.9476, 10.87, 7.08),
    "VBD": (0.2276, 0.4711, 0.01, 0.18),
    "SMART": (0.1419, 0.3976, 9.74, 4.83),
    "CATK": (0.1426, 0.4029, 10.25, 5.02),
    "TrajTok": (0.1407, 0.4173, 3.23, 3.93),
}
# Table of both protocols: A-AV Coll. (reactive); A-AV Coll., ADE, kinematic likelihood (realism).
PROTOCOLS = {
    "MTR": (0.1457, 0.0781, 2.5498, 0.2379),
    "CTG": (0.6195, 0.2527, 1.9405, 0.2721),
    "VBD": (0.2276, 0.0819, 1.1579, 0.2975),
    "SMART": (0.1419, 0.0125, 0.8021, 0.3510),
    "CATK": (0.1426, 0.0095, 0.7988, 0.3645),
    "TrajTok": (0.1407, 0.0099, 0.8266, 0.3652),
}
# Shares of scenarios in which log replay collides and is risky, %.
PRESSURE = (83.46, 98.14)
# The six systems here: reference and simulator. The paper lists CTG as behaviour cloning.
SYSTEMS = {
    "MTR": ("paper-networks", "mtr"),
    "CTG": ("paper-networks", "ctg-cloning"),
    "VBD": ("paper-networks", "vbd"),
    "SMART": ("token-networks", "smart-small"),
    "CATK": ("token-networks", "catk-small"),
    "TrajTok": ("token-networks", "trajtok-small"),
}
COLLISION, RISKY = "aav-collision", "aav-ttc"


def simulators(reference: str) -> dict:
    """Returns the simulators of a reference."""
    return json.loads((ROOT / "references" / reference / "summary.json").read_text())["simulators"]


def mean(reference: str, simulator: str, metric: str) -> float:
    """Returns the mean of a metric."""
    return simulators(reference)[simulator]["metrics"][metric]["mean"]


def interval(reference: str, simulator: str, metric: str) -> str:
    """Returns a mean with half the width of its 95 % interval."""
    found = simulators(reference)[simulator]["metrics"][metric]
    return f"{found['mean']:.3f} ±{(found['high'] - found['low']) / 2:.3f}"


def relative(reference: str, simulator: str, metric: str) -> float:
    """Returns a metric relative to log replay."""
    return mean(reference, simulator, metric) / mean(reference, "log-replay", metric)


def ranks(values: list[float]) -> list[float]:
    """Returns the ranks of values; equal values share the mean of their ranks."""
    ordered = sorted(values)
    return [ordered.index(v) + (ordered.count(v) + 1) / 2 for v in values]


def spearman(a: list[float], b: list[float]) -> float:
    """Returns the rank correlation of two lists."""
    a, b = ranks(a), ranks(b)
    middle = (len(a) + 1) / 2
    covariance = sum((x - middle) * (y - middle) for x, y in zip(a, b))
    spread = [sum((x - middle) ** 2 for x in values) for values in (a, b)]
    return covariance / (spread[0] * spread[1]) ** 0.5


def table(head: list[str], rows: list[list[str]]) -> str:
    """Returns a Markdown table whose first column is text."""
    lines = [head, ["---"] + ["--:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def pressure() -> str:
    """Shares of scenarios in which log replay collides with the AV, or is risky."""
    rows = [["paper", "2636", f"{PRESSURE[0]:.1f}", "", f"{PRESSURE[1]:.1f}"]]
    for reference in ("reactsim-bench-v2", "reactsim-bench-v2-full", "womd-val"):
        replay = simulators(reference)["log-replay"]
        found = replay["pressure"]
        shares = ("share_at_fault_collision", "share_any_overlap", "share_risky")
        values = [f"{100 * found[share]:.1f}" for share in shares]
        rows.append([f"`{reference}`", str(replay["scenarios"]), *values])
    return table(
        ["", "scenarios", "collision (%)", "overlap, at fault or not (%)", "risky (%)"], rows
    )


def systems() -> str:
    """The six systems: paper and here, absolute and relative to log replay."""
    rows = []
    replay = ("Log Replay", ("token-networks", "log-replay"))
    for name, (reference, simulator) in [*SYSTEMS.items(), replay]:
        row = [f"{name} (`{simulator}`)" if name in SYSTEMS else name]
        row += [f"{PAPER[name][0]:.3f}", f"{PAPER[name][0] / PAPER['Log Replay'][0]:.2f}"]
        for here in (reference, "womd-val"):
            row += [interval(here, simulator, COLLISION), f"{relative(here, simulator, COLLISION):.2f}"]
        row.append(f"{PAPER[name][1] / PAPER['Log Replay'][1]:.2f}")
        row += [f"{relative(here, simulator, RISKY):.2f}" for here in (reference, "womd-val")]
        rows.append(row)
    head = ["", "A-AV, paper", "relative", "A-AV, generated", "relative", "A-AV, womd-val", "relative"]
    head += ["risky, relative, paper", "generated", "womd-val"]
    return table(head, rows)


def correlation() -> str:
    """Rank correlation of the six systems between the paper and here."""
    rows = []
    for k, (text, metric) in enumerate((("A-AV Coll.", COLLISION), ("A-AV risky", RISKY))):
        paper = {name: PAPER[name][k] for name in SYSTEMS}
        row = [text, ", ".join(sorted(paper, key=paper.get))]
        for recordings in (False, True):
            here = {
                name: relative("womd-val" if recordings else reference, simulator, metric)
                for name, (reference, simulator) in SYSTEMS.items()
            }
            correlated = spearman([*paper.values()], [*here.values()])
            row += [", ".join(sorted(here, key=here.get)), f"{correlated:.2f}"]
        rows.append(row)
    head = ["relative to log replay", "order, paper", "order, generated", "rank correlation"]
    return table([*head, "order, womd-val", "rank correlation"], rows)


def protocols() -> str:
    """Collisions in both protocols, and realism."""
    rows = []
    for name, (reactive, realism, ade, likelihood) in PROTOCOLS.items():
        row = [f"{name}, paper", f"{reactive:.3f}", f"{realism:.3f}", f"{reactive / realism:.0f}"]
        rows.append([*row, f"{ade:.2f}", f"{likelihood:.3f}"])
    for simulator in ("regression", "ntp-reactive-raw", "ntp-reactive", "idm"):
        reactive = mean("realism/reactive", simulator, COLLISION)
        realism = mean("realism/realism", simulator, COLLISION)
        row = [f"`{simulator}`", f"{reactive:.3f}", f"{realism:.4f}", f"{reactive / realism:.0f}"]
        ade = mean("realism/realism", simulator, "ade")
        likelihood = mean("realism/realism", simulator, "kinematic-likelihood")
        rows.append([*row, f"{ade:.2f}", f"{likelihood:.3f}"])
    head = ["", "A-AV, reactive", "A-AV, realism", "factor", "ADE (m), realism"]
    return table([*head, "kinematic likelihood, realism"], rows)


def motion() -> str:
    """Infeasible accelerations and curvatures of the six systems."""
    rows = []
    for name, (reference, simulator) in SYSTEMS.items():
        row = [f"{name} (`{simulator}`)"]
        for k, metric in ((2, "acceleration"), (3, "curvature")):
            row += [f"{PAPER[name][k]:.2f}", f"{100 * mean(reference, simulator, metric):.2f}"]
        rows.append(row)
    head = ["", "Acc. (%), paper", "Acc. (%), here", "Steer. (%), paper", "Steer. (%), here"]
    return table(head, rows)


TABLES = (pressure, systems, correlation, protocols, motion)


def main() -> int:
    """Writes or checks the page."""
    text = PAGE.read_text()
    new = text
    for made in TABLES:
        name = made.__name__
        pattern = re.compile(rf"(<!-- paper {name} -->\n).*?(<!-- /paper -->)", re.DOTALL)
        if len(pattern.findall(new)) != 1:
            print(f"{PAGE}: there is no place for the table `{name}`", file=sys.stderr)
            return 2
        new = pattern.sub(lambda found, made=made: found[1] + made() + "\n" + found[2], new)
    if "--check" in sys.argv[1:]:
        if new != text:
            print(f"{PAGE} is out of date: run `python3 benches/paper.py`", file=sys.stderr)
            return 1
        return 0
    PAGE.write_text(new)
    return 0


if __name__ == "__main__":
    sys.exit(main())

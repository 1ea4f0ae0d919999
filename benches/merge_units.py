"""Measures `reactsim shard merge` on very many scenarios: time, and the most memory.

The units of a finished plan with one input are repeated under new records and scenario ids until there are as many records
as wanted. Needs the Python package blake3.

    reactsim shard plan units run logs.parquet --models idm --av log --out runs/one
    reactsim shard run units --missing
    python3 benches/merge_units.py PROGRAM units 1000000 FOLDER
"""

import json
import os
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

from blake3 import blake3


def main() -> None:
    """Makes the plan with many records, merges it, and prints the measurements."""
    program, units, wanted, folder = sys.argv[1], Path(sys.argv[2]), int(sys.argv[3]), Path(sys.argv[4])
    plan = json.loads((units / "plan.json").read_text())
    subject = json.dumps(plan["subject"], separators=(",", ":"), ensure_ascii=False)
    per_unit = plan["units"][0]["count"]
    whole = [n for n, unit in enumerate(plan["units"]) if unit["count"] == per_unit]
    repeated = []
    shards, out = folder / "units", folder / "merged"
    shards.mkdir(parents=True)
    for number in range(-(-wanted // per_unit)):
        source = plan["units"][whole[number % len(whole)]]
        unit = {"input": 0, "first": number * per_unit, "count": per_unit}
        text = f"{subject}\n0 0 {unit['first']} {per_unit}\n"
        key = blake3(text.encode()).hexdigest()
        repeated.append({"key": key, **unit})
        write(units, whole[number % len(whole)], source, shards, number, repeated[-1])
    plan["units"] = repeated
    plan["arguments"][plan["arguments"].index("--out") + 1] = str(out)
    (shards / "plan.json").write_text(json.dumps(plan, ensure_ascii=False))
    begin = time.monotonic()
    # One core, as far as the system has such a thing.
    pin = (lambda: os.sched_setaffinity(0, {0})) if hasattr(os, "sched_setaffinity") else None
    subprocess.run([program, "shard", "merge", str(shards), "-q"], check=True, stdout=subprocess.DEVNULL, preexec_fn=pin)
    seconds = time.monotonic() - begin
    most = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024
    records = len(repeated) * per_unit
    print(f"{records} records in {len(repeated)} units: {seconds:.0f} s, {most / 1e9:.2f} GB of memory at most")


def write(units: Path, old: int, source: dict, shards: Path, number: int, unit: dict) -> None:
    """Writes the results of a unit under other records and ids."""
    from_folder = units / f"unit-{old:06}-{source['key'][:16]}"
    to_folder = shards / f"unit-{number:06}-{unit['key'][:16]}"
    (to_folder / "results").mkdir(parents=True)
    record = json.loads((from_folder / "unit.json").read_text())
    shift = unit["first"] - source["first"]
    head = re.compile(r'^\{"input":0,"record":(\d+),"scenario":"')
    for name in record["files"]:
        lines = []
        for line in (from_folder / "results" / name).read_text().splitlines(keepends=True):
            found = head.match(line)
            if found is None:  # no record, such as the scenarios that were left out
                lines.append(line)
                continue
            new = f'{{"input":0,"record":{int(found[1]) + shift},"scenario":"{number}-'
            lines.append(new + line[found.end() :])
        content = "".join(lines).encode()
        (to_folder / "results" / name).write_bytes(content)
        record["files"][name] = blake3(content).hexdigest()
    record["key"] = unit["key"]
    (to_folder / "unit.json").write_text(json.dumps(record) + "\n")


if __name__ == "__main__":
    main()

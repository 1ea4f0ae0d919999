"""A simulator or planner for tests, of the standard library only: constant velocity, with one fault on request.

child.py [FAULT MESSAGE [COUNT [CONDITION]]]

FAULT happens at the COUNT-th message of type MESSAGE (from 0; `any` for every one). CONDITION is `seed:N`, only in batches
with this seed, `once:FILE`, only if FILE does not exist; it is then made, or `after:N`, after the first N episodes, unless a
file `after` is next to this one.
"""

import json
import math
import os
import signal
import struct
import subprocess
import sys
import time

SIZES = {"F64": 8, "F32": 4, "I64": 8, "U64": 8, "I32": 4, "U8": 1}
CODES = {"F64": "d", "F32": "f", "I64": "q", "U64": "Q", "I32": "i", "U8": "B"}
out = sys.stdout.buffer


def read_exactly(n):
    data = sys.stdin.buffer.read(n)
    if len(data) < n:
        sys.exit(0)
    return data


def read_frame():
    (length,) = struct.unpack("<Q", read_exactly(8))
    data = read_exactly(length)
    (n,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + n])
    texts = header.pop("__metadata__", {})
    tensors = {}
    for name, about in header.items():
        begin, end = about["data_offsets"]
        raw = data[8 + n + begin : 8 + n + end]
        count = len(raw) // SIZES[about["dtype"]]
        tensors[name] = (about["shape"], struct.unpack("<%d%s" % (count, CODES[about["dtype"]]), raw))
    return texts, tensors


def document(texts, tensors):
    header, data = {"__metadata__": texts}, b""
    for name, (dtype, shape, values) in tensors.items():
        raw = struct.pack("<%d%s" % (len(values), CODES[dtype]), *values)
        header[name] = {"dtype": dtype, "shape": shape, "data_offsets": [len(data), len(data) + len(raw)]}
        data += raw
    head = json.dumps(header).encode()
    head += b" " * (-len(head) % 8)
    return struct.pack("<Q", len(head)) + head + data


def send(content):
    out.write(struct.pack("<Q", len(content)) + content)
    out.flush()


def plan(texts, tensors, last):
    """Constant velocity with the operations of the baseline, in their order."""
    b, n, t, _ = tensors["states"][0]
    steps = int(texts["steps"])
    states = tensors["states"][1]
    if t:
        for i in range(b * n):
            last[i] = states[(i * t + t - 1) * 5 : (i * t + t) * 5]
    if "role" in texts:
        # A planner: the AV, slot 0, over two seconds, at least over the steps until the next plan.
        poses = max(steps, 20)
        return {"trajectory": ["F64", [1, poses, 3], constant_velocity(last[:1], poses)]}
    return {"states": ["F64", [b, n, steps, 3], constant_velocity(last, steps)]}


def constant_velocity(states, steps):
    planned = []
    for x, y, heading, vx, vy in states:
        known = abs(vx) < 1e300 and abs(vy) < 1e300
        vx, vy = (vx, vy) if known else (0.0, 0.0)
        for k in range(steps):
            time_ahead = 0.1 * (k + 1)
            planned += [x + vx * time_ahead, y + vy * time_ahead, heading]
    return planned


def mistaken(kind, tensors):
    """Changes a plan as an ordinary mistake in a simulator would."""
    _, (b, n, steps, _), values = tensors["states"]
    agents = [[values[(i * steps + k) * 3 : (i * steps + k + 1) * 3] for k in range(steps)] for i in range(b * n)]
    if kind == "order":
        agents = [agents[e * n + n - 1 - i] for e in range(b) for i in range(n)]
    changed = []
    for plan in agents:
        (x0, y0, _), (x1, y1, _) = plan[:2]
        dx, dy = x1 - x0, y1 - y0
        for k, (x, y, heading) in enumerate(plan):
            if kind == "degrees":
                # What comes back is not converted again.
                heading = math.degrees(heading) if abs(heading) <= math.tau else heading
            elif kind == "clockwise":
                heading = -heading
            elif kind == "swapped":
                x, y = y, x
            elif kind == "teleport":
                x += 30 if k >= 2 else 0
            elif kind == "local":
                x, y = x - x0 + dx, y - y0 + dy
            elif kind == "feet":
                # What comes back is not converted again and again.
                scale = 3.281 if max(abs(x), abs(y)) < 1000 else 1
                x, y = scale * x, scale * y
            elif kind == "lag":
                x, y = x - dx, y - dy
            elif kind == "stale":
                x, y = x - 10 * dx, y - 10 * dy
            elif kind == "freeze":
                x, y = x0 - dx, y0 - dy
            elif kind == "rear":
                x, y = x - 1.4 * math.cos(heading), y - 1.4 * math.sin(heading)
            changed += [x, y, heading]
    tensors["states"][2] = changed


def fault(kind, answer, seq, texts, tensors):
    """Does something wrong in place of an answer. Returns whether the answer is still to be sent."""
    whole = document(texts, tensors)
    name = "trajectory" if "trajectory" in tensors else "states"
    if kind.startswith("exit"):
        os._exit(int(kind[4:]))
    elif kind.startswith("mistake-"):
        mistaken(kind[8:], tensors)
        return True
    elif kind == "kill":
        os.kill(os.getpid(), signal.SIGKILL)
    elif kind == "raise":
        raise ValueError("the child fails on purpose")
    elif kind == "hang":
        time.sleep(600)
    elif kind == "stop":
        os.kill(os.getpid(), signal.SIGSTOP)
    elif kind == "ignore-signals":
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, signal.SIG_IGN)
        time.sleep(600)
    elif kind == "close-stdout":
        os.close(1)
        time.sleep(600)
    elif kind == "close-stdin":
        os.close(0)
        time.sleep(600)
    elif kind == "close-both":
        os.close(0)
        os.close(1)
        time.sleep(600)
    elif kind == "print":
        out.write(b"Loading weights ...\n")
        out.flush()
        return True
    elif kind == "garbage":
        out.write(bytes((i * 37 + 11) % 251 for i in range(4096)))
        out.flush()
        time.sleep(600)
    elif kind == "zeros":
        out.write(bytes(4096))
        out.flush()
        time.sleep(600)
    elif kind.startswith("cut") and kind != "cut-and-hang":
        frame = struct.pack("<Q", len(whole)) + whole
        out.write(frame[: len(frame) * int(kind[3:]) // 100])
        out.flush()
        os._exit(0)
    elif kind == "cut-and-hang":
        out.write(struct.pack("<Q", len(whole)) + whole[: len(whole) // 2])
        out.flush()
        time.sleep(600)
    elif kind == "huge":
        out.write(struct.pack("<Q", 1 << 60))
        out.flush()
        time.sleep(600)
    elif kind == "large":
        send(document({**texts, "more": "x" * (64 << 20)}, tensors))
    elif kind == "empty":
        send(b"")
    elif kind == "no-metadata":
        send(document({}, tensors))
    elif kind == "version":
        send(document({**texts, "protocol": "2"}, tensors))
    elif kind == "type":
        send(document({**texts, "type": "pong"}, tensors))
    elif kind == "sequence":
        send(document({**texts, "seq": "999"}, tensors))
    elif kind == "no-sequence":
        send(document({k: v for k, v in texts.items() if k != "seq"}, tensors))
    elif kind == "twice":
        send(whole)
        return True
    elif kind == "flood":
        while True:
            send(whole)
    elif kind == "header":
        send(struct.pack("<Q", 1 << 40) + whole[8:])
    elif kind == "not-json":
        send(struct.pack("<Q", 16) + b"{" * 16)
    elif kind == "failed":
        send(document({"type": "failed", "protocol": "1", "seq": seq, "error": "not today"}, {}))
    elif kind == "failed-silently":
        send(document({"type": "failed", "protocol": "1", "seq": seq}, {}))
    elif kind == "failed-loudly":
        text = "\x1b[2J\x1b]0;title\x07\r\nwarning: all is well\u202e | <b>" + "z" * 300_000
        send(document({"type": "failed", "protocol": "1", "seq": seq, "error": text}, {}))
    elif kind == "missing":
        send(document(texts, {}))
    elif kind == "shape":
        dtype, shape, values = tensors[name]
        send(document(texts, {name: [dtype, [len(values)], values]}))
    elif kind == "short":
        dtype, shape, values = tensors[name]
        n = shape[1] * shape[2] * shape[3]
        send(document(texts, {name: [dtype, [shape[0] - 1] + shape[1:], values[n:]]}))
    elif kind == "dtype":
        dtype, shape, values = tensors[name]
        send(document(texts, {name: ["I32", shape, [0] * len(values)]}))
    elif kind in ("nan", "inf", "-inf", "1e9"):
        dtype, shape, values = tensors[name]
        send(document(texts, {name: [dtype, shape, [float(kind)] * len(values)]}))
    elif kind == "one-pose":
        send(document(texts, {name: ["F64", [1, 1, 3], tensors[name][2][:3]]}))
    elif kind == "present":
        send(document(texts, {**tensors, "present": ["F64", [1, 3], [math.nan] * 3]}))
    elif kind == "far":
        dtype, shape, values = tensors[name]
        send(document(texts, {name: [dtype, shape, [value + 40.0 for value in values]]}))
    elif kind == "errors":
        send(document({**texts, "errors": json.dumps({"0": "not this one"})}, tensors))
    elif kind == "errors-wrong":
        send(document({**texts, "errors": "[1, 2]"}, tensors))
    elif kind == "errors-far":
        send(document({**texts, "errors": json.dumps({"99": "who?"})}, tensors))
    elif kind == "stderr":
        for _ in range(200):
            sys.stderr.write("x" * 100_000)
        sys.stderr.write("\nthe last line\n")
        sys.stderr.flush()
        return True
    elif kind == "stderr-and-exit":
        sys.stderr.write("CUDA error: out of memory\n")
        sys.stderr.flush()
        os._exit(1)
    elif kind == "grandchild":
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)  # " + sys.argv[0]])
        os._exit(0)
    elif kind == "slow":
        time.sleep(0.05)
        return True
    elif kind == "name":
        send(document({**texts, "name": ""}, tensors))
    elif kind == "digest":
        send(document({**texts, "weights_sha256": "abc"}, tensors))
    elif kind == "intervals":
        send(document({**texts, "intervals": "[0]"}, tensors))
    elif kind == "batch":
        send(document({**texts, "batch": "0"}, tensors))
    else:
        raise SystemExit("no fault " + kind)
    return False


def is_due(condition, seeds):
    kind, _, value = condition.partition(":")
    if kind == "after":
        folder = os.path.dirname(os.path.abspath(sys.argv[0]))
        if os.path.exists(os.path.join(folder, "after")):
            return False
        # Every process notes the seeds of the episodes that it began.
        path = os.path.join(folder, "begun-" + sys.argv[1])
        before = open(path).read().split() if os.path.exists(path) else []
        with open(path, "w") as file:
            file.write(" ".join(before + [str(s) for s in seeds if str(s) not in before]))
        first = (before + [str(s) for s in seeds if str(s) not in before])[: int(value)]
        return not all(str(s) in first for s in seeds)
    if kind == "seed":
        return int(value) in seeds
    if kind == "once":
        if os.path.exists(value):
            return False
        open(value, "w").close()
    return True


def main():
    wrong, when, count, condition = (sys.argv[1:] + ["", "", "0", ""][len(sys.argv) - 1 :])[:4]
    answers = {"hello": "welcome", "begin": "begun", "plan": "planned", "end": "ended"}
    counts, role, seeds_of, last_of = {}, "simulator", {}, {}
    while True:
        texts, tensors = read_frame()
        kind = texts["type"]
        # A planner has many open episodes, a simulator one open batch.
        key = tensors["episode"][1] if "episode" in tensors else ()
        if kind == "bye":
            if wrong == "ignore-bye":
                time.sleep(600)
            return
        if kind == "begin":
            seeds_of[key] = tensors["seed"][1]
            b, n, t, _ = tensors["history"][0]
            history = tensors["history"][1]
            last_of[key] = [history[(i * t + t - 1) * 5 : (i * t + t) * 5] for i in range(b * n)]
            counts["plan", key] = 0
        reply = {"type": answers[kind], "protocol": "1", "seq": texts["seq"]}
        if kind == "hello":
            role = texts["role"]
            reply.update(name="child", version="1", batch="4", role=role)
        if role == "planner":
            texts["role"] = role
        numbers = plan(texts, tensors, last_of[key]) if kind == "plan" else {}
        count_of = (kind, key) if kind == "plan" else kind
        number = counts.get(count_of, 0)
        counts[count_of] = number + 1
        is_fault = wrong and kind == when and (count == "any" or number == int(count))
        if is_fault and (not condition or is_due(condition, seeds_of.get(key, ()))):
            if not fault(wrong, kind, texts["seq"], reply, numbers):
                continue
        send(document(reply, numbers))


main()

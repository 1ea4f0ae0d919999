"""A stand-in for `reactsim.store`: files below the folder FAKE_ROOT, by URLs `fake://folder/file`.

FAKE_FAULT is a fault and, after a colon, the number of the request from which on it happens. Every
request is a line of the file FAKE_LOG.
"""

import os
import sys
import time

root = os.environ["FAKE_ROOT"]
fault, _, first = os.environ.get("FAKE_FAULT", "").partition(":")
first = int(first or 0)
out = sys.stdout.buffer


def send(text, kind, content):
    out.write(b"%s\t%s\t%d\n" % (text, kind, len(content)) + content)
    out.flush()


def describe(path):
    return b"%d\tversion %d" % (os.path.getsize(path), os.stat(path).st_mtime_ns)


def main():
    if fault == "silent":
        time.sleep(60)
    if fault == "no-package":
        sys.exit("No module named reactsim")
    out.write(b"hello\n" if fault == "greeting" else b"reactsim-store 1\n")
    out.flush()
    held = []
    for number, line in enumerate(sys.stdin.buffer):
        request, verb, url, *more = line.rstrip(b"\n").split(b"\t")
        with open(os.environ["FAKE_LOG"], "ab") as log:
            log.write(line)
        path = os.path.join(root, url.decode().partition("://")[2])
        is_due = fault and number >= first
        if is_due and fault == "die":
            print("out of memory", file=sys.stderr, flush=True)
            os._exit(7)
        if is_due and fault == "garbage":
            out.write(b"<html>500</html>\n\x00\xff")
            out.flush()
            continue
        if is_due and fault == "cut":
            out.write(b"%s\tok\t1000000\nabc" % request)
            out.flush()
            os._exit(0)
        if is_due and fault == "stall":
            continue
        if b"denied" in url:
            send(request, b"forbidden", b"no permission for you; ask")
        elif not os.path.exists(path):
            send(request, b"missing", b"there is no such file; check the URL")
        elif verb == b"list" and os.path.isdir(path):
            found = []
            for folder, _, names in os.walk(path):
                for name in names:
                    file = os.path.join(folder, name)
                    found.append(b"%s\t%s\n" % (describe(file), os.path.relpath(file, path).encode()))
            send(request, b"ok", b"".join(reversed(found)))
        elif verb == b"list":
            send(request, b"ok", describe(path) + b"\t\n")
        elif verb == b"info":
            send(request, b"ok", describe(path))
        else:
            offset, length, size, version = int(more[0]), int(more[1]), more[2], more[3]
            with open(path, "rb") as file:
                file.seek(offset)
                content = file.read(length)
            if is_due and fault == "short":
                content = content[: len(content) // 2]
            if size and size + b"\t" + version != describe(path) or (is_due and fault == "changed"):
                send(request, b"changed", b"it was changed; start again")
            elif fault == "reordered" and not held:
                # The first block comes after an answer to another request, or after some time.
                held.append((request, content))
                time.sleep(0.2)
                send(request, b"ok", content)
            else:
                send(request, b"ok", content)


main()

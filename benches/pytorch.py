"""Compare the network of `ntp-reactive` with the same network in PyTorch.

    python benches/pytorch.py

needs the packages torch and safetensors. `cargo bench --bench pytorch` computes a step of the shipped
scenario with the most agents: the newest half second, with the map and earlier steps cached. It writes
the input, the logits and its steps per second. This script computes the same from the same weights,
refuses logits that differ, and prints a table. Both are measured on one thread and on two: here
PyTorch divides a step among threads, there each thread has its own steps; a second row has two
processes of PyTorch with one thread each.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch.nn.functional import layer_norm, linear

# Largest difference of logits.
TOLERANCE = 1e-3
STEPS = 20
ROUNDS = 15


class Step:
    """A step with its weights and input."""

    def __init__(self, path):
        document = json.loads(Path(path).read_text())
        self.rates = document["steps_per_second"]
        self.expected = document["logits"]
        self.heads = document["heads"]
        self.weights = load_file(document["weights"])
        shaped = {k: torch.tensor(v["values"]).reshape(v["shape"]) for k, v in document["input"].items()}
        self.bodies = shaped["bodies"]
        self.blocks = sum(name.startswith("map.") for name in shaped)
        self.map = [shaped[f"map.{i}"] for i in range(self.blocks)]
        self.earlier = [shaped[f"earlier.{i}"] for i in range(self.blocks)]
        self.links = {}
        for name in ("past", "places", "agents"):
            is_open = shaped[f"{name}.open"]
            self.links[name] = (
                shaped[f"{name}.sources"].long(),
                torch.where(is_open > 0, 0.0, -1e9),
                shaped[f"{name}.relations"],
                (is_open.sum(1, keepdim=True) > 0).float(),
            )
        classes = torch.tensor(document["classes"])
        self.rows = {c: (classes == c).nonzero()[:, 0] for c in sorted(set(document["classes"]))}

    def linear(self, name, x):
        return linear(x, self.weights[f"{name}.weight"], self.weights.get(f"{name}.bias"))

    def norm(self, name, x):
        return layer_norm(x, x.shape[-1:], self.weights[f"{name}.weight"], self.weights[f"{name}.bias"])

    def perceptron(self, name, x):
        hidden = self.norm(f"{name}.mlp.1", self.linear(f"{name}.mlp.0", x)).relu()
        return self.linear(f"{name}.mlp.3", hidden)

    def attend(self, name, x, sources, kind, relations):
        """Attention to the sources of a kind of links; `sources` are normed already."""
        index, closed, _, some = self.links[kind]
        n, k = index.shape
        own_norm = f"{name}.attn_prenorm_x_dst"
        own = self.norm(own_norm if f"{own_norm}.weight" in self.weights else f"{name}.attn_prenorm_x_src", x)

        def split(rows):
            return rows.reshape(*rows.shape[:-1], self.heads, -1)

        query = split(self.linear(f"{name}.to_q", own))
        # Keys and values are projected once per source, and gathered.
        key = split(self.linear(f"{name}.to_k", sources))[index] + split(self.linear(f"{name}.to_k_r", relations))
        value = split(self.linear(f"{name}.to_v", sources))[index] + split(self.linear(f"{name}.to_v_r", relations))
        scores = torch.einsum("nhd,nkhd->nhk", query, key) * query.shape[-1] ** -0.5
        weights = (scores + closed[:, None, :]).softmax(2)
        message = torch.einsum("nhk,nkhd->nhd", weights, value).reshape(n, -1) * some
        gate = self.linear(f"{name}.to_g", torch.cat([message, own], 1)).sigmoid()
        mixed = message + gate * (self.linear(f"{name}.to_s", own) - message)
        x = x + self.norm(f"{name}.attn_postnorm", self.linear(f"{name}.to_out", mixed))
        hidden = self.linear(f"{name}.ff_mlp.0", self.norm(f"{name}.ff_prenorm", x)).relu()
        return x + self.norm(f"{name}.ff_postnorm", self.linear(f"{name}.ff_mlp.3", hidden))

    def logits(self):
        relations = {}
        for kind, layer in (("past", "past"), ("places", "to_place"), ("agents", "pair")):
            index, _, features, _ = self.links[kind]
            relations[kind] = self.linear(layer, features).relu().reshape(*index.shape, -1)
        x = self.perceptron("body", self.bodies)
        for i in range(self.blocks):
            block = f"blocks.{i}"
            x = self.attend(f"{block}.past", x, self.earlier[i], "past", relations["past"])
            x = self.attend(f"{block}.places", x, self.map[i], "places", relations["places"])
            others = self.norm(f"{block}.agents.attn_prenorm_x_src", x)
            x = self.attend(f"{block}.agents", x, others, "agents", relations["agents"])
        return {c: self.perceptron(f"heads.{c}", x[rows]) for c, rows in self.rows.items()}

    def difference(self):
        """The largest difference of logits from the expected ones."""
        found = self.logits()
        return max(
            (row - torch.tensor(self.expected[agent])).abs().max().item()
            for c, rows in self.rows.items()
            for agent, row in zip(rows.tolist(), found[c])
        )


@torch.inference_mode()
def rate(path, threads):
    """Steps per second of the fastest round."""
    torch.set_num_threads(threads)
    step = Step(path)
    best = 0.0
    for _ in range(ROUNDS):
        start = time.perf_counter()
        for _ in range(STEPS):
            step.logits()
        best = max(best, STEPS / (time.perf_counter() - start))
    return best


def main():
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter).parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder, "step.json"))
        root = Path(__file__).resolve().parent.parent
        subprocess.run(["cargo", "bench", "--locked", "--bench", "pytorch", "--", path], cwd=root, check=True)
        step = Step(path)
        with torch.inference_mode():
            difference = step.difference()
        if not difference < TOLERANCE:
            sys.exit(f"the logits differ by {difference:.2g}: the two networks are not the same")
        rows = [("PyTorch", 1, rate(path, 1)), ("PyTorch", 2, rate(path, 2))]
        with ProcessPoolExecutor(2) as pool:
            rows.append(("PyTorch, two processes", 2, sum(pool.map(rate, [path] * 2, [1] * 2))))
    print(f"{len(step.expected)} agents; logits differ by at most {difference:.1g}; PyTorch {torch.__version__}\n")
    print("| | threads | steps per second | reactsim / PyTorch |\n|---|--:|--:|--:|")
    for threads, own in step.rates.items():
        print(f"| reactsim | {threads} | {own:.0f} | |")
    for name, threads, found in rows:
        print(f"| {name} | {threads} | {found:.0f} | {step.rates[str(threads)] / found:.1f} |")


if __name__ == "__main__":
    main()

"""The example `smart_catk.py` against golden data of the published network.

Needs torch, torch_geometric, omegaconf, scipy and safetensors, and the folder of a checkout of
github.com/NVlabs/catk in the environment variable `SMART_CHECKOUT`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pytest
from fakes import ROOT, Loopback, make_scenes, roll_out

for package in ("torch", "torch_geometric", "omegaconf", "scipy", "safetensors"):
    pytest.importorskip(package)

import smart_catk
import torch
from safetensors.torch import load_file, save_file

GOLDEN = ROOT.parent / "shared" / "data" / "smart_golden" / "A_nano"
SCENES = ["1f27be97d892e8ac", "776b950752587100", "7a17b9e1b2ba281e"]


def test_neighbours() -> None:
    generator = torch.Generator().manual_seed(0)
    x, y = (torch.rand((n, 2), generator=generator) * 10.0 for n in (60, 30))
    batch_x, batch_y = torch.arange(60) % 3, torch.arange(30) % 3
    pairs = smart_catk.radius(x, y, 3.0, batch_x=batch_x, batch_y=batch_y, max_num_neighbors=4)
    expected = []
    for i in range(30):
        near = [
            (i, j)
            for j in range(60)
            if batch_x[j] == batch_y[i] and torch.linalg.vector_norm(x[j] - y[i]) < 3.0
        ]
        expected += near[:4]
    assert sorted(map(tuple, pairs.T.tolist())) == expected
    edges = smart_catk.radius_graph(x, 1.0, max_num_neighbors=60)
    assert not (edges[0] == edges[1]).any()
    assert len(edges.T) > 0
    assert len(smart_catk.radius_graph(x, 1.0, loop=True, max_num_neighbors=60).T) == 60 + len(
        edges.T
    )


@pytest.fixture(scope="module")
def network(checkout: Path) -> Any:
    """The network with the golden weights."""
    if not GOLDEN.is_dir():
        pytest.skip("there is no golden data")
    return smart_catk.Network(checkout, GOLDEN / "weights.safetensors", GOLDEN / "config.json")


def golden_map(network: Any, golden: Dict[str, Any]) -> Dict[str, Any]:
    """Returns the tokenized map of a golden file."""
    return {
        "position": golden["in.map.position"],
        "orientation": golden["in.map.orientation"],
        "token_idx": golden["in.map.token_idx"].long(),
        "token_traj_src": network.tokenizer.map_token_traj_src,
        "type": golden["in.map.type"].long(),
        "pl_type": golden["in.map.polygon_type"].long(),
        "light_type": golden["in.map.light_type"].long(),
        "batch": torch.zeros(len(golden["in.map.type"]), dtype=torch.long),
    }


def steps_of(valid: Any, token: Any, position: Any, heading: Any) -> List[Any]:
    """Returns steps from tensors with a column per step."""
    columns = (valid.bool(), token.long(), position, heading)
    return [smart_catk.Step(*(c[:, t] for c in columns)) for t in range(heading.shape[1])]


@pytest.mark.parametrize("scene", SCENES)
def test_golden_scene(network: Any, scene: str) -> None:
    golden = load_file(GOLDEN / f"scene_{scene}.safetensors")
    tokenized_map = golden_map(network, golden)
    position = tokenized_map["position"]
    edges = smart_catk.radius_graph(position, 10.0, max_num_neighbors=100)
    assert torch.equal(edges, golden["edges.pl2pl"].long())
    with torch.no_grad():
        features = network.decoder.map_encoder(tokenized_map)
        last = max(name for name in golden if name.startswith("out.map.layer"))
        torch.testing.assert_close(features["pt_token"], golden[last], atol=1e-4, rtol=0.0)

        kinds, shapes = golden["in.agent.type"].long(), golden["in.agent.shape_lwh"]
        # Two scenes of a batch do not see each other.
        agents = smart_catk.Agents(network, [features] * 2, [kinds] * 2, [shapes] * 2)

        def twice(step: Any) -> Any:
            return smart_catk.Step(*(torch.cat([values, values]) for values in step))

        inputs = [golden[f"in.agent.{n}"] for n in ("valid", "token_idx", "position", "heading")]
        past: List[Any] = []
        for step in steps_of(*inputs):
            past.append(agents.encode(past, twice(step)))
        logits = torch.stack([agents.scores(step) for step in past], dim=1)[:, 1:-1]
        torch.testing.assert_close(*logits.chunk(2), atol=1e-4, rtol=0.0)
        logits, valid = logits[: len(kinds)], inputs[0].bool()[:, 1:-1]
        argmax = golden["out.logits_argmax"][:, 1:-1].long()
        assert torch.equal(logits.argmax(dim=-1)[valid], argmax[valid])
        expected = golden.get("out.logits_every8")
        expected = golden["out.logits"][..., ::8] if expected is None else expected
        torch.testing.assert_close(
            logits[..., ::8][valid], expected[:, 1:-1][valid], atol=1e-3, rtol=0.0
        )

        # The greedy rollout.
        tokens = golden["roll.token_idx"]
        reached = torch.cat([inputs[1][:, :2], tokens], dim=1)
        rolled = [golden[f"roll.{name}"] for name in ("valid", "pos_2hz", "head_2hz")]
        steps = [twice(step) for step in steps_of(rolled[0], reached, *rolled[1:])]
        past = [agents.encode([], steps[0])]
        for step, token in zip(steps[1:-1], tokens.T):
            past.append(agents.encode(past, step))
            chosen = agents.scores(past[-1]).argmax(dim=-1)
            assert torch.equal(chosen, torch.cat([token, token]).long())


def parked_scenes() -> Dict[str, Any]:
    """Returns scenes in which nobody moves during the history."""
    tensors = make_scenes()
    history = tensors["history"]
    history[:, :, :, :3] = history[:, :, -1:, :3]
    history[:, :, :, 3:] = 0.0
    history[tensors["valid"] == 0] = 0.0
    return tensors


def test_rollout(network: Any, checkout: Path, tmp_path: Path) -> None:
    # A Lightning checkpoint holds settings, and names have a prefix.
    import omegaconf

    weights = load_file(GOLDEN / "weights.safetensors")
    decoder = omegaconf.OmegaConf.load(GOLDEN / "config.json")
    stored = {
        "state_dict": {f"encoder.{name}": tensor for name, tensor in weights.items()},
        "hyper_parameters": {"model_config": omegaconf.OmegaConf.create({"decoder": decoder})},
    }
    path = tmp_path / "last.ckpt"
    torch.save(stored, path)
    simulator = smart_catk.SmartCatk(checkout, path, top_k=3)
    tensors = parked_scenes()
    plans = roll_out(Loopback(simulator), tensors, steps=10)
    assert [plan.shape for plan in plans] == [(3, 5, 10, 3)] * 8
    maps = list(simulator.maps)
    assert len(maps) == 3
    again = roll_out(Loopback(simulator), tensors, steps=10)
    assert all(np.array_equal(a, b) for a, b in zip(plans, again))
    assert list(simulator.maps) == maps  # maps are encoded once per scenario


def test_unusable_files(checkout: Path, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="no checkout"):
        smart_catk.use_checkout(tmp_path)
    path = tmp_path / "other.safetensors"
    save_file({"weight": torch.zeros(1)}, path)
    with pytest.raises(ValueError, match="holds no tensor"):
        smart_catk.Network(checkout, path)

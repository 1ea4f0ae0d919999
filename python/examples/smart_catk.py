"""The public SMART / CATK network in closed loop, run by its own code.

    python smart_catk.py CHECKOUT CHECKPOINT [options]
    reactsim run --external catk='python smart_catk.py CHECKOUT CHECKPOINT'

CHECKOUT is a folder with the code of github.com/NVlabs/catk. CHECKPOINT is a checkpoint of its
training, or a safetensors file with the tensors of the network. The script needs torch,
torch_geometric, omegaconf and scipy. Without torch_cluster, functions of this file find the
neighbours.

The checkout provides the classes of the network with its rollout loop, the tokenizer with both
vocabularies, and the division of the map into pieces. This file converts scenes to their input and
splits the loop: at every plan the loop runs only for the tokens of the plan, on a past that
consists of the executed motion. Differences from the published inference:

- The AV does not execute tokens in the reactive protocol. Its motion of the last half second is
  matched to the nearest vehicle token, and its true pose is used; likewise for all other agents.
- Tokens are executed from the true pose of an agent, not from the end of its last token in the
  history.
- The published code fills in zeros where an agent was not yet observed. Agents that were first
  observed less than a second ago are extrapolated backwards instead.
- The map is cropped around the AV and divided in 64-bit arithmetic. Boxes have no height in this
  benchmark and receive a default height.
- Agents of kind `other` have no tokens. They keep their pose, and the network does not observe
  them.

Plans must be multiples of half a second, the length of a token.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import importlib.util
import inspect
import json
import sys
import types
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import reactsim

try:
    import torch
    import torch_geometric  # noqa: F401 - before the stand-in for torch_cluster, which it would use
except ImportError as error:
    sys.exit(f"this example needs torch, torch_geometric, omegaconf and scipy: {error}")

TOKEN_FRAMES = 5  # frames of a token
MAX_POINT_GAP = 3.0  # metres; the checkout splits lines where points are farther apart
MAX_GAP_FRACTION = 0.1  # largest share of such gaps in the lanes of a densely sampled map
SPACING = 0.5  # metres between the points of resampled lines

# Codes of the checkout by those of the protocol.
LANE_TYPES = {0: 1, 1: 0, 2: 1, 3: 3}  # freeway 0, surface street 1, bike lane 3
STOP_SIGN_LANE = 2
EDGE_TYPES = {0: 4, 1: 4, 2: 5}  # boundary 4, median 5
PAINT_TYPES = {1: 6, 4: 6, 5: 6, 2: 7, 6: 7}  # broken 6, solid 7; all others double
DOUBLE_LINE = 8
CROSSING = 9
LIGHT_TYPES = {0: 1, 1: 2, 4: 2, 7: 2, 3: 3, 6: 3, 2: 4, 5: 4}  # unknown, stop, go, caution
LANE, ROAD_EDGE, ROAD_LINE, CROSSWALK = range(4)  # types of polygons


# --------------------------------------------------------------------------------------------------
# The checkout.


def radius(
    x: torch.Tensor,
    y: torch.Tensor,
    r: float,
    *,
    batch_x: torch.Tensor | None = None,
    batch_y: torch.Tensor | None = None,
    max_num_neighbors: int = 32,
    ignore_same_index: bool = False,
) -> torch.Tensor:
    """Returns index pairs [2, E] of an element of `y` and an element of `x` closer than `r`.

    The pairs are the same as from `torch_cluster.radius`: only within a batch, and at most
    `max_num_neighbors` for every element of `y`, lowest indices first.
    """
    batch_x = x.new_zeros(len(x), dtype=torch.long) if batch_x is None else batch_x
    batch_y = y.new_zeros(len(y), dtype=torch.long) if batch_y is None else batch_y
    found = [torch.empty((2, 0), dtype=torch.long, device=x.device)]
    for batch in torch.unique(batch_y).tolist():
        rows, columns = (torch.nonzero(b == batch)[:, 0] for b in (batch_y, batch_x))
        difference = x[columns][None] - y[rows][:, None]
        squares = difference[..., 0] * difference[..., 0] + difference[..., 1] * difference[..., 1]
        near = squares < r * r
        if ignore_same_index:
            near &= rows[:, None] != columns[None]
        near &= near.cumsum(dim=1) <= max_num_neighbors
        row, column = torch.nonzero(near, as_tuple=True)
        found.append(torch.stack([rows[row], columns[column]]))
    return torch.cat(found, dim=1)


def radius_graph(
    x: torch.Tensor,
    r: float,
    *,
    batch: torch.Tensor | None = None,
    loop: bool = False,
    max_num_neighbors: int = 32,
) -> torch.Tensor:
    """Returns edges [2, E] from neighbours closer than `r`, as `torch_cluster.radius_graph`."""
    pairs = radius(
        x,
        x,
        r,
        batch_x=batch,
        batch_y=batch,
        max_num_neighbors=max_num_neighbors,
        ignore_same_index=not loop,
    )
    return pairs.flip(0)


def use_checkout(folder: Path) -> None:
    """Makes the code of a checkout importable.

    If torch_cluster is not installed, functions of this file replace it.
    """
    if not (folder / "src" / "smart" / "modules" / "smart_decoder.py").is_file():
        raise FileNotFoundError(f"{folder} is no checkout of github.com/NVlabs/catk")
    if importlib.util.find_spec("torch_cluster") is None:
        stand_in = types.ModuleType("torch_cluster")
        stand_in.__spec__ = importlib.util.spec_from_loader("torch_cluster", None)
        vars(stand_in).update(radius=radius, radius_graph=radius_graph)
        sys.modules["torch_cluster"] = stand_in
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))


def read_checkpoint(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, Any]]:
    """Returns the tensors of the network, and the settings `model_config` or None.

    Nothing in the file is executed: pickles may contain tensors, containers and omegaconf settings.
    """
    settings: dict[str, Any] = {}
    if path.suffix == ".safetensors":
        from safetensors.torch import load_file

        state = load_file(path)
    else:
        import omegaconf
        from omegaconf.base import ContainerMetadata, Metadata
        from omegaconf.nodes import AnyNode

        settings_types = [omegaconf.DictConfig, omegaconf.ListConfig, ContainerMetadata, Metadata]
        builtin = [AnyNode, Any, defaultdict, dict, list, int]
        with torch.serialization.safe_globals([*settings_types, *builtin]):
            stored = torch.load(path, map_location="cpu", weights_only=True)
        state = stored.get("state_dict", stored)
        model = stored.get("hyper_parameters", {}).get("model_config", {})
        settings = omegaconf.OmegaConf.to_container(omegaconf.OmegaConf.create(model)) or {}
    mark = "map_encoder.type_pt_emb.weight"
    prefix = next((name[: -len(mark)] for name in state if name.endswith(mark)), None)
    if prefix is None:
        raise ValueError(f"{path} holds no tensor `{mark}`")
    parts = tuple(prefix + part for part in ("map_encoder.", "agent_encoder."))
    return {n[len(prefix) :]: t for n, t in state.items() if n.startswith(parts)}, settings


class Network:
    """The network and the tokenizer of a checkout."""

    def __init__(
        self, checkout: Path, checkpoint: Path, config: Path | None = None, device: str = "cpu"
    ) -> None:
        use_checkout(checkout)
        from src.smart.modules.smart_decoder import SMARTDecoder
        from src.smart.tokens.token_processor import TokenProcessor
        from src.smart.utils.preprocess import get_polylines_from_polygon, preprocess_map

        state, settings = read_checkpoint(checkpoint)
        if config is not None:
            settings = json.loads(config.read_text())
        decoder = settings.get("decoder", settings)
        accepted = set(inspect.signature(SMARTDecoder).parameters) - {"n_token_agent"}
        if missing := sorted(accepted - set(decoder)):
            text = f"the settings of the network lack {', '.join(missing)}; give them with --config"
            raise ValueError(text)
        tokens = settings.get("token_processor", {})
        self.device = device
        self.tokenizer = TokenProcessor(
            map_token_file=tokens.get("map_token_file", "map_traj_token5.pkl"),
            agent_token_file=tokens.get("agent_token_file", "agent_vocab_555_s2.pkl"),
            map_token_sampling=None,  # these two are for training
            agent_token_sampling=None,
        )
        self.decoder = SMARTDecoder(
            **{name: decoder[name] for name in accepted},
            n_token_agent=self.tokenizer.n_token_agent,
        )
        self.decoder.load_state_dict(state)
        for part in (self.tokenizer, self.decoder):
            part.eval().to(device)
        self.cut_map = preprocess_map
        self.sides_of_crossing = get_polylines_from_polygon
        self.poses = np.stack(
            [token_poses(getattr(self.tokenizer, f"agent_token_all_{k}")) for k in CLASSES]
        )
        """Poses of the tokens of each class at 0.1 to 0.5 s, f64 [3, tokens, 5, 3]."""

    def next_tokens(
        self, past: dict[str, Any], map_feature: dict[str, Any], count: int, sampling: Any
    ) -> torch.Tensor:
        """Returns the next `count` tokens of agents, [agents, count], from their past steps.

        This is the rollout loop of the checkout. It begins at the newest step of `past` and ends
        after `count` tokens.
        """
        agents, steps = past["valid_mask"].shape
        wider = dict(past, gt_z_raw=torch.zeros(agents, device=self.device))
        for name in ("valid_mask", "gt_idx", "gt_pos", "gt_heading"):
            rest = past[name].new_zeros((agents, count, *past[name].shape[2:]))
            wider[name] = torch.cat([past[name], rest], dim=1)
        # The loop reads the recorded future only in training; here it is unknown.
        wider["gt_pos_raw"] = torch.zeros_like(wider["gt_pos"])
        wider["gt_head_raw"] = torch.zeros_like(wider["gt_heading"])
        wider["gt_valid_raw"] = torch.zeros_like(wider["valid_mask"])
        loop = self.decoder.agent_encoder
        loop.num_historical_steps = TOKEN_FRAMES * steps + 1
        loop.num_future_steps = TOKEN_FRAMES * count
        found: torch.Tensor = loop.inference(wider, map_feature, sampling)["pred_idx"][:, steps:]
        return found


CLASSES = ("veh", "ped", "cyc")


def token_poses(contours: torch.Tensor) -> np.ndarray:
    """Returns x, y, heading after 0.1 to 0.5 s from contours [tokens, 6, 4, 2]."""
    corners = contours[:, 1:].double().cpu().numpy()
    ahead = corners[:, :, 0] - corners[:, :, 3]
    heading = np.arctan2(ahead[..., 1], ahead[..., 0])
    return np.concatenate([corners.mean(axis=2), heading[..., None]], axis=-1)


# --------------------------------------------------------------------------------------------------
# Scenes as input of the network.


def map_lines(scene: reactsim.Scene, sides_of_crossing: Any) -> list[tuple[np.ndarray, ...]]:
    """Returns the lines of a map: points, type of the points, type of the polygon, light."""
    has_sign = {line.lane for line in scene.stop_lines if line.category == 1}
    states: dict[int, int] = dict(
        zip(scene.lights.lane.tolist(), scene.lights.states[:, -1].tolist())
    )
    lines: list[Any] = []
    for lane in scene.lanes:
        kind = LANE_TYPES[lane.category]
        kind = STOP_SIGN_LANE if lane.index in has_sign and kind < STOP_SIGN_LANE else kind
        lines.append((lane.points, kind, LANE, LIGHT_TYPES.get(states.get(lane.index, -1), 0)))
    for edge in scene.road_edges:
        lines.append((edge.points, EDGE_TYPES[edge.category], ROAD_EDGE, 0))
    if not scene.road_edges:
        for area in scene.drivable_areas:
            for hole, ring in enumerate(area):
                closed = np.concatenate([ring, ring[:1]])
                lines.append((closed, EDGE_TYPES[2 if hole else 1], ROAD_EDGE, 0))
    for paint in scene.painted_lines:
        kind = PAINT_TYPES.get(paint.category, DOUBLE_LINE)
        lines.append((paint.points, kind, ROAD_LINE, 0))
    for crossing in [*scene.crosswalks, *scene.speed_bumps, *scene.driveways]:
        count = len(crossing.points)
        if count >= 4:
            corners = crossing.points[np.linspace(0, count, 4, endpoint=False, dtype=int)]
            line = sides_of_crossing(np.pad(corners, [(0, 0), (0, 1)]))[:, :2]
            lines.append((line, CROSSING, CROSSWALK, 0))
    return lines


def resampled(points: np.ndarray) -> np.ndarray:
    """Returns points of a line every half metre, and its last one."""
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    at = np.append(np.arange(0.0, arc[-1], SPACING), arc[-1])
    return np.stack([np.interp(at, arc, points[:, k]) for k in range(2)], axis=-1)


def is_sampled(lanes: list[reactsim.Lane]) -> bool:
    """Returns whether a map is sampled so densely that a wide gap separates two lines."""
    steps = [np.hypot(*np.diff(lane.points, axis=0).T) for lane in lanes]
    lengths = np.concatenate([*steps, np.zeros(0)])
    return bool(lengths[lengths > MAX_POINT_GAP].sum() <= MAX_GAP_FRACTION * lengths.sum())


def tokenize_map(network: Network, scene: reactsim.Scene, within: float) -> dict[str, Any]:
    """Returns the pieces of a map that begin within this distance of the AV, in metres."""
    is_dense = is_sampled(scene.lanes)
    points, point_types, line_types, lights = [], [], [], []
    for line, kind, polygon, light in map_lines(scene, network.sides_of_crossing):
        if len(line) < 2:
            continue
        dense = line if is_dense else resampled(line)
        is_new = np.append(True, np.any(np.diff(dense, axis=0) != 0.0, axis=1))
        points.append(torch.tensor(dense[is_new][:-1]))
        point_types.append(torch.full((len(points[-1]),), kind, dtype=torch.uint8))
        line_types.append(polygon)
        lights.append(light)
    counts = torch.tensor([len(line) for line in points], dtype=torch.long)
    owner = torch.arange(len(points)).repeat_interleave(counts)
    empty = [torch.zeros((0, 2), dtype=torch.float64)]
    data = network.cut_map(
        {
            "map_polygon": {
                "type": torch.tensor(line_types, dtype=torch.uint8),
                "light_type": torch.tensor(lights, dtype=torch.uint8),
            },
            "map_point": {
                "position": torch.cat([*empty, *points]),
                "type": torch.cat([torch.zeros(0, dtype=torch.uint8), *point_types]),
            },
            ("map_point", "to", "map_polygon"): {
                "edge_index": torch.stack([torch.arange(len(owner)), owner])
            },
        }
    )
    start = data["map_save"]["traj_pos"][:, 0].double() - torch.tensor(scene.history[0, -1, :2])
    near = torch.linalg.vector_norm(start, dim=-1) < within
    own = {
        "map_save": {k: data["map_save"][k][near] for k in ("traj_pos", "traj_theta")},
        "pt_token": {k: data["pt_token"][k][near] for k in ("type", "pl_type", "light_type")},
    }
    own["pt_token"]["batch"] = torch.zeros(int(near.sum()), dtype=torch.long)
    own = {part: {k: v.to(network.device) for k, v in own[part].items()} for part in own}
    tokenized: dict[str, Any] = network.tokenizer.tokenize_map(own)
    return tokenized


def without_gaps(states: np.ndarray, valid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns states [n, T, 5] with interpolated gaps and known velocities, and a presence mask."""
    states, present = states.copy(), valid.copy()
    for agent, known in enumerate(valid):
        at = np.flatnonzero(known)
        inside = np.arange(at[0], at[-1] + 1)
        own = states[agent, at]
        own[:, 2] = np.unwrap(own[:, 2])
        # A missing velocity is computed from the displacement to the next frame.
        moved = np.diff(own[:, :2], axis=0, append=own[-1:, :2]) / reactsim.DT
        own[:, 3:] = np.where(np.isfinite(own[:, 3:]), own[:, 3:], moved)
        for column in range(5):
            states[agent, inside, column] = np.interp(inside, at, own[:, column])
        present[agent, inside] = True
    return states, present


class Data(dict):  # type: ignore[type-arg]
    """A batch of one scene, as the tokenizer of the checkout reads it."""

    num_graphs = 1


class Episode:
    """One scene during its rollout: the encoded map, and the steps of the agents so far."""

    def __init__(
        self, network: Network, scene: reactsim.Scene, map_radius: float, height: float
    ) -> None:
        self.network = network
        kinds = scene.kinds.astype(np.int64)
        kinds[0] = reactsim.Kind.VEHICLE  # the AV counts as a vehicle
        self.slots = np.flatnonzero(kinds <= reactsim.Kind.CYCLIST)
        self.classes = kinds[self.slots]
        device = network.device
        with torch.no_grad():
            tokenized_map = tokenize_map(network, scene, map_radius)
            self.map_feature = network.decoder.map_encoder(tokenized_map)
            states, valid = without_gaps(scene.history[self.slots], scene.valid[self.slots])
            floats = torch.tensor(states, dtype=torch.float32, device=device)
            sizes = np.pad(scene.sizes[self.slots], [(0, 0), (0, 1)], constant_values=height)
            agent = {
                "type": torch.tensor(self.classes, dtype=torch.uint8, device=device),
                "valid_mask": torch.tensor(valid, device=device),
                "position": floats[..., :2],
                "heading": floats[..., 2].clone(),
                "velocity": floats[..., 3:],
                "shape": torch.tensor(sizes, dtype=torch.float32, device=device),
                "role": torch.zeros((len(self.slots), 3), dtype=torch.bool, device=device),
                "batch": torch.zeros(len(self.slots), dtype=torch.long, device=device),
            }
            agent["position"] = torch.nn.functional.pad(agent["position"], (0, 1))
            self.past: dict[str, Any] = network.tokenizer.tokenize_agent(Data(agent=agent))
        # Poses of agents that were first observed too late for a whole token.
        late = ~self.past["valid_mask"]
        self.past["gt_pos"][late] = self.past["gt_pos_raw"][late]
        self.past["gt_heading"][late] = self.past["gt_head_raw"][late]
        self.pose = states[:, -1, :3]
        """Pose of each agent at the newest step, f64 [agents, 3]."""
        self.pose[:, 2] = self.past["gt_head_raw"][:, -1].cpu().numpy()
        self.tokens: list[np.ndarray] = []
        """Tokens of each plan, [agents, tokens]."""

    def advance(self, states: np.ndarray, valid: np.ndarray) -> None:
        """Adds the step half a second later, at which the agents have these states, [agents, 5]."""
        ends = np.stack([self.pose, states[:, :3]], axis=1)
        ends = np.repeat(ends, [1, TOKEN_FRAMES], axis=1)  # only both ends are read
        device = self.network.device
        poses = torch.tensor(ends, dtype=torch.float32, device=device)
        present = torch.tensor(valid, device=device)[:, None].expand(-1, TOKEN_FRAMES + 1)
        matched = self.network.tokenizer._match_agent_token(
            valid=present,
            pos=poses[..., :2],
            heading=poses[..., 2],
            agent_shape=self.past["token_agent_shape"],
            token_traj=self.past["token_traj"],
        )
        newest = {
            "valid_mask": matched["valid_mask"],
            "gt_idx": matched["gt_idx"],
            "gt_pos": poses[:, -1:, :2],
            "gt_heading": poses[:, -1:, 2],
        }
        for name, step in newest.items():
            self.past[name] = torch.cat([self.past[name], step], dim=1)
        self.pose = states[:, :3].copy()

    def plan(self, count: int, sampling: Any) -> np.ndarray:
        """Returns poses of the next `count` tokens, [agents, 5 * count, 3]."""
        tokens = self.network.next_tokens(self.past, self.map_feature, count, sampling)
        self.tokens.append(tokens.cpu().numpy())
        pose, poses = self.pose, []
        for token in self.tokens[-1].T:
            motion = self.network.poses[self.classes, token]
            cos, sin = np.cos(pose[:, None, 2]), np.sin(pose[:, None, 2])
            moved = motion + pose[:, None]
            moved[..., 0] = pose[:, None, 0] + cos * motion[..., 0] - sin * motion[..., 1]
            moved[..., 1] = pose[:, None, 1] + sin * motion[..., 0] + cos * motion[..., 1]
            poses.append(moved)
            pose = moved[:, -1]
        return np.concatenate(poses, axis=1)


# --------------------------------------------------------------------------------------------------
# The simulator.


class SmartCatk(reactsim.Simulator):
    """Moves agents by tokens that the network of a checkout predicts."""

    name = "smart-catk"
    version = "1"
    intervals = tuple(range(TOKEN_FRAMES, 81, TOKEN_FRAMES))
    batch = 4

    def __init__(
        self,
        checkout: Path,
        checkpoint: Path,
        config: Path | None = None,
        *,
        top_k: int = 5,
        temperature: float = 1.0,
        map_radius: float = 150.0,
        height: float = 1.8,
        device: str = "cpu",
    ) -> None:
        self.weights_sha256 = hashlib.sha256(checkpoint.read_bytes()).hexdigest()
        self.network = Network(checkout, checkpoint, config, device)
        self.map_radius, self.height = map_radius, height
        self.sampling = types.SimpleNamespace(criterium="topk_prob", num_k=top_k, temp=temperature)
        self.episodes: list[Episode] = []

    def begin(self, scenes: reactsim.Scenes) -> None:
        self.episodes = [
            Episode(self.network, scene, self.map_radius, self.height) for scene in scenes
        ]

    def plan(self, seen: reactsim.Observation) -> np.ndarray:
        plan = np.repeat(seen.states[:, :, -1:, :3], seen.steps, axis=2)
        # Episodes run one at a time, so random numbers and last bits do not depend on the batch.
        for i in np.flatnonzero(seen.active).tolist():
            episode = self.episodes[i]
            first = seen.frame + 1 - seen.n_new
            with torch.no_grad(), torch.random.fork_rng():
                torch.manual_seed(int(seen.scenes.rng(i).integers(2**63)))
                for frame in range(max(first, 11) + TOKEN_FRAMES - 1, seen.frame + 1, TOKEN_FRAMES):
                    episode.advance(
                        seen.states[i, episode.slots, frame], seen.valid[i, episode.slots, frame]
                    )
                plan[i, episode.slots] = episode.plan(seen.steps // TOKEN_FRAMES, self.sampling)
        return plan

    def end(self, episodes: np.ndarray) -> None:
        self.episodes = []


def main() -> None:
    """Reads the command line and answers the program."""
    parser = argparse.ArgumentParser(description="The network of a CATK checkout in closed loop.")
    parser.add_argument("checkout", type=Path, help="folder of github.com/NVlabs/catk")
    parser.add_argument("checkpoint", type=Path, help="Lightning checkpoint or safetensors file")
    parser.add_argument(
        "--config", type=Path, help="JSON file with `decoder` [default: those of the checkpoint]"
    )
    parser.add_argument("--top-k", type=int, default=5, help="likeliest tokens to draw from")
    parser.add_argument("--temperature", type=float, default=1.0)
    parser.add_argument("--map-radius", type=float, default=150.0, help="metres around the AV")
    parser.add_argument("--height", type=float, default=1.8, help="height of all boxes, metres")
    parser.add_argument("--device", default="cpu", help="such as cuda")
    with contextlib.redirect_stdout(sys.stderr):
        options = vars(parser.parse_args())
    reactsim.serve(SmartCatk(**options))


if __name__ == "__main__":
    main()

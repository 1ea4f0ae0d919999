"""The public SMART / CATK network in closed loop, run by its own code.

    python smart_catk.py CHECKOUT CHECKPOINT [options]
    reactsim run --external catk='python smart_catk.py CHECKOUT CHECKPOINT'

CHECKOUT is a folder with the code of github.com/NVlabs/catk. CHECKPOINT is a checkpoint of its
training, or a safetensors file with the tensors of the network. The script needs torch,
torch_geometric, omegaconf and scipy. Without torch_cluster, functions of this file find the
neighbours.

The checkout provides the classes of the network, the tokenizer with both vocabularies, and the
division of the map into pieces. Token files that the checkpoint names are also found in its folder;
the checkout unpickles them, so use only files that you trust. This file converts scenes to the
input of the network and replaces the rollout loop: the episodes of a batch are evaluated together,
maps are encoded once per scenario, and every step of the agents is encoded once, on top of the
stored features of earlier steps. Differences from the published inference:

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

Plans must be multiples of half a second, the length of a token. The last bits of the results depend
on the number of episodes per batch.
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
from collections import OrderedDict, defaultdict
from pathlib import Path
from typing import Any, NamedTuple

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
SAME_POSE = 1e-5  # metres and radians; an agent this near its plan has executed its token
STORED_MAPS = 64  # encoded maps that are kept for further episodes of the same scenario

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
        own, other = y[rows], x[columns]
        dx, dy = (other[:, axis] - own[:, axis, None] for axis in (0, 1))
        near = dx * dx + dy * dy < r * r
        if ignore_same_index:
            near &= rows[:, None] != columns[None]
        if len(columns) > max_num_neighbors:
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
        from src.smart.utils import angle_between_2d_vectors
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

        def token_file(name: str, default: str) -> str:
            own = checkpoint.resolve().parent / Path(tokens.get(name, default)).name
            return str(own) if own.is_file() else str(tokens.get(name, default))

        self.device = device
        self.tokenizer = TokenProcessor(
            map_token_file=token_file("map_token_file", "map_traj_token5.pkl"),
            agent_token_file=token_file("agent_token_file", "agent_vocab_555_s2.pkl"),
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
        self.bearing = angle_between_2d_vectors
        every_class = torch.arange(len(CLASSES), device=device)
        self.boxes, contours, self.ends = self.tokenizer._get_agent_shape_and_token_traj(
            every_class
        )
        """Width and length of the box of each class, [3, 2], and its corners at the end of each
        token, [3, tokens, 4, 2]."""
        self.poses = np.stack([token_poses(own) for own in contours])
        """Poses of the tokens of each class at 0.1 to 0.5 s, f64 [3, tokens, 5, 3]."""
        encoder = self.decoder.agent_encoder
        self.window = int(encoder.time_span / TOKEN_FRAMES)
        """Number of earlier steps of its own that an agent attends to."""
        with torch.no_grad():
            embeddings = [getattr(encoder, f"token_emb_{name}") for name in CLASSES]
            shapes = self.ends.flatten(2, 3)
            self.token_features = torch.stack([emb(own) for emb, own in zip(embeddings, shapes)])
        """Embeddings of the tokens of each class, [3, tokens, width]."""


class Step(NamedTuple):
    """Poses of all agents of a batch at one step; steps are half a second apart."""

    valid: torch.Tensor
    """Whether each agent was present at this step and the one before, bool [A]."""
    token: torch.Tensor
    """Token that led here, i64 [A]."""
    position: torch.Tensor
    """f32 [A, 2], metres."""
    heading: torch.Tensor
    """f32 [A], radians."""


class EncodedStep(NamedTuple):
    """A step with the features of the agents."""

    step: Step
    features: list[torch.Tensor]
    """Input of every block of attention layers, and the output of the last, [A, width] each."""


class Agents:
    """All agents of a batch of scenes, and the encoded maps of the scenes."""

    def __init__(
        self,
        network: Network,
        maps: list[dict[str, torch.Tensor]],
        classes: list[torch.Tensor],
        shapes: list[torch.Tensor],
    ) -> None:
        self.network = network
        self.classes = torch.cat(classes)
        """Class of each agent, i64 [A]."""
        self.scene = torch.cat([torch.full_like(own, i) for i, own in enumerate(classes)])
        """Index of the scene of each agent, i64 [A]."""
        encoder = network.decoder.agent_encoder
        self.identities = [encoder.type_a_emb(self.classes), encoder.shape_emb(torch.cat(shapes))]
        self.pieces = {
            name: torch.cat([own[name] for own in maps])
            for name in ("pt_token", "position", "orientation")
        }
        self.scene_of_piece = torch.cat(
            [torch.full_like(m["batch"], i) for i, m in enumerate(maps)]
        )

    def encode(self, past: list[EncodedStep], step: Step) -> EncodedStep:
        """Encodes a step, given the encoded steps before it, oldest first."""
        network, encoder = self.network, self.network.decoder.agent_encoder
        motion = step.position - (past[-1].step.position if past else step.position)
        past = past[len(past) - min(len(past), network.window) :]
        steps = [*(earlier.step for earlier in past), step]
        valid = torch.stack([own.valid for own in steps], dim=1)
        heading = torch.stack([own.heading for own in steps], dim=1)
        directions = torch.stack([heading.cos(), heading.sin()], dim=-1)
        poses = {
            "pos_a": torch.stack([own.position for own in steps], dim=1),
            "head_a": heading,
            "head_vector_a": directions,
        }
        is_now = torch.zeros_like(valid)
        is_now[:, -1] = step.valid
        over_time, time_relations = encoder.build_temporal_edge(
            **poses, mask=valid, inference_mask=is_now
        )
        over_time[1] = over_time[1] // len(steps)  # from nodes of all steps to agents
        now = {name: values[:, -1:] for name, values in poses.items()}
        from_map, map_relations = encoder.build_map2agent_edge(
            pos_pl=self.pieces["position"],
            orient_pl=self.pieces["orientation"],
            mask=valid[:, -1:],
            batch_s=self.scene,
            batch_pl=self.scene_of_piece,
            **now,
        )
        among, agent_relations = encoder.build_interaction_edge(
            mask=valid[:, -1:], batch_s=self.scene, **now
        )
        bearing = network.bearing(ctr_vector=directions[:, -1], nbr_vector=motion)
        moved = encoder.x_a_emb(
            continuous_inputs=torch.stack([motion.norm(dim=-1), bearing], dim=-1),
            categorical_embs=self.identities,
        )
        token = network.token_features[self.classes, step.token]
        features = [encoder.fusion_emb(torch.cat([token, moved], dim=-1))]
        for i in range(encoder.num_layers):
            own = torch.stack([*(earlier.features[i] for earlier in past), features[i]], dim=1)
            x = encoder.t_attn_layers[i](
                (own.flatten(0, 1), features[i]), time_relations, over_time
            )
            x = encoder.pt2a_attn_layers[i]((self.pieces["pt_token"], x), map_relations, from_map)
            features.append(encoder.a2a_attn_layers[i](x, agent_relations, among))
        return EncodedStep(step, features)

    def scores(self, encoded: EncodedStep) -> torch.Tensor:
        """Returns the scores of the next tokens after a step, [A, tokens]."""
        scores: torch.Tensor = self.network.decoder.agent_encoder.token_predict_head(
            encoded.features[-1]
        )
        return scores


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
    av = scene.history[0, -1, :2]
    points, point_types, line_types, lights = [], [], [], []
    for line, kind, polygon, light in map_lines(scene, network.sides_of_crossing):
        if len(line) < 2:
            continue
        dense = line if is_dense else resampled(line)
        if np.hypot(*(dense - av).T).min() > within + MAX_POINT_GAP:
            continue  # no piece of it begins within the distance
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
    start = data["map_save"]["traj_pos"][:, 0].double() - torch.tensor(av)
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


def map_digest(scene: reactsim.Scene) -> bytes:
    """Returns a digest of all that the encoded map of a scene depends on."""
    lines = scene.scenes.lines
    own = lines.of_episode(scene.index)
    lane = lines.lane[own]
    lane = np.where(lane < 0, -1, lane - own[:1])  # they count from the first line of the batch
    lights = scene.lights
    contents = [
        *(lines.type[own], lines.category[own], lane, lines.value[own]),
        *(lines.start[own + 1] - lines.start[own], scene.history[0, -1, :2]),
        *(lights.lane, lights.states[:, -1], *(lines[line] for line in own)),
    ]
    return hashlib.sha256(b"".join(np.ascontiguousarray(c).tobytes() for c in contents)).digest()


class History(NamedTuple):
    """The agents of a scene that have tokens, and their steps up to the current frame."""

    slots: np.ndarray
    """Slots of these agents."""
    classes: np.ndarray
    """Class of each agent."""
    steps: list[Step]
    """Oldest first."""
    pose: np.ndarray
    """Pose at the current frame, f64 [n, 3]."""


def tokenize_history(network: Network, scene: reactsim.Scene) -> History:
    """Returns the steps of the agents of a scene, with the tokens nearest to their motion."""
    kinds = scene.kinds.astype(np.int64)
    kinds[0] = reactsim.Kind.VEHICLE  # the AV counts as a vehicle
    slots = np.flatnonzero(kinds <= reactsim.Kind.CYCLIST)
    states, present = without_gaps(scene.history[slots], scene.valid[slots])
    floats = torch.tensor(states, dtype=torch.float32, device=network.device)
    valid = torch.tensor(present, device=network.device)
    classes = torch.tensor(kinds[slots], device=network.device)
    tokenizer = network.tokenizer
    heading = tokenizer._clean_heading(valid, floats[..., 2].clone())
    valid, position, heading, _ = tokenizer._extrapolate_agent_to_prev_token_step(
        valid, floats[..., :2].contiguous(), heading, floats[..., 3:].contiguous()
    )
    matched = tokenizer._match_agent_token(
        valid=valid,
        pos=position,
        heading=heading,
        agent_shape=network.boxes[classes],
        token_traj=network.ends[classes],
    )
    # Poses of agents that were first observed too late for a whole token.
    late = ~matched["valid_mask"]
    matched["gt_pos"][late] = position[:, TOKEN_FRAMES::TOKEN_FRAMES][late]
    matched["gt_heading"][late] = heading[:, TOKEN_FRAMES::TOKEN_FRAMES][late]
    columns = [matched[name] for name in ("valid_mask", "gt_idx", "gt_pos", "gt_heading")]
    steps = [Step(*(column[:, t] for column in columns)) for t in range(late.shape[1])]
    pose = states[:, -1, :3]
    pose[:, 2] = heading[:, -1].cpu().numpy()
    return History(slots, kinds[slots], steps, pose)


class Rollouts:
    """The scenes of a batch during their rollouts: the steps of all their agents so far."""

    def __init__(
        self,
        network: Network,
        scenes: reactsim.Scenes,
        maps: list[dict[str, torch.Tensor]],
        height: float,
    ) -> None:
        self.network = network
        histories = [tokenize_history(network, scene) for scene in scenes]
        self.episodes = np.repeat(np.arange(len(scenes)), [len(h.slots) for h in histories])
        """Index of the episode of each agent."""
        self.slots = np.concatenate([own.slots for own in histories])
        """Slot of each agent in its episode."""
        self.classes = np.concatenate([own.classes for own in histories])
        self.pose = np.concatenate([own.pose for own in histories])
        """Pose of each agent at the newest step, f64 [A, 3]."""
        sizes = np.pad(scenes.sizes[self.episodes, self.slots], [(0, 0), (0, 1)])
        sizes[:, 2] = height
        device = network.device
        self.agents = Agents(
            network,
            maps,
            [torch.tensor(own.classes, device=device) for own in histories],
            [torch.tensor(sizes, dtype=torch.float32, device=device)],
        )
        self.past: list[EncodedStep] = []
        """Encoded steps, oldest first; only as many as the network attends to."""
        for together in zip(*(own.steps for own in histories)):
            self.remember(Step(*(torch.cat(parts) for parts in zip(*together))))
        self.planned: list[tuple[np.ndarray, torch.Tensor]] = []
        """Poses at the ends of the planned tokens, and the tokens."""

    def remember(self, step: Step) -> None:
        """Encodes the next step."""
        encoded = self.agents.encode(self.past, step)
        self.past = [*self.past, encoded][-max(self.network.window, 1) :]

    def advance(self, states: np.ndarray, valid: np.ndarray) -> None:
        """Adds the step half a second later, at which the agents have these states, [A, 5]."""
        network, pose = self.network, states[:, :3].copy()
        planned, token = self.planned.pop(0)
        apart = pose - planned
        apart[:, 2] = np.arctan2(np.sin(apart[:, 2]), np.cos(apart[:, 2]))
        # Agents that did not execute their tokens: the AV, and where the program changed motion.
        others = np.flatnonzero(~(np.abs(apart) < SAME_POSE).all(axis=1))
        if len(others):
            ends = np.stack([self.pose[others], pose[others]], axis=1)
            ends = np.repeat(ends, [1, TOKEN_FRAMES], axis=1)  # only both ends are read
            poses = torch.tensor(ends, dtype=torch.float32, device=network.device)
            classes = self.agents.classes[others]
            matched = network.tokenizer._match_agent_token(
                valid=torch.ones(poses.shape[:2], dtype=torch.bool, device=network.device),
                pos=poses[..., :2],
                heading=poses[..., 2],
                agent_shape=network.boxes[classes],
                token_traj=network.ends[classes],
            )
            token = token.clone()
            token[others] = matched["gt_idx"][:, 0]
        now = torch.tensor(pose, dtype=torch.float32, device=network.device)
        present = torch.tensor(valid, device=network.device)
        self.remember(Step(present, token, now[:, :2], now[:, 2]))
        self.pose = pose

    def plan(self, count: int, draw: Any) -> np.ndarray:
        """Returns poses of the next `count` tokens, f64 [A, 5 * count, 3].

        `draw` chooses a token for each agent from the scores of all, [A, tokens].
        """
        past, pose, poses = self.past, self.pose, []
        self.planned = []
        for remaining in reversed(range(count)):
            token = draw(self.agents.scores(past[-1]))
            motion = self.network.poses[self.classes, token.cpu().numpy()]
            cos, sin = np.cos(pose[:, None, 2]), np.sin(pose[:, None, 2])
            moved = motion + pose[:, None]
            moved[..., 0] = pose[:, None, 0] + cos * motion[..., 0] - sin * motion[..., 1]
            moved[..., 1] = pose[:, None, 1] + sin * motion[..., 0] + cos * motion[..., 1]
            poses.append(moved)
            pose = moved[:, -1]
            self.planned.append((pose, token))
            if remaining:
                now = torch.tensor(pose, dtype=torch.float32, device=self.network.device)
                step = Step(past[-1].step.valid, token, now[:, :2], now[:, 2])
                past = [*past, self.agents.encode(past, step)]
        return np.concatenate(poses, axis=1)


# --------------------------------------------------------------------------------------------------
# The simulator.


class SmartCatk(reactsim.Simulator):
    """Moves agents by tokens that the network of a checkout predicts."""

    name = "smart-catk"
    version = "2"
    intervals = tuple(range(TOKEN_FRAMES, 81, TOKEN_FRAMES))
    batch = 8

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
        self.top_k, self.temperature = top_k, temperature
        self.maps: OrderedDict[bytes, dict[str, torch.Tensor]] = OrderedDict()
        """Encoded maps by their digests, most recently used last."""
        self.rollouts: Rollouts | None = None

    def encoded_map(self, scene: reactsim.Scene) -> dict[str, torch.Tensor]:
        """Returns the encoded map of a scene."""
        digest = map_digest(scene)
        if digest not in self.maps:
            tokenized_map = tokenize_map(self.network, scene, self.map_radius)
            self.maps[digest] = self.network.decoder.map_encoder(tokenized_map)
        self.maps.move_to_end(digest)
        while len(self.maps) > STORED_MAPS:
            self.maps.popitem(last=False)
        return self.maps[digest]

    @torch.no_grad()
    def begin(self, scenes: reactsim.Scenes) -> None:
        maps = [self.encoded_map(scene) for scene in scenes]
        self.rollouts = Rollouts(self.network, scenes, maps, self.height)

    @torch.no_grad()
    def plan(self, seen: reactsim.Observation) -> np.ndarray:
        rollouts = self.rollouts
        assert rollouts is not None
        of, slots = rollouts.episodes, rollouts.slots
        # The history, frames 0 to 10, is known since `begin`.
        first = max(seen.frame + 1 - seen.n_new, reactsim.client.HISTORY)
        for frame in range(first + TOKEN_FRAMES - 1, seen.frame + 1, TOKEN_FRAMES):
            rollouts.advance(seen.states[of, slots, frame], seen.valid[of, slots, frame])

        # One generator per episode: random numbers do not depend on the batch.
        generators = {
            i: torch.Generator().manual_seed(int(seen.scenes.rng(i).integers(2**63)))
            for i in np.flatnonzero(seen.active).tolist()
        }

        def draw(scores: torch.Tensor) -> torch.Tensor:
            best, token = scores.topk(min(self.top_k, scores.shape[1]), dim=-1)
            shares = (best.cpu() / self.temperature).softmax(dim=-1)
            drawn = torch.zeros((len(of), 1), dtype=torch.long)  # remains 0 in failed episodes
            for i, generator in generators.items():
                drawn[of == i] = torch.multinomial(shares[of == i], 1, generator=generator)
            return token.gather(1, drawn.to(token.device))[:, 0]

        plan = np.repeat(seen.states[:, :, -1:, :3], seen.steps, axis=2)
        plan[of, slots] = rollouts.plan(seen.steps // TOKEN_FRAMES, draw)
        return plan

    def end(self, episodes: np.ndarray) -> None:
        self.rollouts = None


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

"""Client of the protocol for external simulators and planners of `reactsim`.

This file needs only numpy (>= 1.17) and Python (>= 3.8), so it can be copied into any repository:

    from client import Simulator, serve

A simulator has a method `plan`, which receives an `Observation` and returns the future states of
all agents. A `Planner` drives the AV. `serve` answers the program until it closes the connection.

Units are metres, seconds, radians (counter-clockwise from the x axis) and m/s. Positions are box
centres in the local frame of the scenario, whose origin is the position of the AV at the current
frame. Frames are 0.1 s apart. Unless scenarios have another length (`Scenes.n_history` and
`Scenes.n_steps`), frames 0 to 10 are the history, frame 10 is the current frame, and 80 follow.

In shapes, B is the number of episodes of a batch, N the largest number of agents of an episode, T
the number of frames, S of planned steps, P of points, L of lines, E of links, K of traffic lights,
and O of obstacles.
"""

from __future__ import annotations

import copy
import dataclasses
import enum
import functools
import json
import math
import os
import re
import sys
import traceback
from typing import (
    IO,
    TYPE_CHECKING,
    Any,
    Callable,
    Dict,
    Iterator,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
    Union,
)

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[Any]
else:
    Array = np.ndarray

__all__ = [
    "DT",
    "Kind",
    "Lane",
    "Light",
    "Lights",
    "Line",
    "LineType",
    "Lines",
    "Neighbor",
    "Observation",
    "Plan",
    "Planner",
    "PlannerObservation",
    "ProtocolError",
    "Relation",
    "Scene",
    "Scenes",
    "Simulator",
    "Trajectory",
    "serve",
]

PROTOCOL = "1"
DT = 0.1  # seconds between two frames
HISTORY = 11  # frames up to and including the current one, unless scenarios state another number
STEPS = 80  # frames after the current one, unless scenarios state another number
MAX_HISTORY, MAX_STEPS = 100, 6000
MAX_COORDINATE = 100_000.0  # metres; positions farther from the origin are refused
MAX_HEADER = 64 << 20  # bytes of a safetensors header
MAX_KEPT = 4096  # bytes of a header whose layout is kept for the next frames
MAX_FRAME = 64 << 30  # bytes of a frame
MAX_TEXT = 100_000  # characters of all error texts of an answer, of which 1 MiB is accepted


class ProtocolError(Exception):
    """A message that does not follow the protocol."""


class Kind(enum.IntEnum):
    """Kind of an agent."""

    VEHICLE = 0
    PEDESTRIAN = 1
    CYCLIST = 2
    OTHER = 3
    PADDING = 255


class LineType(enum.IntEnum):
    """Type of a line of the map."""

    LANE = 0
    CONNECTOR = 1
    LANE_OUTLINE = 2
    ROAD_EDGE = 3
    PAINTED_LINE = 4
    STOP_LINE = 5
    CROSSWALK = 6
    SPEED_BUMP = 7
    DRIVEWAY = 8
    JUNCTION = 9
    DRIVABLE_AREA = 10
    DRIVABLE_HOLE = 11


class Relation(enum.IntEnum):
    """Relation of a lane to another lane."""

    SUCCESSOR = 0
    PREDECESSOR = 1
    LEFT = 2
    RIGHT = 3


class Light(enum.IntEnum):
    """State of a traffic light, as in the Waymo Open Motion Dataset."""

    UNKNOWN = 0
    ARROW_STOP = 1
    ARROW_CAUTION = 2
    ARROW_GO = 3
    STOP = 4
    CAUTION = 5
    GO = 6
    FLASHING_STOP = 7
    FLASHING_CAUTION = 8
    NOT_OBSERVED = 255


# --------------------------------------------------------------------------------------------------
# Frames: a length and a safetensors document.

_DTYPES: Dict[str, Any] = {
    name: np.dtype(code)
    for name, code in [
        ("BOOL", "|b1"),
        ("U8", "|u1"),
        ("I8", "|i1"),
        ("U16", "<u2"),
        ("I16", "<i2"),
        ("U32", "<u4"),
        ("I32", "<i4"),
        ("U64", "<u8"),
        ("I64", "<i8"),
        ("F16", "<f2"),
        ("F32", "<f4"),
        ("F64", "<f8"),
    ]
}
_DTYPE_NAMES: Dict[str, str] = {dtype.str: name for name, dtype in _DTYPES.items()}


def as_array(value: Any) -> Array:
    """Returns an array. Masked numbers are absent, and become NaN."""
    is_masked = isinstance(value, (list, tuple)) and any(
        isinstance(part, np.ma.MaskedArray) for part in value
    )
    array: Any = np.ma.stack(value) if is_masked else value
    if not isinstance(array, np.ma.MaskedArray):
        return np.asarray(array)
    # Only floating-point numbers can be absent.
    masked: Any = array if array.dtype.kind == "f" else array.astype(np.float64)
    filled: Array = masked.filled(np.nan)
    return filled


def _unique(pairs: List[Tuple[str, Any]]) -> Dict[str, Any]:
    """Returns a JSON object as a dictionary; refuses repeated keys."""
    result = dict(pairs)
    if len(result) != len(pairs):
        raise ValueError("a key occurs twice")
    return result


_Layout = List[Tuple[str, Any, List[int]]]


def _header(text: bytes, size: int) -> Tuple[Dict[str, str], _Layout]:
    """Reads a header before `size` bytes: the metadata, and the layout as `_layout` returns it."""
    # Frames of one kind differ in their metadata only: what follows is read once.
    first = _METADATA.match(text)
    found: List[Any] = []
    if first is not None:
        found, text = [_json_of(first[1])], b"{" + text[first.end() :]
    layout_of = _layout if len(text) <= MAX_KEPT else _layout.__wrapped__
    further, layout = layout_of(text, size)
    found += further
    if len(found) > 1:
        raise ProtocolError("safetensors: the header is not valid JSON: a key occurs twice")
    metadata: Any = found[0] if found else {}
    if not isinstance(metadata, dict) or not all(isinstance(v, str) for v in metadata.values()):
        raise ProtocolError("safetensors: metadata values must be strings")
    return dict(metadata), layout


# Metadata at the start of a header, which contain no other object.
_METADATA = re.compile(rb'\{"__metadata__":(\{[^{}]*\}),(?=")')


def _json_of(text: bytes) -> Any:
    try:
        return json.loads(text.decode("utf-8"), object_pairs_hook=_unique)
    except (ValueError, RecursionError) as error:
        raise ProtocolError("safetensors: the header is not valid JSON: %s" % error) from None


@functools.lru_cache(maxsize=64)
def _layout(text: bytes, size: int) -> Tuple[List[Any], _Layout]:
    """Reads the metadata of a header, and name, type and shape of each tensor.

    Tensors are in the order of their offsets. Raises ProtocolError unless they have known types and
    fill `size` bytes without gaps.
    """
    header = _json_of(text)
    if not isinstance(header, dict):
        raise ProtocolError("safetensors: the header is not a JSON object")
    metadata = [header.pop("__metadata__")] if "__metadata__" in header else []
    spans: List[Tuple[int, int, str, Any, List[int]]] = []
    for name, entry in header.items():
        if not isinstance(entry, dict) or set(entry) != {"dtype", "shape", "data_offsets"}:
            raise ProtocolError("safetensors: tensor `%s` has an incomplete entry" % name)
        dtype = _DTYPES.get(entry["dtype"]) if isinstance(entry["dtype"], str) else None
        if dtype is None:
            raise ProtocolError(
                "safetensors: tensor `%s` has the unknown type %r" % (name, entry["dtype"])
            )
        shape, offsets = entry["shape"], entry["data_offsets"]
        for numbers in (shape, offsets):
            if not isinstance(numbers, list) or not all(
                type(n) is int and 0 <= n < 1 << 62 for n in numbers
            ):
                raise ProtocolError("safetensors: tensor `%s` has a bad shape or offset" % name)
        count = 1
        for n in shape:
            count *= n
        if len(shape) > 8 or len(offsets) != 2 or offsets[1] - offsets[0] != count * dtype.itemsize:
            raise ProtocolError(
                "safetensors: tensor `%s` of shape %s does not fit its offsets %s"
                % (name, shape, offsets)
            )
        if offsets[1] > size:
            raise ProtocolError("safetensors: tensor `%s` ends after the document" % name)
        spans.append((offsets[0], offsets[1], name, dtype, shape))
    spans.sort(key=lambda span: span[:2])
    end = 0
    for first, last, name, _, _ in spans:
        if first != end:
            raise ProtocolError("safetensors: gap or overlap before tensor `%s`" % name)
        end = last
    if end != size:
        raise ProtocolError("safetensors: %d bytes after the last tensor" % (size - end))
    return metadata, [span[2:] for span in spans]


def build_safetensors(metadata: Mapping[str, str], tensors: Mapping[str, Array]) -> List[Any]:
    """Returns a safetensors document as its header and one buffer per tensor, without copies."""
    parts: List[Any] = []
    kinds: List[Tuple[str, str, Tuple[int, ...], int]] = []
    # Wide types first, so that every tensor is aligned.
    for name in sorted(tensors, key=lambda n: (-tensors[n].dtype.itemsize, n)):
        array = np.ascontiguousarray(tensors[name]).reshape(tensors[name].shape)
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        if array.dtype.str not in _DTYPE_NAMES:
            raise ProtocolError(
                "safetensors: tensor `%s` has the unsupported type %s" % (name, array.dtype)
            )
        kinds.append((name, array.dtype.str, array.shape, array.nbytes))
        if array.nbytes:
            parts.append(array.reshape(-1).view(np.uint8).data)
    text = json.dumps({"__metadata__": dict(metadata)}, separators=(",", ":")).encode("ascii")
    text = text[:-1] + _entries(tuple(kinds))
    text += b" " * (-len(text) % 8)
    return [len(text).to_bytes(8, "little") + text, *parts]


@functools.lru_cache(maxsize=64)
def _entries(kinds: Tuple[Tuple[str, str, Tuple[int, ...], int], ...]) -> bytes:
    """Returns the end of a header after its metadata: entries of tensors that follow one another.

    Each has a name, a type, a shape and a number of bytes. Most frames of a session have the same.
    """
    header: Dict[str, Any] = {}
    offset = 0
    for name, dtype, shape, size in kinds:
        entry = {"dtype": _DTYPE_NAMES[dtype], "shape": list(shape)}
        header[name] = dict(entry, data_offsets=[offset, offset + size])
        offset += size
    text = json.dumps(header, separators=(",", ":"))[1:].encode("ascii")
    return b"," + text if header else text


_Frame = Tuple[Dict[str, str], Dict[str, Array]]


def read_frame(stream: IO[bytes], room: Optional[Mapping[str, Array]] = None) -> Optional[_Frame]:
    """Reads a frame; returns None at the end of the stream.

    Tensors are read into the arrays of `room` that have their names, types and shapes, and are
    contiguous.
    """
    prefix = np.empty(8, np.uint8)
    n = _fill(stream, prefix)
    if n == 0:
        return None
    if n < 8:
        raise ProtocolError(_CUT)
    length = int.from_bytes(prefix.tobytes(), "little")
    if length > MAX_FRAME:
        raise ProtocolError("a frame of %d bytes exceeds the limit of %d" % (length, MAX_FRAME))
    metadata, tensors = read_safetensors(stream, length, room)
    for key in ("type", "protocol", "seq"):
        if key not in metadata:
            raise ProtocolError("a frame without `%s`: %r" % (key, metadata))
    return metadata, tensors


_CUT = "the stream ended within a frame"


def read_safetensors(
    stream: IO[bytes], length: int, room: Optional[Mapping[str, Array]] = None
) -> _Frame:
    """Reads a safetensors document of `length` bytes: its metadata and its tensors.

    `room` is as for `read_frame`. Raises ProtocolError unless the tensors have known types and fill
    the document without gaps.
    """
    prefix = np.empty(8, np.uint8)
    if length < 8:
        raise ProtocolError("safetensors: %d bytes are too short for a header" % length)
    if _fill(stream, prefix) < 8:
        raise ProtocolError(_CUT)
    size = int.from_bytes(prefix.tobytes(), "little")
    if size > min(length - 8, MAX_HEADER):
        raise ProtocolError(
            "safetensors: a header of %d bytes in a document of %d" % (size, length)
        )
    text = np.empty(size, np.uint8)
    if _fill(stream, text) < size:
        raise ProtocolError(_CUT)
    metadata, layout = _header(text.tobytes(), length - 8 - size)
    tensors: Dict[str, Array] = {}
    for name, dtype, shape in layout:
        array = (room or {}).get(name)
        is_fit = array is not None and array.dtype == dtype and array.shape == tuple(shape)
        if array is None or not is_fit or not array.flags.c_contiguous:
            try:
                array = np.empty(shape, dtype)
            except ValueError as error:
                raise ProtocolError(
                    "safetensors: tensor `%s` of shape %s: %s" % (name, shape, error)
                ) from None
        if _fill(stream, array) < array.nbytes:
            raise ProtocolError(_CUT)
        tensors[name] = array
    return metadata, tensors


def write_frame(
    stream: IO[bytes],
    kind: str,
    seq: str,
    metadata: Optional[Mapping[str, str]] = None,
    tensors: Optional[Mapping[str, Array]] = None,
) -> None:
    """Writes a frame of this type and flushes the stream."""
    head = {"type": kind, "protocol": PROTOCOL, "seq": seq}
    head.update(metadata or {})
    parts = build_safetensors(head, tensors or {})
    parts[0] = sum(len(p) for p in parts).to_bytes(8, "little") + parts[0]
    for part in parts:
        stream.write(part)
    stream.flush()


def _fill(stream: IO[bytes], buffer: Array) -> int:
    """Reads until the array is full or the stream ends; returns the number of bytes."""
    n = more = (stream.readinto(buffer) or 0) if buffer.size else 0  # type: ignore[attr-defined]
    while more and n < buffer.nbytes:
        rest = buffer.reshape(-1).view(np.uint8)[n:]
        more = stream.readinto(rest)  # type: ignore[attr-defined]
        n += more or 0
    return n


class _Tensors:
    """Tensors of a message, taken with checks of type and shape.

    Letters in shapes are dimensions that must agree among all tensors of a message.
    """

    def __init__(self, tensors: Dict[str, Array], **sizes: int) -> None:
        self.tensors = tensors
        self.sizes: Dict[str, int] = dict(sizes)

    def take(self, name: str, dtype: str, *shape: Union[int, str]) -> Array:
        """Returns a tensor as a read-only array; flags become booleans."""
        array = self.tensors.get(name)
        if array is None:
            raise ProtocolError("tensor `%s` is missing" % name)
        expected = _DTYPES["U8" if dtype == "BOOL" else dtype]
        if array.dtype != expected:
            raise ProtocolError(
                "tensor `%s` has type %s, expected %s" % (name, array.dtype, expected)
            )
        wanted = shape
        if array.ndim == len(shape):
            wanted = tuple(
                self.sizes.setdefault(s, n) if isinstance(s, str) else s
                for s, n in zip(shape, array.shape)
            )
        if array.shape != wanted:
            raise ProtocolError(
                "tensor `%s` has shape %s, expected %s" % (name, array.shape, shape)
            )
        if dtype == "BOOL":
            if array.size and int(array.max()) > 1:
                raise ProtocolError("tensor `%s` has flags other than 0 and 1" % name)
            array = array.view(np.bool_)
        array.flags.writeable = False
        return array

    def take_index(self, name: str, end: int, first: int, *shape: Union[int, str]) -> Array:
        """Returns a tensor of indices from `first` to `end` - 1."""
        array = self.take(name, "I32", *shape)
        if array.size and not first <= int(array.min()) <= int(array.max()) < end:
            raise ProtocolError(
                "tensor `%s` has an index outside %d to %d" % (name, first, end - 1)
            )
        return array


# --------------------------------------------------------------------------------------------------
# Scenes.


class Line(NamedTuple):
    """A line of the map of one scene.

    Attributes:
        points: Points, f64 [P, 2], metres.
        category: Class of the line as in the protocol: kind of a road edge or stop line, paint of a
            painted line.
        lane: Index in `Scene.lanes` of the lane that the line belongs to, or -1.
        value: Arc length along the lane for stop lines, metres; NaN if unknown.
        heights: Height of each point, f64 [P], metres, NaN if unknown; None for simulators.

    """

    points: Array
    category: int
    lane: int
    value: float
    heights: Optional[Array] = None


class Neighbor(NamedTuple):
    """An adjacent lane in the same direction, and the adjacent sections as point indices.

    Attributes:
        lane: Index in `Scene.lanes`.
        self_start: First point of the section of the own centre line.
        self_end: Last point of this section.
        other_start: First point of the section of the centre line of the adjacent lane.
        other_end: Last point of this section.

    """

    lane: int
    self_start: int
    self_end: int
    other_start: int
    other_end: int


@dataclasses.dataclass
class Lane:
    """A lane, or a connector through a junction, of the map of one scene.

    Attributes:
        index: Index in `Scene.lanes`.
        points: Centre line, f64 [P, 2], metres.
        is_connector: Whether it leads through a junction.
        category: 0 undefined, 1 freeway, 2 surface street, 3 bike.
        speed_limit: Speed limit, m/s; NaN if unknown.
        outline: Outline, f64 [P, 2], metres; None if the map records a half-width or nothing.
        half_width: Half-width around the centre line, metres; NaN if the map records an outline or
            nothing.
        successors: Lanes that follow at its end, as indices in `Scene.lanes`.
        predecessors: Lanes that lead to its beginning, as indices.
        left: Adjacent lanes on the left.
        right: Adjacent lanes on the right.
        heights: Height of each point of the centre line, f64 [P], metres, NaN if unknown; None for
            simulators.

    """

    index: int
    points: Array
    is_connector: bool
    category: int
    speed_limit: float
    outline: Optional[Array]
    half_width: float
    successors: List[int]
    predecessors: List[int]
    left: List[Neighbor]
    right: List[Neighbor]
    heights: Optional[Array] = None


class Lines:
    """Lines of the maps of all episodes of a batch, as flat arrays.

    Line i has the points `points[start[i]:start[i + 1]]`; `lines[i]` returns them.

    Attributes:
        points: Points of all lines, f64 [P, 2], metres.
        heights: Height of each point, f64 [P], metres, NaN if unknown; None for simulators.
        type: Type of each line, u8 [L]; see `LineType`.
        start: Index of the first point of each line, and the number of points at the end, i64 [L +
            1].
        episode: Index of the episode in the batch of each line, i32 [L].
        category: Class of each line, u8 [L]; its meaning depends on the type.
        lane: Line index of the lane that a line belongs to, or -1, i32 [L].
        value: Speed limit of lanes (m/s), half-width of outlines or arc length of stop lines (m),
            f64 [L].
        links: Links between lanes, i32 [E, 7]: from, to (line indices), relation, self start, self
            end, other start, other end; see `Relation`.

    """

    def __init__(self, tensors: _Tensors, episodes: int) -> None:
        self.points: Array = tensors.take("points", "F64", "P", 2)
        self.heights: Optional[Array] = None
        self.type: Array = tensors.take("line_type", "U8", "L")
        count = len(self.type)
        self.start: Array = tensors.take("line_start", "I64", count + 1)
        self.episode: Array = tensors.take_index("line_episode", episodes, 0, count)
        self.category: Array = tensors.take("line_class", "U8", count)
        self.lane: Array = tensors.take_index("line_lane", count, -1, count)
        self.value: Array = tensors.take("line_value", "F64", count)
        self.links: Array = tensors.take("link", "I32", "E", 7)
        start = self.start
        if start[0] != 0 or start[-1] != len(self.points) or (np.diff(start) < 0).any():
            raise ProtocolError(
                "tensor `line_start` does not divide the %d points" % len(self.points)
            )
        ends = self.links[:, :2]
        if ends.size and not 0 <= int(ends.min()) <= int(ends.max()) < count:
            raise ProtocolError("tensor `link` has a lane outside 0 to %d" % (count - 1))

        self._is_sorted = not (np.diff(self.episode) < 0).any()

    def __len__(self) -> int:
        return len(self.type)

    def of_episode(self, index: int) -> Array:
        """Returns the indices of the lines of an episode of the batch."""
        if self._is_sorted:
            first, end = np.searchsorted(self.episode, [index, index + 1])
            return np.arange(first, end)
        return np.flatnonzero(self.episode == index)

    def __getitem__(self, index: int) -> Array:
        """Points of a line, f64 [P, 2]."""
        index = range(len(self.type))[index]
        points: Array = self.points[self.start[index] : self.start[index + 1]]
        return points

    def heights_of(self, index: int) -> Optional[Array]:
        """Returns the heights of the points of a line, f64 [P]."""
        if self.heights is None:
            return None
        heights: Array = self.heights[self.start[index] : self.start[index + 1]]
        return heights


class Lights:
    """Traffic lights: of all episodes of a batch, or of one scene.

    Attributes:
        episode: Index of the episode in the batch, i32 [K].
        lane: Controlled lane, i32 [K]: a line index in a batch, an index in `Scene.lanes` in a
            scene.
        stop: Stop points, f64 [K, 2], metres.
        states: States up to the current frame, u8 [K, n_history]; see `Light`.

    """

    def __init__(self, episode: Array, lane: Array, stop: Array, states: Array) -> None:
        self.episode = episode
        self.lane = lane
        self.stop = stop
        self.states = states

    def __len__(self) -> int:
        return len(self.lane)


class Continuation:
    """The episode of a planner that another one continues, as agents have entered or left.

    Attributes:
        memory: The value that `Planner.begin` returned for it.
        frame: Its frame at which the history of the new episode ends.
        slots: Its slot of each agent of the new episode, i32 [n]; -1 for agents that enter.

    """

    def __init__(self, memory: Any, frame: int, slots: Array) -> None:
        self.memory = memory
        self.frame = frame
        self.slots = slots


class Scenes:
    """Agents, histories and maps of a batch of episodes. All arrays are read-only.

    `len(scenes)` is the number of episodes B; `scenes[i]` is one of them without padding.

    Attributes:
        n_history: Number of frames up to and including the current one, 11 in the benchmark. All
            episodes of a batch have the same.
        n_steps: Number of steps after the current frame, 80 in the benchmark, as `n_history`.
        episodes: Handle of each episode, unique in the process, u64 [B].
        seeds: Seed of all random choices in each episode, u64 [B]; see `rng`.
        kinds: Kind of each agent, u8 [B, N]; slot 0 is the AV; see `Kind`.
        n_agents: Number of agents of each episode, i32 [B]; later slots are padding.
        sizes: Length and width of each agent, f64 [B, N, 2], metres.
        history: States up to the current frame, f64 [B, N, n_history, 5]: x, y, heading, vx, vy in
            metres, radians and m/s; 0 where absent, NaN velocity where unknown.
        valid: Whether each agent is present, bool [B, N, n_history].
        lines: Lines of the maps.
        lights: Traffic lights.
        obstacle_episode: Index of the episode of each obstacle, i32 [O].
        obstacles: Static obstacles, f64 [O, 5]: x, y, heading, length, width; metres and radians.
        moves_av: Whether slot 0 of the plan is executed (realism protocol).
        steps: Replan interval, steps; 0 if there is none.
        scenario_ids: Ids of the scenarios, only with `--reveal-ids`.
        agent_ids: Ids of the agents of each episode, only with `--reveal-ids`.
        origins: World coordinates of the local origins, metres, only with `--reveal-ids`.
        rollouts: Indices of the rollouts, only with `--reveal-ids`.
        continues: The episode that this one continues, within `Planner.begin`; None if it is new.

    """

    def __init__(self, metadata: Mapping[str, str], tensors: Dict[str, Array]) -> None:
        take = _Tensors(tensors)
        self.n_history, self.n_steps = _length(metadata)
        self.episodes: Array = take.take("episode", "U64", "B")
        batch = len(self.episodes)
        self.seeds: Array = take.take("seed", "U64", batch)
        self.kinds: Array = take.take("kind", "U8", batch, "N")
        agents = self.kinds.shape[1]
        self.n_agents: Array = take.take_index("n_agents", agents + 1, 1, batch)
        self.sizes: Array = take.take("size", "F64", batch, agents, 2)
        self.history: Array = take.take("history", "F64", batch, agents, self.n_history, 5)
        self.valid: Array = take.take("valid", "BOOL", batch, agents, self.n_history)
        self.lines = Lines(take, batch)
        self.lights = Lights(
            take.take_index("light_episode", batch, 0, "K"),
            take.take_index("light_lane", len(self.lines), -1, "K"),
            take.take("light_stop", "F64", "K", 2),
            take.take("light_state", "U8", "K", self.n_history),
        )
        self.obstacle_episode: Array = take.take_index("obstacle_episode", batch, 0, "O")
        self.obstacles: Array = take.take("obstacle", "F64", "O", 5)
        self.moves_av = metadata.get("moves_av") == "1"
        self.steps = _integer(metadata, "steps", 1, MAX_STEPS) if "steps" in metadata else 0
        self.scenario_ids: Optional[List[str]] = _json_list(metadata, "scenario_ids", batch)
        self.agent_ids: Optional[List[List[str]]] = _json_list(metadata, "agent_ids", batch)
        self.origins: Optional[List[List[float]]] = _json_list(metadata, "origins", batch)
        self.rollouts: Optional[List[int]] = _json_list(metadata, "rollouts", batch)
        self.continues: Optional[Continuation] = None
        self._generators: Dict[int, np.random.Generator] = {}

    def __len__(self) -> int:
        return len(self.episodes)

    def __getitem__(self, index: int) -> Scene:
        """One episode as a view without padding."""
        return Scene(self, range(len(self))[index])

    def __iter__(self) -> Iterator[Scene]:
        return (self[index] for index in range(len(self)))

    def rng(self, index: int) -> np.random.Generator:
        """Returns the random stream of an episode; further calls continue the same stream."""
        index = range(len(self))[index]
        if index not in self._generators:
            self._generators[index] = np.random.Generator(np.random.PCG64(int(self.seeds[index])))
        return self._generators[index]


class Scene:
    """One episode of a batch, as a view without padding.

    Lines of the map are prepared on first use.

    Attributes:
        index: Index of the episode in the batch.
        n_agents: Number of agents n; agent 0 is the AV.
        n_history: Number of frames up to and including the current one, 11 in the benchmark.
        n_steps: Number of steps after the current frame, 80 in the benchmark.

    """

    def __init__(self, scenes: Scenes, index: int) -> None:
        self.scenes = scenes
        self.index = index
        self.n_agents = int(scenes.n_agents[index])
        self.n_history = scenes.n_history
        self.n_steps = scenes.n_steps
        self._lanes: Optional[List[Lane]] = None
        self._lane_index: Dict[int, int] = {}
        self._own: Dict[int, Array] = {}

    @property
    def kinds(self) -> Array:
        """Kind of each agent, u8 [n]; see `Kind`."""
        return self.scenes.kinds[self.index, : self.n_agents]

    @property
    def sizes(self) -> Array:
        """Length and width of each agent, f64 [n, 2], metres."""
        return self.scenes.sizes[self.index, : self.n_agents]

    @property
    def history(self) -> Array:
        """States up to now, f64 [n, n_history, 5]: x, y, heading, vx, vy; 0 where absent.

        Metres, radians and m/s.
        """
        return self.scenes.history[self.index, : self.n_agents]

    @property
    def valid(self) -> Array:
        """Whether each agent is present, bool [n, n_history]."""
        return self.scenes.valid[self.index, : self.n_agents]

    @property
    def rng(self) -> np.random.Generator:
        """Random stream of the episode."""
        return self.scenes.rng(self.index)

    @property
    def obstacles(self) -> Array:
        """Static obstacles, f64 [O, 5]: x, y, heading, length, width."""
        own: Array = self.scenes.obstacles[self.scenes.obstacle_episode == self.index]
        return own

    @property
    def lights(self) -> Lights:
        """Traffic lights; their lanes are indices in `lanes`."""
        every = self.scenes.lights
        own = every.episode == self.index
        lanes = [self._lane_of(line) for line in every.lane[own].tolist()]
        return Lights(
            every.episode[own], np.array(lanes, np.int32), every.stop[own], every.states[own]
        )

    @property
    def lanes(self) -> List[Lane]:
        """Lanes and connectors, with links between them."""
        if self._lanes is None:
            self._lanes = self._make_lanes()
        return self._lanes

    @property
    def road_edges(self) -> List[Line]:
        """Road edges; the drivable side is on the left."""
        return self._lines_of(LineType.ROAD_EDGE)

    @property
    def painted_lines(self) -> List[Line]:
        """Painted lines; `category` is the paint."""
        return self._lines_of(LineType.PAINTED_LINE)

    @property
    def stop_lines(self) -> List[Line]:
        """Stop lines of two points; `category` is 0 light, 1 stop sign, 2 give way."""
        return self._lines_of(LineType.STOP_LINE)

    @property
    def crosswalks(self) -> List[Line]:
        """Outlines of crosswalks."""
        return self._lines_of(LineType.CROSSWALK)

    @property
    def speed_bumps(self) -> List[Line]:
        """Outlines of speed bumps."""
        return self._lines_of(LineType.SPEED_BUMP)

    @property
    def driveways(self) -> List[Line]:
        """Outlines of driveways."""
        return self._lines_of(LineType.DRIVEWAY)

    @property
    def junctions(self) -> List[Line]:
        """Outlines of junctions."""
        return self._lines_of(LineType.JUNCTION)

    @property
    def drivable_areas(self) -> List[List[Array]]:
        """Drivable polygons: lists of rings, f64 [P, 2], the outer ring first, then its holes."""
        areas: List[List[Array]] = []
        for line in self._line_indices():
            if self.scenes.lines.type[line] == LineType.DRIVABLE_AREA:
                areas.append([self.scenes.lines[line]])
            elif self.scenes.lines.type[line] == LineType.DRIVABLE_HOLE and areas:
                areas[-1].append(self.scenes.lines[line])
        return areas

    def _line_indices(self) -> Array:
        if -1 not in self._own:
            self._own[-1] = self.scenes.lines.of_episode(self.index)
        return self._own[-1]

    def _indices_of(self, kind: int) -> Array:
        if kind not in self._own:
            own = self._line_indices()
            self._own[kind] = own[self.scenes.lines.type[own] == kind]
        return self._own[kind]

    def _lane_of(self, line: int) -> int:
        """Returns the index in `lanes` of a line index, or -1."""
        if line < 0:
            return -1
        _ = self.lanes
        return self._lane_index.get(line, -1)

    def _records(self, indices: Array) -> Iterator[Tuple[int, Array, int, int, float]]:
        """Yields index, points, class, lane and value of lines."""
        lines = self.scenes.lines
        points = lines.points
        ranges = zip(lines.start[indices].tolist(), lines.start[indices + 1].tolist())
        return zip(
            indices.tolist(),
            (points[first:end] for first, end in ranges),
            lines.category[indices].tolist(),
            lines.lane[indices].tolist(),
            lines.value[indices].tolist(),
        )

    def _lines_of(self, kind: LineType) -> List[Line]:
        return [
            Line(points, category, self._lane_of(lane), value, self.scenes.lines.heights_of(line))
            for line, points, category, lane, value in self._records(self._indices_of(kind))
        ]

    def _make_lanes(self) -> List[Lane]:
        lines = self.scenes.lines
        own = self._line_indices()
        indices = own[lines.type[own] <= LineType.CONNECTOR]
        self._lane_index = {line: k for k, line in enumerate(indices.tolist())}
        outlines: Dict[int, Tuple[Array, float]] = {
            lane: (points, value)
            for _, points, _, lane, value in self._records(self._indices_of(LineType.LANE_OUTLINE))
        }
        none = (np.empty((0, 2)), math.nan)
        is_connector = (lines.type[indices] == LineType.CONNECTOR).tolist()
        lanes: List[Lane] = []
        for line, points, category, _, limit in self._records(indices):
            k = len(lanes)
            ring, half_width = outlines.get(line, none)
            outline = ring if len(ring) else None
            about = (k, points, is_connector[k], category, limit, outline, half_width)
            lanes.append(Lane(*about, [], [], [], [], lines.heights_of(line)))
        for row in lines.links[np.isin(lines.links[:, 0], indices)].tolist():
            lane, other = lanes[self._lane_index[row[0]]], self._lane_index.get(row[1])
            if other is None:
                continue
            if row[2] == Relation.SUCCESSOR:
                lane.successors.append(other)
            elif row[2] == Relation.PREDECESSOR:
                lane.predecessors.append(other)
            else:
                neighbors = lane.left if row[2] == Relation.LEFT else lane.right
                neighbors.append(Neighbor(other, *row[3:]))
        return lanes


class Observation:
    """Everything that a simulator observes at a plan.

    Arrays are read-only, cover frames 0 to `frame`, and share memory with later observations.

    Attributes:
        scenes: Agents and maps, as in `begin`.
        frame: Latest realised frame, 10 to 89 in the benchmark.
        steps: Number of steps S to plan.
        n_new: Number of frames since the previous plan; all of the history at the first plan.
        states: Realised states, f64 [B, N, frame + 1, 5]: x, y, heading, vx, vy in metres, radians
            and m/s; 0 where absent, NaN velocity where unknown.
        valid: Whether each agent is present, bool [B, N, frame + 1].
        light_states: States of the traffic lights, u8 [K, frame + 1]; see `Light`.
        active: False for episodes that have failed and are only padding, bool [B].
        av_next: State of the AV at frame + 1, f64 [B, 5]; NaN if it is not known.

    """

    def __init__(
        self,
        scenes: Scenes,
        frame: int,
        steps: int,
        n_new: int,
        *,
        states: Array,
        valid: Array,
        light_states: Array,
        active: Array,
        av_next: Array,
    ) -> None:
        self.scenes = scenes
        self.frame = frame
        self.steps = steps
        self.n_new = n_new
        self.states = states
        self.valid = valid
        self.light_states = light_states
        self.active = active
        self.av_next = av_next

    @property
    def episodes(self) -> Array:
        """Handle of each episode, u64 [B]."""
        return self.scenes.episodes

    @property
    def moves_av(self) -> bool:
        """Whether slot 0 of the plan is executed (realism protocol)."""
        return self.scenes.moves_av


class Plan:
    """Future states of all agents, and errors of single episodes.

    `states` is [B, N, S, 3]: x, y, heading after 1 to S steps. `errors` has a text for the index of
    each episode that fails; the other episodes go on.
    """

    def __init__(self, states: Any, errors: Optional[Mapping[int, str]] = None) -> None:
        self.states = states
        self.errors: Dict[int, str] = {int(k): str(v) for k, v in (errors or {}).items()}


class Simulator:
    """Base class of simulators. Any object with a method `plan` will do.

    Attributes:
        name: Name of the simulator; the name of the class by default.
        version: Version of the simulator, for provenance.
        weights_sha256: SHA-256 of the weights, 64 hexadecimal digits, or empty.
        intervals: Replan intervals that are supported, steps; empty for any.
        batch: Number of episodes per batch, 1 to 1024; None leaves it to the program.
        any_length: Whether scenarios of other lengths than 11 frames of history and 80 steps are
            supported; False refuses them.

    """

    name: str = ""
    version: str = ""
    weights_sha256: str = ""
    intervals: Sequence[int] = ()
    batch: Optional[int] = None
    any_length: bool = True

    def begin(self, scenes: Scenes) -> None:
        """Receives the scenes of a new batch of episodes."""

    def plan(self, seen: Observation) -> Union[Array, Plan]:
        """Returns states after 1 to S steps, f64 or f32 [B, N, S, 3], or a `Plan`."""
        raise NotImplementedError("a simulator needs a method `plan`")

    def end(self, episodes: Array) -> None:
        """Is called when the batch is over; `episodes` are handles, u64 [B]."""


class PlannerObservation:
    """Everything that a planner of the AV observes at a plan.

    Arrays are read-only and cover frames 0 to `frame`. Agent 0 is the AV.

    Attributes:
        scene: Agents and map.
        route: All lanes of the route in driving order, parallel ones next to each other, as indices
            in `scene.lanes`; see `route_chain` and `route_beside`.
        memory: The value that `Planner.begin` returned for this episode.
        frame: Present frame, 10 to 89 in the benchmark.
        steps: Number of steps until the next plan.
        states: Realised states, f64 [n, frame + 1, 5]: x, y, heading, vx, vy in metres, radians and
            m/s; 0 where absent, NaN velocity where unknown.
        valid: Whether each agent is present, bool [n, frame + 1].
        light_states: States of the traffic lights `scene.lights`, u8 [K, frame + 1]; see `Light`.
        ego: Present motion of the rear axle of the AV, f64 [7]: velocity along and to the left of
            the heading, m/s, acceleration, m/s^2, steering angle, rad, yaw rate, rad/s, yaw
            acceleration, rad/s^2; None if the program does not send it.

    """

    def __init__(
        self,
        scene: Scene,
        route: List[int],
        memory: Any,
        seen: Observation,
        ego: Optional[Array] = None,
    ) -> None:
        self.scene = scene
        self.route = route
        self.memory = memory
        self.frame = seen.frame
        self.steps = seen.steps
        self.states: Array = seen.states[0]
        self.valid: Array = seen.valid[0]
        self.light_states: Array = seen.light_states
        self.ego = ego

    @property
    def av(self) -> Array:
        """Present state of the AV, f64 [5]: x, y, heading, vx, vy; metres, radians and m/s."""
        state: Array = self.states[0, -1]
        return state

    @property
    def route_chain(self) -> List[int]:
        """Lanes of the route that can be driven in turn, from the one nearest to the AV.

        Indices in `scene.lanes`. Each lane is a successor of the one before it; or it is next to
        it, where the route continues only after a change of lanes. Empty without a route.
        """
        if not self.route:
            return []
        lanes, av = self.scene.lanes, self.av
        start = min(self.route, key=lambda lane: _offset(lanes[lane].points, av))
        return _chain(self.route, start, lanes)

    def route_beside(self, lane: int) -> List[int]:
        """Returns the lanes of the route that are parallel to one of its lanes, nearest first.

        Args:
            lane: Index in `scene.lanes`, as those that are returned.

        """
        return _beside(set(self.route), lane, self.scene.lanes)


def _offset(points: Array, state: Array) -> float:
    """Returns the distance of a state (x, y, heading, ...) from a line of points [P, 2], metres.

    20 m are added if the line turns away from the heading by more than 60 degrees.
    """
    first, along = points[:-1], np.diff(points, axis=0)
    squares = np.maximum(np.einsum("ij,ij->i", along, along), 1e-12)
    shares = np.clip(np.einsum("ij,ij->i", state[:2] - first, along) / squares, 0.0, 1.0)
    distances = np.hypot(*(first + shares[:, None] * along - state[:2]).T)
    nearest = int(np.argmin(distances))
    x, y = along[nearest]
    turns_away = math.cos(math.atan2(y, x) - state[2]) < 0.5
    return float(distances[nearest]) + 20.0 * turns_away


def _beside(route: Set[int], lane: int, lanes: Sequence[Lane]) -> List[int]:
    """Returns the lanes of a route that are linked with a lane as neighbours, nearest first."""
    found = [lane]
    for known in found:
        for neighbor in [*lanes[known].left, *lanes[known].right]:
            if neighbor.lane in route and neighbor.lane not in found:
                found.append(neighbor.lane)
    return found[1:]


def _chain(route: Sequence[int], start: int, lanes: Sequence[Lane]) -> List[int]:
    """Returns the longest chain of lanes of a route from a lane on, with the fewest changes."""
    place: Dict[int, int] = {}
    for lane in route:
        place.setdefault(lane, len(place))
    # Per lane: number of lanes that can follow, changes of lanes (negative), and what is next.
    ahead: Dict[int, Tuple[int, int, List[int]]] = {}
    for lane in reversed(list(place)):
        best: Tuple[int, int, List[int]] = (0, 0, [])
        for here in [lane, *_beside(set(place), lane, lanes)]:
            change = [] if here == lane else [here]
            for after in lanes[here].successors:
                if after in ahead and place[after] > place[here]:
                    count, changes, _ = ahead[after]
                    following = (count + 1, changes - len(change), [*change, after])
                    best = max(best, following, key=lambda choice: choice[:2])
        ahead[lane] = best
    chain = [start]
    while ahead[chain[-1]][2]:
        chain += ahead[chain[-1]][2]
    return chain


class Trajectory:
    """Poses that a planner returns, with the pose of its plan at present.

    `poses` is [P, 3] as `Planner.plan` returns it; `present` is [3]: x, y, heading of the centre of
    the AV, where the AV is by default. A tracker corrects the difference between both.
    """

    def __init__(self, poses: Any, present: Any = None) -> None:
        self.poses = poses
        self.present = present


def most_poses(scene: Scene, frame: int) -> int:
    """Returns the largest number of poses of a plan at a frame."""
    return max(STEPS, scene.n_history + scene.n_steps - 1 - frame)


class Planner:
    """Base class of planners, which drive the AV.

    One planner plans for many episodes at the same time: what it remembers of an episode goes into
    the value that `begin` returns.

    Attributes:
        name: Name of the planner; the name of the class by default.
        version: Version of the planner, for provenance.
        weights_sha256: SHA-256 of the weights, 64 hexadecimal digits, or empty.
        any_length: As of `Simulator`.

    """

    role = "planner"
    name: str = ""
    version: str = ""
    weights_sha256: str = ""
    any_length: bool = True

    def begin(self, scene: Scene) -> Any:
        """Receives the scene of a new episode. The returned value is `memory` at its plans.

        When agents enter or leave, an episode ends and another one continues it, with the agents
        that are present: `scene.scenes.continues` then describes the former, otherwise it is None.
        """

    def plan(self, seen: PlannerObservation) -> Any:
        """Returns poses of the centre of the AV after 1, 2, ... steps, f64 or f32 [P, 3].

        A pose is x, y, heading; P is at least `seen.steps` and at most 80, or the steps that are
        left if they are more. The tracker of the run follows the poses until the next plan. A plan
        that does not begin at the AV is a `Trajectory`.
        """
        raise NotImplementedError("a planner needs a method `plan`")


# --------------------------------------------------------------------------------------------------
# Session.


class _UserError(Exception):
    """A value of the simulator that cannot be used."""


def _array_of(returned: Any, place: str, expected: str) -> Array:
    if returned is None:
        raise _UserError("%s returned None, expected %s" % (place, expected))
    try:
        return as_array(returned)
    except Exception as error:
        text = "%s returned a %s that is no array: %s"
        raise _UserError(text % (place, type(returned).__name__, error)) from error


def _check_type(array: Array, place: str) -> None:
    if array.dtype not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise _UserError("%s returned type %s, expected float64 or float32" % (place, array.dtype))


class _Batch:
    """The open batch: its scenes, and all frames that were received."""

    def __init__(self, scenes: Scenes) -> None:
        self.scenes = scenes
        history, frames = scenes.n_history, scenes.n_history + scenes.n_steps
        self.frame = history - 1
        self.is_first = True
        shape = scenes.kinds.shape
        self.states = np.zeros((*shape, frames, 5))
        self.states[:, :, :history] = scenes.history
        self.valid = np.zeros((*shape, frames), np.bool_)
        self.valid[:, :, :history] = scenes.valid
        self.lights = np.zeros((len(scenes.lights), frames), np.uint8)
        self.lights[:, :history] = scenes.lights.states
        present = np.arange(shape[1]) < scenes.n_agents[:, None]
        if not scenes.moves_av:
            present[:, 0] = False
        self.planned = present
        """Slots whose plan is executed, bool [B, N]."""

    def observe(self, metadata: Mapping[str, str], tensors: Dict[str, Array]) -> Observation:
        """Appends the new frames of a request `plan`."""
        batch, agents = self.planned.shape
        take = _Tensors(tensors)
        if not np.array_equal(take.take("episode", "U64", batch), self.scenes.episodes):
            raise ProtocolError("`plan` names other episodes than `begin`")
        active = take.take("active", "BOOL", batch)
        states = take.take("states", "F64", batch, agents, "T", 5)
        new = states.shape[2]
        valid = take.take("valid", "BOOL", batch, agents, new)
        lights = take.take("light_state", "U8", len(self.scenes.lights), new)
        av_next = take.take("av_next", "F64", batch, 5)
        history, frames = self.scenes.n_history, self.states.shape[2]
        frame = _integer(metadata, "frame", history - 1, frames - 2)
        steps = _integer(metadata, "steps", 1, frames - 1)
        if frame != self.frame + new:
            raise ProtocolError(
                "frame %d does not follow frame %d by %d" % (frame, self.frame, new)
            )
        self.states[:, :, self.frame + 1 : frame + 1] = states
        self.valid[:, :, self.frame + 1 : frame + 1] = valid
        self.lights[:, self.frame + 1 : frame + 1] = lights
        self.frame = frame
        views = {
            "states": self.states[:, :, : frame + 1],
            "valid": self.valid[:, :, : frame + 1],
            "light_states": self.lights[:, : frame + 1],
        }
        for view in views.values():
            view.flags.writeable = False
        n_new = history + new if self.is_first else new
        self.is_first = False
        return Observation(
            self.scenes, frame, steps, n_new, active=active, av_next=av_next, **views
        )

    def check(self, returned: Any, seen: Observation, place: str) -> Plan:
        """Checks the value that `plan` returned.

        States that are not finite become errors of their episodes.
        """
        is_plan = hasattr(returned, "states") and hasattr(returned, "errors")
        plan = returned if is_plan else Plan(returned)
        batch, agents = self.planned.shape
        expected = (batch, agents, seen.steps, 3)
        states = _array_of(plan.states, place, "an array of shape %s" % (expected,))
        if states.shape != expected:
            raise _UserError(
                "%s returned an array of shape %s, expected %s = (episodes, agents, steps, 3)"
                % (place, states.shape, expected)
            )
        _check_type(states, place)
        errors: Dict[int, str] = {int(k): str(v) for k, v in (plan.errors or {}).items()}
        for index in errors:
            if not 0 <= index < batch:
                raise _UserError(
                    "%s returned an error for episode %d of %d" % (place, index, batch)
                )
        with np.errstate(invalid="ignore"):
            bad = ~(np.abs(states[..., :2]) <= MAX_COORDINATE).all(axis=-1) | ~np.isfinite(
                states[..., 2]
            )
        bad &= (self.planned & seen.active[:, None])[:, :, None]
        if bad.any():
            states = np.where(bad[..., None], states.dtype.type(0), states)
            given = as_array(plan.states)
            for index in np.flatnonzero(bad.any(axis=(1, 2))).tolist():
                agent, step = np.argwhere(bad[index])[0].tolist()
                x, y, heading = given[index, agent, step].tolist()
                text = "%s returned x %g, y %g, heading %g for agent %d at step %d of %d: "
                text += "expected finite numbers within 100 km of the origin"
                errors.setdefault(index, text % (place, x, y, heading, agent, step + 1, seen.steps))
        return Plan(states, errors)


class _Drive:
    """An open episode of a planner."""

    def __init__(self, scenes: Scenes, route: List[int], memory: Any) -> None:
        self.batch = _Batch(scenes)
        self.scene = scenes[0]
        self.route = route
        self.memory = memory

    def observe(self, metadata: Mapping[str, str], tensors: Dict[str, Array]) -> PlannerObservation:
        seen = self.batch.observe(metadata, tensors)
        ego = _Tensors(tensors).take("ego", "F64", 1, 7)[0] if "ego" in tensors else None
        return PlannerObservation(self.scene, self.route, self.memory, seen, ego)

    def check(self, returned: Any, steps: int, place: str) -> Dict[str, Array]:
        """Checks what `plan` returned, and returns the tensors of the answer."""
        most = most_poses(self.scene, self.batch.frame)
        is_plan = hasattr(returned, "poses") and hasattr(returned, "present")
        plan = returned if is_plan else Trajectory(returned)
        answer = {"trajectory": self._poses(plan.poses, steps, most, place)[None]}
        if plan.present is not None:
            present = as_array(plan.present)
            if present.shape != (3,):
                text = "%s returned a present pose of shape %s, expected (3,): x, y, heading"
                raise _UserError(text % (place, present.shape))
            answer["present"] = self._poses(present[None], 1, 1, place + " (present pose)")
        return answer

    @staticmethod
    def _poses(returned: Any, steps: int, most: int, place: str) -> Array:
        """Checks poses, and returns them as an array [P, 3]."""
        expected = "an array of shape [%d to %d, 3]" % (steps, most)
        poses = _array_of(returned, place, expected)
        is_shape = poses.ndim == 2 and poses.shape[1] == 3
        if not is_shape or not steps <= poses.shape[0] <= most:
            raise _UserError(
                "%s returned an array of shape %s, expected %s: x, y, heading after each step"
                % (place, poses.shape, expected)
            )
        _check_type(poses, place)
        with np.errstate(invalid="ignore"):
            bad = ~(np.abs(poses) <= MAX_COORDINATE).all(axis=1)
        if bad.any():
            step = int(np.argmax(bad))
            raise _UserError(
                "%s returned x %g, y %g, heading %g for step %d: expected finite numbers within "
                "100 km of the origin" % (place, *poses[step].tolist(), step + 1)
            )
        return poses


class Session:
    """Answers the requests of the program for one simulator or planner."""

    def __init__(
        self,
        simulator: Any,
        *,
        batch: Optional[int] = None,
        on_end: Optional[Callable[[int], None]] = None,
        copies: bool = False,
    ) -> None:
        self.simulator = simulator() if isinstance(simulator, type) else simulator
        self.title = type(self.simulator).__name__
        self.name = getattr(self.simulator, "name", "") or self.title
        self.size = batch
        self.on_end = on_end
        self.batch: Optional[_Batch] = None
        self.drives: Dict[int, _Drive] = {}
        """Open episodes of a planner by handle."""
        self.role = getattr(self.simulator, "role", "simulator")
        self.first_error: Optional[str] = None
        """Text of the first `failed` answer."""
        if not callable(getattr(self.simulator, "plan", None)):
            raise TypeError("%s is no simulator or planner: it has no method `plan`" % self.title)
        # What the simulator remembers of episodes must not get into copies.
        self.source = self._copied(simulator) if copies else simulator

    def copy(self) -> Session:
        """Returns a session of another instance of the simulator, for another open batch.

        It is a new one if a class was given, and a deep copy as of the start (`copies`) otherwise.
        """
        return Session(self._copied(self.source), batch=self.size, on_end=self.on_end)

    def _copied(self, source: Any) -> Any:
        if isinstance(source, type):
            return source
        try:
            return copy.deepcopy(source)
        except Exception as error:
            text = "%s cannot be copied for episodes that begin at another time (%s: %s): "
            text += "give its class, or define `__deepcopy__`"
            raise TypeError(text % (self.title, type(error).__name__, error)) from error

    def run(self, reader: IO[bytes], writer: IO[bytes], frame: Optional[_Frame] = None) -> None:
        """Answers requests until `bye` or the end of the stream; `frame` is already read."""
        frame = frame or read_frame(reader)
        while frame is not None and frame[0]["type"] != "bye":
            try:
                self.respond(frame, writer)
            except BrokenPipeError:
                return
            frame = read_frame(reader)

    def respond(self, frame: _Frame, writer: IO[bytes]) -> Optional[BaseException]:
        """Answers a request; returns the exception of the simulator, if it raised one."""
        metadata, tensors = frame
        raised: Optional[BaseException] = None
        try:
            kind, answer, arrays = self._answer(metadata, tensors)
        except (_UserError, ProtocolError) as error:
            kind, answer, arrays = "failed", {"error": str(error)}, {}
        except (Exception, SystemExit) as error:
            kind, answer, arrays = "failed", {"error": self._trace(error)}, {}
            raised = error
        if kind == "failed":
            answer["error"] = _clean(answer["error"])
            self.first_error = self.first_error or answer["error"]
        # A request can be larger than its answer.
        tensors.clear()
        write_frame(writer, kind, metadata["seq"], answer, arrays)
        return raised

    def _answer(
        self, metadata: Mapping[str, str], tensors: Dict[str, Array]
    ) -> Tuple[str, Dict[str, str], Dict[str, Array]]:
        kind = metadata["type"]
        if metadata["protocol"] != PROTOCOL:
            text = "version %s of the protocol is not supported, only %s"
            raise ProtocolError(text % (metadata["protocol"], PROTOCOL))
        if kind == "hello":
            return "welcome", self._welcome(), {}
        if self.role == "planner":
            return self._drive(kind, metadata, tensors)
        if kind == "begin":
            if self.batch is not None:
                raise ProtocolError("`begin` while a batch is open")
            batch = _Batch(Scenes(metadata, tensors))
            self._call("begin", batch.scenes)
            self.batch = batch
            return "begun", {}, {}
        if kind == "plan":
            if self.batch is None:
                raise ProtocolError("`plan` without `begin`")
            seen = self.batch.observe(metadata, tensors)
            plan = self.batch.check(self.simulator.plan(seen), seen, self.title + ".plan")
            limit = MAX_TEXT // max(len(plan.errors), 1)
            texts = {index: _clean(text, limit) for index, text in plan.errors.items()}
            errors = {"errors": json.dumps(texts)} if texts else {}
            if plan.errors:
                self.first_error = self.first_error or next(iter(plan.errors.values()))
            return "planned", errors, {"states": plan.states}
        if kind == "end":
            is_open, self.batch = self.batch is not None, None
            episodes = _Tensors(tensors).take("episode", "U64", "B")
            if is_open:
                self._call("end", episodes)
            if self.on_end is not None:
                self.on_end(len(episodes))
            return "ended", {}, {}
        raise ProtocolError("unknown request `%s`" % kind)

    def _drive(
        self, kind: str, metadata: Mapping[str, str], tensors: Dict[str, Array]
    ) -> Tuple[str, Dict[str, str], Dict[str, Array]]:
        """Answers a request about one episode of a planner."""
        handle = int(_Tensors(tensors).take("episode", "U64", 1)[0])
        if kind == "begin":
            scenes = Scenes(metadata, tensors)
            route = _Tensors(tensors).take_index("route", len(scenes[0].lanes), 0, "R")
            scenes.continues = self._continued(metadata, tensors)
            begin = getattr(self.simulator, "begin", None)
            memory = begin(scenes[0]) if begin is not None else None
            # Scenes that planners keep would otherwise keep all earlier ones.
            scenes.continues = None
            self.drives[handle] = _Drive(scenes, route.tolist(), memory)
            return "begun", {}, {}
        if kind == "plan":
            if handle not in self.drives:
                raise ProtocolError("`plan` without `begin`")
            drive, place = self.drives[handle], self.title + ".plan"
            seen = drive.observe(metadata, tensors)
            return "planned", {}, drive.check(self.simulator.plan(seen), seen.steps, place)
        if kind == "end":
            if self.drives.pop(handle, None) is not None and self.on_end is not None:
                self.on_end(1)
            return "ended", {}, {}
        raise ProtocolError("unknown request `%s`" % kind)

    def _continued(
        self, metadata: Mapping[str, str], tensors: Dict[str, Array]
    ) -> Optional[Continuation]:
        """Returns the open episode that a new one continues, which is over for the planner."""
        if "continues" not in metadata:
            return None
        text = metadata["continues"]
        before = self.drives.get(int(text)) if text.isdigit() else None
        if before is None:
            raise ProtocolError("metadata `continues` is %r, which is no open episode" % text)
        frame = _integer(metadata, "continued_frame", before.batch.frame, 2 * MAX_STEPS)
        take, agents = _Tensors(tensors), len(tensors["kind"][0])
        slots = take.take_index("continued_slot", before.scene.n_agents, -1, 1, agents)[0]
        del self.drives[int(text)]
        return Continuation(before.memory, frame, slots)

    def _welcome(self) -> Dict[str, str]:
        def text(name: str, default: str = "") -> str:
            value = getattr(self.simulator, name, None) or default
            if not isinstance(value, str):
                raise _UserError("%s.%s is %r, expected text" % (self.title, name, value))
            return _clean(value)

        weights = text("weights_sha256").lower()
        if weights and (len(weights) != 64 or set(weights) - set("0123456789abcdef")):
            raise _UserError(
                "%s.weights_sha256 is %r, expected 64 hex digits" % (self.title, weights)
            )
        intervals = [int(n) for n in getattr(self.simulator, "intervals", None) or ()]
        if not all(1 <= n <= STEPS for n in intervals):
            raise _UserError("%s.intervals is %s, expected 1 to 80 steps" % (self.title, intervals))
        answer = {
            "role": self.role,
            "name": text("name", self.title),
            "version": text("version"),
            "weights_sha256": weights,
            "intervals": json.dumps(intervals),
        }
        if getattr(self.simulator, "any_length", True):
            answer["lengths"] = "any"
        size = self.size if self.size is not None else getattr(self.simulator, "batch", None)
        if size is not None:
            if not 1 <= int(size) <= 1024:
                raise _UserError("%s.batch is %s, expected 1 to 1024" % (self.title, size))
            answer["batch"] = str(int(size))
        return answer

    def _call(self, method: str, argument: Any) -> None:
        function = getattr(self.simulator, method, None)
        if function is not None:
            function(argument)

    def _trace(self, error: BaseException) -> str:
        """Returns the traceback of an error in the simulator, without the frames of this file."""
        frames = error.__traceback__
        while frames is not None and frames.tb_frame.f_code.co_filename == __file__:
            frames = frames.tb_next
        text = "".join(
            traceback.format_exception(type(error), error, frames or error.__traceback__)
        ).strip()
        if isinstance(error, SystemExit):
            text += "\n%s called sys.exit; raise an exception to fail a batch" % self.title
        return text


def _integer(metadata: Mapping[str, str], key: str, least: int, most: int) -> int:
    text = metadata.get(key, "")
    if not text.isdigit() or len(text) > 9 or not least <= int(text) <= most:
        raise ProtocolError("metadata `%s` is %r, expected %d to %d" % (key, text, least, most))
    return int(text)


def _length(metadata: Mapping[str, str]) -> Tuple[int, int]:
    """Returns the numbers of frames of the history and of steps."""
    length = _json_list(metadata, "length", 2)
    if length is None:
        return HISTORY, STEPS
    history, steps = length
    is_whole = type(history) is int and type(steps) is int
    if not is_whole or not (2 <= history <= MAX_HISTORY and 1 <= steps <= MAX_STEPS):
        text = "metadata `length` is %s, expected 2 to %d frames of history and 1 to %d steps"
        raise ProtocolError(text % (length, MAX_HISTORY, MAX_STEPS))
    return history, steps


def _json_list(metadata: Mapping[str, str], key: str, length: int) -> Any:
    if key not in metadata:
        return None
    try:
        value = json.loads(metadata[key])
    except (ValueError, RecursionError) as error:
        raise ProtocolError("metadata `%s` is not valid JSON: %s" % (key, error)) from None
    if not isinstance(value, list) or len(value) != length:
        raise ProtocolError("metadata `%s` is no list of %d elements" % (key, length))
    return value


def _clean(text: str, limit: int = MAX_TEXT) -> str:
    """Returns a text that is valid Unicode, shortened in the middle if it is very long."""
    if len(text) > limit:
        text = text[: limit // 2] + "\n[...]\n" + text[-(limit // 2) :]
    return text.encode("utf-8", "replace").decode("utf-8")


# --------------------------------------------------------------------------------------------------
# Standard streams.

# Name of the attribute of `sys` that holds the claimed streams, shared by all copies of this file.
_CLAIMED = "_reactsim_streams"


def is_served() -> bool:
    """Returns whether the program has started this process for a simulator or planner."""
    return hasattr(sys, _CLAIMED)


def claim_streams() -> Tuple[IO[bytes], IO[bytes]]:
    """Takes standard input and output for the protocol; returns both as binary streams.

    From then on standard output is standard error and standard input is empty, also for libraries
    and child processes, so that nothing but frames reaches the program. Further calls return the
    same streams.
    """
    streams: Optional[Tuple[IO[bytes], IO[bytes]]] = getattr(sys, _CLAIMED, None)
    if streams is None:
        reader = os.fdopen(os.dup(0), "rb", buffering=1 << 16)
        writer = os.fdopen(os.dup(1), "wb", buffering=1 << 16)
        os.dup2(2, 1)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        os.close(nothing)
        # Text that was printed before, and is not yet written, goes to standard error too.
        try:
            sys.stdout.flush()
            sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]
        except (AttributeError, OSError, ValueError):
            pass
        streams = (reader, writer)
        setattr(sys, _CLAIMED, streams)
    return streams


def _chosen(programs: Sequence[Any], hello: Mapping[str, str]) -> Any:
    """Returns the program that is asked: the one of its role, or of several the one of its name."""
    if len(programs) == 1:
        return programs[0]
    role, name = hello.get("role", "simulator"), hello.get("name", "")

    def name_of(program: Any) -> str:
        own = program if isinstance(program, type) else type(program)
        return getattr(program, "name", "") or own.__name__

    fit = [program for program in programs if getattr(program, "role", "simulator") == role]
    if len(fit) != 1:
        fit = [program for program in fit if name_of(program) == name]
    if len(fit) != 1:
        text = "this script has %s, and none or several of them are a %s with the name %s"
        names = ", ".join(name_of(program) for program in programs) or "nothing"
        raise ProtocolError(text % (names, role, name))
    return fit[0]


def serve(*programs: Any) -> None:
    """Answers `reactsim` over standard input and output until the program closes the connection.

    Each of `programs` is a `Simulator` or `Planner`, a class without arguments to make one, or any
    object with the same methods (and, for planners, the attribute `role`). Of several the one
    answers that has the role that is asked for, and of several with this role the one with the name
    NAME of `--external NAME=COMMAND`. Prints go to standard error. An exception in the simulator
    fails the batch with the traceback, and the process goes on.
    """
    if not is_served() and sys.stdin is not None and sys.stdin.isatty():
        text = "this program is a simulator or planner for reactsim; start it with: "
        text += "reactsim run --external 'NAME=%s %s' (planners: --planner)"
        raise SystemExit(text % (os.path.basename(sys.executable), " ".join(sys.argv)))
    reader, writer = claim_streams()
    try:
        hello = read_frame(reader)
        if hello is not None:
            Session(_chosen(programs, hello[0])).run(reader, writer, hello)
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except ProtocolError as error:
        raise SystemExit("reactsim: %s" % error) from None


# The program sets this variable for its child processes; grandchildren must not claim anything.
if os.environ.pop("REACTSIM_EXTERNAL", "") == "1":
    claim_streams()

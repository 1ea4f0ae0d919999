"""Roadblocks of a scene: groups of lanes side by side, as the planners of the program use them.

The lanes of a road of nuPlan's maps begin and end at the same places. Other maps cut every lane for
itself, so lanes are cut here where a lane beside them begins or ends. The rules and constants are
those of `planning_map` of the program, which sends lanes, but no roadblocks.
"""

from __future__ import annotations

import collections
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .client import Array, Lane

__all__ = ["Line", "Part", "parts_of"]

SAME_PLACE = 5.0  # metres: ends of lanes side by side this near to each other are one place
SAME_POINT = 1.75  # metres: lanes whose ends are this near to each other are branches
MAX_DISTANCE = 8.0  # metres between the centre lines of lanes side by side
STEP = 2.0  # metres between points at which two lanes are compared
MAX_POINTS = 64  # largest number of these points
HALF_WIDTH = 1.75  # half-width in metres of a part whose outline is elsewhere than its centre line
MAX_BETWEEN = 30.0  # metres of lanes through which a lane leads to another one
HALVINGS = 40  # of an edge of an outline, to find where it is cut
BIKE = 3  # class of lanes for bicycles only, which are left out


class Line:
    """A polyline with arc lengths."""

    def __init__(self, points: Array) -> None:
        """Takes points [P, 2], metres; repeated ones are dropped.

        Raises ValueError if fewer than two remain.
        """
        moved = np.any(np.diff(points, axis=0) != 0.0, axis=1)
        self.points: Array = points[np.concatenate([[True], moved])] if len(points) else points
        if len(self.points) < 2:
            raise ValueError("a line of a lane has fewer than two distinct points")
        self.steps: Array = np.diff(self.points, axis=0)
        lengths = np.hypot(self.steps[:, 0], self.steps[:, 1])
        self.arc: Array = np.concatenate([[0.0], np.cumsum(lengths)])

    @property
    def length(self) -> float:
        """Length, metres."""
        return float(self.arc[-1])

    def at(self, s: float) -> Array:
        """Returns the point at an arc length in metres; the ends are extrapolated."""
        k = int(np.clip(np.searchsorted(self.arc, s, side="right"), 1, len(self.steps))) - 1
        share = (s - self.arc[k]) / (self.arc[k + 1] - self.arc[k])
        point: Array = self.points[k] + self.steps[k] * share
        return point

    def project(self, point: Array) -> tuple[float, float, int]:
        """Returns arc length and distance in metres of the nearest point, and its segment."""
        ahead = point - self.points[:-1]
        squares = (self.steps**2).sum(axis=1)
        share = np.clip((ahead * self.steps).sum(axis=1) / squares, 0.0, 1.0)
        distances = ((ahead - share[:, None] * self.steps) ** 2).sum(axis=1)
        k = int(np.argmin(distances))
        s = self.arc[k] + share[k] * (self.arc[k + 1] - self.arc[k])
        return float(s), math.sqrt(distances[k]), k

    def part(self, start: float, end: float) -> Line:
        """Returns the part between two arc lengths, metres."""
        inner = self.points[(start < self.arc) & (self.arc < end)]
        return Line(np.concatenate([[self.at(start)], inner, [self.at(end)]]))


@dataclasses.dataclass
class Part:
    """A lane, or the part of a lane that is cut."""

    lane: int
    """Index in `Scene.lanes`."""
    line: Line
    """Centre line."""
    is_connector: bool
    speed_limit: float
    """Speed limit, m/s; NaN if unknown."""
    outline: Array | None
    """Outline [P, 2], metres; None for a corridor of `half_width`."""
    half_width: float
    """Half-width of the corridor, metres."""
    successors: list[int] = dataclasses.field(default_factory=list)
    """Indices of parts."""
    predecessors: list[int] = dataclasses.field(default_factory=list)
    """Indices of parts."""
    block: int = -1
    """Index of the roadblock; numbers are in the order of their first lanes."""


def parts_of(lanes: Sequence[Lane]) -> list[Part]:
    """Returns the lanes of a scene, cut where lanes beside them are, with their roadblocks.

    Lanes for bicycles only are left out. The parts of a lane follow one another.

    Raises ValueError if a centre line has no length.
    """
    kept = [lane for lane in lanes if lane.category != BIKE]
    place = {lane.index: k for k, lane in enumerate(kept)}
    lines = [Line(lane.points) for lane in kept]
    beside = _neighbors(kept, lines, place)
    cuts = _cuts(lines, beside)
    firsts = np.cumsum([0] + [len(cut) + 1 for cut in cuts]).tolist()
    parts: list[Part] = []
    for k, lane in enumerate(kept):
        for i in range(len(cuts[k]) + 1):
            part, index = _part(lane, lines[k], cuts[k], i), len(parts)
            before = [firsts[place[p] + 1] - 1 for p in lane.predecessors if p in place]
            after = [firsts[place[p]] for p in lane.successors if p in place]
            part.predecessors = before if i == 0 else [index - 1]
            part.successors = after if i == len(cuts[k]) else [index + 1]
            parts.append(part)
    pairs: list[tuple[float, int, int]] = []
    for a, b in sorted(beside):
        for i in range(firsts[a], firsts[a + 1]):
            for j in range(firsts[b], firsts[b + 1]):
                short, long = parts[i].line, parts[j].line
                if short.length > long.length:
                    short, long = long, short
                share = _shared(short, long)
                if share > 0.5:
                    pairs.append((-share * _parallelism(short, long), i, j))
    _number(parts, sorted(pairs))
    return parts


def _branch(a: Line, b: Line) -> bool:
    ends = [a.points[0] - b.points[0], a.points[-1] - b.points[-1]]
    return any(math.hypot(*end) < SAME_POINT for end in ends)


def _neighbors(lanes: list[Lane], lines: list[Line], place: dict[int, int]) -> set[tuple[int, int]]:
    """Returns pairs of lanes side by side; where there are other lanes, connectors have none."""
    has_lanes = any(not lane.is_connector for lane in lanes)
    pairs = {
        (min(a, place[other.lane]), max(a, place[other.lane]))
        for a, lane in enumerate(lanes)
        for other in [*lane.left, *lane.right]
        if other.lane in place and place[other.lane] != a
    }
    return {
        (a, b)
        for a, b in pairs
        if not (has_lanes and (lanes[a].is_connector or lanes[b].is_connector))
        and not _branch(lines[a], lines[b])
    }


def _cuts(lines: list[Line], beside: set[tuple[int, int]]) -> list[list[float]]:
    """Returns the arc lengths at which each lane is cut."""
    cuts: list[list[float]] = [[] for _ in lines]
    ordered = sorted(beside)
    changes = True
    while changes:
        changes = False
        for pair in ordered:
            for lane, other in (pair, pair[::-1]):
                line = lines[lane]
                for s in [0.0, lines[other].length, *cuts[other]]:
                    at, distance, _ = line.project(lines[other].at(s))
                    near = [0.0, line.length, *cuts[lane]]
                    if distance <= MAX_DISTANCE and all(abs(at - n) >= SAME_PLACE for n in near):
                        cuts[lane] = sorted([*cuts[lane], at])
                        changes = True
    return cuts


def _part(lane: Lane, line: Line, cuts: list[float], k: int) -> Part:
    about = (lane.is_connector, lane.speed_limit)
    if not cuts:
        return Part(lane.index, line, *about, lane.outline, lane.half_width)
    bounds = [0.0, *cuts, line.length]
    start, end = bounds[k], bounds[k + 1]
    if lane.outline is None:
        return Part(lane.index, line.part(start, end), *about, None, lane.half_width)
    ring = lane.outline
    if k > 0:
        ring = _clipped(ring, lambda p: line.project(p)[0] - start)
    if k < len(cuts):
        ring = _clipped(ring, lambda p: end - line.project(p)[0])
    outline = ring if len(ring) >= 3 else None
    return Part(lane.index, line.part(start, end), *about, outline, HALF_WIDTH)


def _clipped(ring: Array, inside: Callable[[Array], float]) -> Array:
    """Returns the part of a ring where `inside` is positive (Sutherland and Hodgman)."""
    kept: list[Array] = []
    for before, point in zip(np.roll(ring, 1, axis=0), ring):
        begins, ends = inside(before) > 0.0, inside(point) > 0.0
        if begins != ends:
            a, b = before, point
            for _ in range(HALVINGS):
                middle = (a + b) * 0.5
                a, b = (middle, b) if (inside(middle) > 0.0) == begins else (a, middle)
            kept.append((a + b) * 0.5)
        if ends:
            kept.append(point)
    return np.array(kept).reshape(-1, 2)


def _shared(short: Line, long: Line) -> float:
    """Returns the share of the shorter line that is beside the other one, in its direction."""
    count = int(np.clip(math.ceil(short.length / STEP), 4, MAX_POINTS))
    found = 0
    for i in range(count):
        s = (i + 0.5) / count * short.length
        at, distance, k = long.project(short.at(s))
        own = int(np.clip(np.searchsorted(short.arc, s, side="right"), 1, len(short.steps))) - 1
        along = float(short.steps[own] @ long.steps[k])
        found += distance <= MAX_DISTANCE and 0.0 < at < long.length and along > 0.0
    return found / count


def _parallelism(short: Line, long: Line) -> float:
    """Returns how well a line begins and ends with a longer one and keeps its distance, 0 to 1."""
    spread = abs(long.project(short.at(0.0))[1] - long.project(short.at(short.length))[1])
    return short.length / long.length * (1.0 - min(spread / MAX_DISTANCE, 1.0))


def _led_to(parts: list[Part], start: int) -> set[int]:
    """Returns the parts to which one leads, directly or through other ones."""
    found: set[int] = set()
    open_ = collections.deque([(start, 0.0)])
    while open_:
        part, way = open_.popleft()
        for following in parts[part].successors:
            if following not in found:
                found.add(following)
                further = way + parts[following].line.length
                if further <= MAX_BETWEEN:
                    open_.append((following, further))
    return found


def _number(parts: list[Part], pairs: list[tuple[float, int, int]]) -> None:
    """Sets the roadblocks. The most parallel pairs are joined first."""
    has_lanes = any(not part.is_connector for part in parts)
    led = [_led_to(parts, k) for k in range(len(parts))]
    group = list(range(len(parts)))
    members = {k: [k] for k in group}

    def excludes(a: int, b: int) -> bool:
        return b in led[a] or a in led[b] or _branch(parts[a].line, parts[b].line)

    for _, i, j in pairs:
        a, b = sorted((group[i], group[j]))
        if a != b and not any(excludes(p, q) for p in members[a] for q in members[b]):
            for joined in members[b]:
                group[joined] = a
            members[a] += members.pop(b)

    # Connectors between the same groups are one.
    first: dict[Any, int] = {}

    def ends(links: list[int]) -> frozenset[tuple[bool, int]]:
        single = [has_lanes and parts[link].is_connector for link in links]
        return frozenset((s, link if s else group[link]) for s, link in zip(single, links))

    chosen = list(group)
    for k, part in enumerate(parts):
        if has_lanes and part.is_connector:
            both = (ends(part.predecessors), ends(part.successors))
            chosen[k] = first.setdefault(both, k) if all(both) else k
    numbers = {first_part: number for number, first_part in enumerate(sorted(set(chosen)))}
    for part, representative in zip(parts, chosen):
        part.block = numbers[representative]

"""A map of nuPlan's devkit on the map of a scene. Importing this module imports the devkit."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import shapely
from nuplan.common.actor_state.state_representation import StateSE2
from nuplan.common.maps import abstract_map_objects as objects
from nuplan.common.maps.abstract_map import AbstractMap
from nuplan.common.maps.maps_datatypes import (
    IntersectionType,
    LaneConnectorType,
    SemanticMapLayer,
    StopLineType,
)
from shapely.geometry import LineString, Point, Polygon
from shapely.ops import unary_union
from shapely.strtree import STRtree

from .client import Array, Scene
from .roadblocks import Line, Part, parts_of

__all__ = ["SceneMap"]

STATE_SPACING = 1.0  # metres: longer segments of a centre line are divided, as in `pdm-closed`
HEADING_DISTANCE = 0.5  # metres between the points that give the heading of a pose on a line
CURVATURE_DISTANCE = 2.0  # metres between the points that give the curvature of a line
STRAIGHT = 1e-6  # 16 times the squared area of a triangle, m⁴, below which its points are aligned
END_DISTANCE = 5.0  # metres: largest distance from the ends of a centre line to the outline
TURN = math.pi / 8  # radians of heading above which a connector turns
U_TURN = math.pi * 3 / 4  # radians of heading above which a connector is a U-turn
STOP_LINE_WIDTH = 0.2  # metres: stop lines are recorded without width, and nuPlan's are polygons

# First ids of the kinds of objects. All ids have six digits and are unique, since planners of
# nuPlan look for ids within ids.
LANES, BLOCKS, STOP_LINES, INTERSECTIONS, CROSSWALKS, LINES = range(100_000, 700_000, 100_000)

_LAYER = SemanticMapLayer
_STOPS = {0: StopLineType.TRAFFIC_LIGHT, 1: StopLineType.STOP_SIGN, 2: StopLineType.YIELD}


def _unknown(what: str, where: str) -> NotImplementedError:
    return NotImplementedError(
        f"{what} of {where} is unknown: the scene does not record it, nor does the map of nuPlan's"
        " devkit in most cases; pass the maps of nuPlan as `maps`, or change the planner"
    )


class _Polyline(objects.PolylineMapObject):
    """A centre line, or a side of a lane."""

    def __init__(self, id_: str, points: Array) -> None:
        super().__init__(id_)
        self._points = points

    @cached_property
    def linestring(self) -> LineString:
        return LineString(self._points)

    @property
    def length(self) -> float:
        return float(self.linestring.length)

    @cached_property
    def discrete_path(self) -> list[Any]:
        steps = np.diff(self._points, axis=0)
        headings = np.arctan2(steps[:, 1], steps[:, 0])
        poses = zip(self._points.tolist(), [*headings.tolist(), float(headings[-1])])
        return [StateSE2(x, y, heading) for (x, y), heading in poses]

    def get_nearest_arc_length_from_position(self, point: Any) -> float:
        return float(self.linestring.project(Point(point.x, point.y)))

    def get_nearest_pose_from_position(self, point: Any) -> Any:
        s = self.get_nearest_arc_length_from_position(point)
        at, ahead = self._at(s), self._at(s + HEADING_DISTANCE)
        direction = ahead - at
        if not direction.any():
            direction = at - self._at(max(s - HEADING_DISTANCE, 0.0))
        return StateSE2(at[0], at[1], math.atan2(direction[1], direction[0]))

    def get_curvature_at_arc_length(self, arc_length: float) -> float:
        if not 0.0 <= arc_length <= self.length:
            raise ValueError(
                f"arc length {arc_length} m is not on line {self.id}, 0 to {self.length} m"
            )
        step = min(CURVATURE_DISTANCE, self.length / 2)
        middle = min(max(arc_length, step), self.length - step)
        a, b, c = (self._at(s) for s in (middle - step, middle, middle + step))
        area = float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
        sides = math.dist(a, b) * math.dist(b, c) * math.dist(c, a)
        return 0.0 if 4.0 * area**2 < STRAIGHT or sides == 0.0 else 2.0 * area / sides

    def _at(self, s: float) -> Array:
        point = self.linestring.interpolate(s)
        return np.array([point.x, point.y])


class _Edge:
    """What lanes and connectors share: a part of a lane of the scene."""

    def _take(self, scene_map: SceneMap, index: int, part: Part) -> None:
        self._map, self._index, self._part = scene_map, index, part
        self._name = str(LANES + index)

    @cached_property
    def polygon(self) -> Polygon:
        part = self._part
        if part.outline is not None:
            return _polygon(part.outline)
        return LineString(part.line.points).buffer(part.half_width, cap_style=2)

    @cached_property
    def baseline_path(self) -> Any:
        return _Polyline(str(LINES + 3 * self._index), _states(self._part.line.points))

    @cached_property
    def incoming_edges(self) -> list[Any]:
        return [self._map.edges[k] for k in self._part.predecessors]

    @cached_property
    def outgoing_edges(self) -> list[Any]:
        return [self._map.edges[k] for k in self._part.successors]

    @property
    def parallel_edges(self) -> list[Any]:
        edges: list[Any] = self.parent.interior_edges
        return edges

    @property
    def parent(self) -> Any:
        return self._map.blocks[self._part.block]

    def get_roadblock_id(self) -> str:
        return str(BLOCKS + self._part.block)

    @property
    def speed_limit_mps(self) -> float | None:
        limit = self._part.speed_limit
        return None if math.isnan(limit) else limit

    @cached_property
    def left_boundary(self) -> Any:
        return self._side(1.0)

    @cached_property
    def right_boundary(self) -> Any:
        return self._side(-1.0)

    def _side(self, sign: float) -> Any:
        """Returns a side of the ground of the lane: left for 1, right for -1."""
        line, outline = self._part.line, self._part.outline
        if outline is None:
            steps = np.concatenate([line.steps, line.steps[-1:]])
            lengths = np.hypot(steps[:, 0], steps[:, 1])[:, None]
            across = np.stack([-steps[:, 1], steps[:, 0]], axis=1) / lengths
            side = line.points + sign * self._part.half_width * across
        else:
            side = _side_of(outline, line, sign)
        if len(side) < 2:
            raise _unknown(f"the {'left' if sign > 0 else 'right'} side", f"lane {self._name}")
        number = 1 if sign > 0 else 2
        return _Polyline(str(LINES + 3 * self._index + number), _states(side))

    def has_traffic_lights(self) -> bool:
        return self._part.lane in self._map.lights

    @cached_property
    def stop_lines(self) -> list[Any]:
        return [line for line in self._map.stop_lines if line.edge is self]

    def is_left_of(self, other: Any) -> bool:
        assert self.get_roadblock_id() == other.get_roadblock_id(), "lanes of different roadblocks"
        return bool(self.index < other.index)

    def is_right_of(self, other: Any) -> bool:
        assert self.get_roadblock_id() == other.get_roadblock_id(), "lanes of different roadblocks"
        return bool(self.index > other.index)

    @cached_property
    def index(self) -> int:
        """Position in the roadblock from the left, from 0."""
        return self._map.from_left(self._part.block).index(self)

    @property
    def adjacent_edges(self) -> tuple[Any, Any]:
        row = self._map.from_left(self._part.block)
        k = row.index(self)
        return (row[k - 1] if k > 0 else None), (row[k + 1] if k + 1 < len(row) else None)

    def get_width_left_right(
        self, point: Any, include_outside: bool = False
    ) -> tuple[float | None, float | None]:
        raise _unknown("the width at a point", f"lane {self._name}")

    def oriented_distance(self, point: Any) -> float:
        raise _unknown("the oriented distance", f"lane {self._name}")


class _Lane(_Edge, objects.Lane):
    """A lane between junctions."""


class _Connector(_Edge, objects.LaneConnector):
    """A lane through a junction."""

    @property
    def adjacent_edges(self) -> tuple[Any, Any]:
        return None, None

    @property
    def turn_type(self) -> Any:
        path = self.baseline_path.discrete_path
        turn = math.remainder(path[-1].heading - path[0].heading, math.tau)
        if abs(turn) > U_TURN:
            return LaneConnectorType.UTURN
        if abs(turn) < TURN:
            return LaneConnectorType.STRAIGHT
        return LaneConnectorType.LEFT if turn > 0.0 else LaneConnectorType.RIGHT


class _RoadBlock(objects.RoadBlockGraphEdgeMapObject):
    """A group of lanes side by side, or of connectors between the same two groups."""

    def __init__(self, scene_map: SceneMap, index: int, edges: list[Any]) -> None:
        super().__init__(str(BLOCKS + index))
        self._map, self._index, self._edges = scene_map, index, edges

    @property
    def interior_edges(self) -> list[Any]:
        return self._edges

    @cached_property
    def polygon(self) -> Any:
        return unary_union([shapely.make_valid(edge.polygon) for edge in self._edges])

    @cached_property
    def incoming_edges(self) -> list[Any]:
        return self._linked(edge for own in self._edges for edge in own.incoming_edges)

    @cached_property
    def outgoing_edges(self) -> list[Any]:
        return self._linked(edge for own in self._edges for edge in own.outgoing_edges)

    def _linked(self, edges: Iterable[Any]) -> list[Any]:
        blocks = {edge._part.block for edge in edges} - {self._index}
        return [self._map.blocks[block] for block in sorted(blocks)]

    @property
    def parallel_edges(self) -> list[Any]:
        return [self]

    @cached_property
    def children_stop_lines(self) -> list[Any]:
        return [line for edge in self._edges for line in edge.stop_lines]

    @property
    def intersection(self) -> Any:
        for junction in self._map.layers[_LAYER.INTERSECTION]:
            if junction.polygon.intersects(self.polygon):
                return junction
        return None


class _RoadBlockConnector(_RoadBlock):
    """A roadblock of connectors."""


# Planners, such as those of tuplan_garage, cut their route where it crosses itself. They recognise
# the connectors by the name of the class in the devkit. Where all lanes are connectors and overlap
# one another, the rule would cut every route, so that only maps with other lanes have the name.
_JunctionBlock = type("NuPlanRoadBlockConnector", (_RoadBlockConnector,), {})


class _StopLine(objects.StopLine):
    """A stop line."""

    def __init__(self, index: int, kind: Any, points: Array, edge: Any) -> None:
        super().__init__(str(STOP_LINES + index), kind)
        self._points, self.edge = points, edge

    @cached_property
    def polygon(self) -> Polygon:
        return LineString(self._points).buffer(STOP_LINE_WIDTH / 2, cap_style=2)

    @property
    def layer_type(self) -> Any:
        return self.stop_line_type

    @property
    def parent(self) -> Any:
        return self.edge.parent

    @property
    def intersection_from(self) -> Any:
        raise _unknown("the intersection", f"stop line {self.id}")


class _Intersection(objects.Intersection):
    """The outline of a junction."""

    def __init__(self, index: int, outline: Array, scene_map: SceneMap) -> None:
        super().__init__(str(INTERSECTIONS + index), IntersectionType.DEFAULT)
        self._map = scene_map
        self.polygon = _polygon(outline)

    polygon: Polygon = None

    @cached_property
    def interior_edges(self) -> list[Any]:
        blocks = self._map.layers[_LAYER.ROADBLOCK_CONNECTOR]
        return [block for block in blocks if block.intersection is self]

    @cached_property
    def incoming_edges(self) -> list[Any]:
        own = [e for block in self.interior_edges for e in block.interior_edges]
        return list(dict.fromkeys(e for edge in own for e in edge.incoming_edges))

    @property
    def is_signaled(self) -> bool:
        return any(e.has_traffic_lights() for b in self.interior_edges for e in b.interior_edges)


class _Crosswalk(objects.PolygonMapObject):
    """A crosswalk."""

    def __init__(self, index: int, outline: Array) -> None:
        super().__init__(str(CROSSWALKS + index))
        self.polygon = _polygon(outline)

    polygon: Polygon = None


class SceneMap(AbstractMap):
    """The map of a scene, in the coordinates of the scene, with the queries of nuPlan's devkit.

    - Lanes are cut and grouped into roadblocks as for the planners of the program; a lane with a
      light counts as a connector if its id is looked up, since planners expect lights there.
    - Without outlines of junctions, an intersection is where a connector is; in maps of connectors
      only, nowhere, as `planner:pdm-closed` has it.
    - Sides of lanes are where the ground of the lane ends across its centre line. Stop lines are
      0.2 m wide. Car parks and walkways are not recorded: these layers are empty.

    Raises ValueError if a line or an outline of the scene has no extent. Queries raise ValueError
    for layers that the scene does not have, such as raster layers, and NotImplementedError for
    properties that it does not have.
    """

    def __init__(self, scene: Scene) -> None:
        self.parts = parts_of(scene.lanes)
        """Lanes of the map with the lanes of the scene that they are cut from."""
        self.lights = set(scene.lights.lane.tolist())
        """Lanes of the scene with a light."""
        self._scene = scene
        has_lanes = any(not part.is_connector for part in self.parts)
        self.edges: list[Any] = []
        """Lanes and connectors, in the order of `parts`."""
        for k, part in enumerate(self.parts):
            edge: Any = (_Connector if part.is_connector else _Lane)(str(LANES + k))
            edge._take(self, k, part)
            self.edges.append(edge)
        members: dict[int, list[Any]] = {}
        for edge, part in zip(self.edges, self.parts):
            members.setdefault(part.block, []).append(edge)
        self.blocks: list[Any] = []
        """Roadblocks, in the order of their first lanes."""
        for k in sorted(members):
            is_junction = isinstance(members[k][0], objects.LaneConnector)
            junction = _JunctionBlock if has_lanes else _RoadBlockConnector
            self.blocks.append((junction if is_junction else _RoadBlock)(self, k, members[k]))
        self.stop_lines: list[Any] = []
        """Stop lines."""
        for line in scene.stop_lines:
            edge = self._edge_of(line.lane, line.points.mean(axis=0))
            if edge is not None:
                kind = _STOPS[line.category]
                self.stop_lines.append(_StopLine(len(self.stop_lines), kind, line.points, edge))
        junctions = [line.points for line in scene.junctions]
        walks = [line.points for line in scene.crosswalks]
        lanes, connectors = _divided(self.edges, _Connector)
        blocks, block_connectors = _divided(self.blocks, _RoadBlockConnector)
        self.layers: dict[Any, list[Any]] = {
            _LAYER.LANE: lanes,
            _LAYER.LANE_CONNECTOR: connectors,
            _LAYER.ROADBLOCK: blocks,
            _LAYER.ROADBLOCK_CONNECTOR: block_connectors,
            _LAYER.STOP_LINE: self.stop_lines,
            _LAYER.CROSSWALK: [_Crosswalk(k, points) for k, points in enumerate(walks)],
            _LAYER.INTERSECTION: [_Intersection(k, p, self) for k, p in enumerate(junctions)],
            _LAYER.WALKWAYS: [],
            _LAYER.CARPARK_AREA: [],
        }
        self._has_lanes = has_lanes
        self._by_id = {layer: {o.id: o for o in found} for layer, found in self.layers.items()}
        self._trees: dict[Any, STRtree] = {}

    def from_left(self, block: int) -> list[Any]:
        """Returns the lanes of a roadblock from left to right."""
        edges = self.blocks[block].interior_edges
        line = edges[0]._part.line
        middle, at = line.at(line.length / 2), []
        ahead = line.at(line.length / 2 + 0.1) - middle
        for edge in edges:
            other = edge._part.line
            offset = other.at(other.project(middle)[0]) - middle
            at.append(float(ahead[1] * offset[0] - ahead[0] * offset[1]))
        return [edges[k] for k in np.argsort(at, kind="stable")]

    def _edge_of(self, lane: int, point: Array) -> Any:
        """Returns the edge of a lane of the scene that is nearest to a point; None without one."""
        edges = [e for e, part in zip(self.edges, self.parts) if part.lane == lane]
        return min(edges, key=lambda e: e._part.line.project(point)[1], default=None)

    @property
    def map_name(self) -> str:
        """Name of a map that belongs to one scene."""
        return "reactsim-scene"

    def initialize_all_layers(self) -> None:
        """Does nothing: all layers are in memory."""

    def get_available_map_objects(self) -> list[Any]:
        """Returns the layers whose objects can be queried."""
        return list(self.layers)

    def get_available_raster_layers(self) -> list[Any]:
        """Returns an empty list: scenes have no raster layers."""
        return []

    def get_raster_map_layer(self, layer: Any) -> Any:
        """Raises ValueError: scenes have no raster layers."""
        raise ValueError(
            f"raster layer {layer.name}: scenes have no raster layers; pass the maps of nuPlan as"
            " `maps`"
        )

    def get_raster_map(self, layers: Sequence[Any]) -> Any:
        """Raises ValueError: scenes have no raster layers."""
        return [self.get_raster_map_layer(layer) for layer in layers]

    def get_distance_to_nearest_raster_layer(self, point: Any, layer: Any) -> float:
        """Raises ValueError: scenes have no raster layers."""
        raise self.get_raster_map_layer(layer)

    def get_all_map_objects(self, point: Any, layer: Any) -> list[Any]:
        """Returns the objects of a layer whose polygons contain a point, in map order."""
        objects_of = self._objects(layer)
        at = Point(point.x, point.y)
        near = sorted(self._tree(layer).query(at).tolist()) if objects_of else []
        return [objects_of[k] for k in near if objects_of[k].polygon.contains(at)]

    def get_one_map_object(self, point: Any, layer: Any) -> Any:
        """Returns the object of a layer at a point, or None.

        Raises AssertionError if there are several.
        """
        found = self.get_all_map_objects(point, layer)
        assert len(found) <= 1, f"{len(found)} objects of {layer.name} at ({point.x}, {point.y})"
        return found[0] if found else None

    def is_in_layer(self, point: Any, layer: Any) -> bool:
        """Returns whether a polygon of a layer contains a point."""
        if layer == _LAYER.DRIVABLE_AREA:
            at = Point(point.x, point.y)
            return any(area.contains(at) for area in self._drivable)
        if layer == _LAYER.INTERSECTION and not self.layers[_LAYER.INTERSECTION]:
            connectors = self._has_lanes and _LAYER.LANE_CONNECTOR
            return bool(connectors and self.get_all_map_objects(point, connectors))
        return bool(self.get_all_map_objects(point, layer))

    def get_proximal_map_objects(
        self, point: Any, radius: float, layers: Sequence[Any]
    ) -> dict[Any, list[Any]]:
        """Returns the objects of layers that intersect the square of half side `radius`, metres."""
        missing = [layer for layer in layers if layer not in self.layers]
        assert not missing, f"Object representation for layer(s): {missing} is unavailable"
        square = shapely.box(point.x - radius, point.y - radius, point.x + radius, point.y + radius)
        found = {}
        for layer in layers:
            objects_of = self._objects(layer)
            near = sorted(self._tree(layer).query(square).tolist()) if objects_of else []
            found[layer] = [objects_of[k] for k in near if objects_of[k].polygon.intersects(square)]
        return found

    def get_map_object(self, object_id: str, layer: Any) -> Any:
        """Returns the object of a layer with this id, or None."""
        self._objects(layer)
        found = self._by_id[layer].get(str(object_id))
        if found is None and layer == _LAYER.LANE_CONNECTOR:
            lane = self._by_id[_LAYER.LANE].get(str(object_id))
            found = lane if lane is not None and lane.has_traffic_lights() else None
        return found

    def get_distance_to_nearest_map_object(
        self, point: Any, layer: Any
    ) -> tuple[str | None, float | None]:
        """Returns the id of the nearest object of a layer, and its distance in metres."""
        objects_of = self._objects(layer)
        if not objects_of:
            return None, None
        at = Point(point.x, point.y)
        nearest = min(objects_of, key=lambda found: found.polygon.distance(at))
        return nearest.id, float(nearest.polygon.distance(at))

    def get_distances_matrix_to_nearest_map_object(
        self, points: Sequence[Any], layer: Any
    ) -> Array | None:
        """Returns the distance of each point to the nearest polygon of a layer, metres [n]."""
        areas = (
            self._drivable
            if layer == _LAYER.DRIVABLE_AREA
            else [found.polygon for found in self._objects(layer)]
        )
        if not areas:
            return None
        at = [Point(point.x, point.y) for point in points]
        return np.array([min(area.distance(p) for area in areas) for p in at])

    # Planners of tuplan_garage call these two methods of the devkit's map.

    def _get_roadblock(self, object_id: str) -> Any:
        return self.get_map_object(object_id, _LAYER.ROADBLOCK)

    def _get_roadblock_connector(self, object_id: str) -> Any:
        return self.get_map_object(object_id, _LAYER.ROADBLOCK_CONNECTOR)

    def _objects(self, layer: Any) -> list[Any]:
        if layer not in self.layers:
            raise ValueError(f"Object representation for layer: {layer.name} is unavailable")
        return self.layers[layer]

    def _tree(self, layer: Any) -> STRtree:
        if layer not in self._trees:
            self._trees[layer] = STRtree([found.polygon for found in self.layers[layer]])
        return self._trees[layer]

    @cached_property
    def _drivable(self) -> list[Any]:
        rings = self._scene.drivable_areas
        if not rings:
            raise ValueError(
                "layer DRIVABLE_AREA: the scene has no drivable polygons, as in maps with road"
                " edges; pass the maps of nuPlan as `maps`, or use the polygons of lanes"
            )
        return [Polygon(outer, holes) for outer, *holes in rings]


def _divided(found: list[Any], kind: type) -> tuple[list[Any], list[Any]]:
    """Returns the objects that are not of a kind, and those that are."""
    others = [one for one in found if not isinstance(one, kind)]
    return others, [one for one in found if isinstance(one, kind)]


def _side_of(outline: Array, line: Line, sign: float) -> Array:
    """Returns the points of an outline on one side of a centre line, in driving direction.

    The sides meet where the outline is nearest to the ends of the centre line. Returns no points if
    it is not near.
    """
    following = np.roll(outline, -1, axis=0)
    area = (outline[:, 0] * following[:, 1] - outline[:, 1] * following[:, 0]).sum()
    ring = outline if area > 0.0 else outline[::-1]
    closed = Line(np.concatenate([ring, ring[:1]]))
    (start, near, _), (end, far, _) = (closed.project(line.points[k]) for k in (0, -1))
    if max(near, far) > END_DISTANCE:
        return np.empty((0, 2))
    # Counter-clockwise, the right side leads from the start to the end.
    first, last = (end, start) if sign > 0 else (start, end)
    length = closed.length
    after = (closed.arc[:-1] - first) % length
    kept = np.flatnonzero((after > 0.0) & (after < (last - first) % length))
    side: Array = closed.points[kept[np.argsort(after[kept])]]
    return side[::-1] if sign > 0 else side


def _states(points: Array) -> Array:
    """Returns a line with a point at least every metre, as the program has it for planners."""
    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    states: list[Array] = []
    for point, step, length in zip(points, steps, lengths.tolist()):
        if length > 0.0:
            count = max(math.ceil(length / STATE_SPACING - 1e-6), 1)
            states += [point + step * (STATE_SPACING / length * k) for k in range(count)]
    return np.array([*states, points[-1]])


def _polygon(outline: Array) -> Any:
    """Returns the polygon of an outline, as recorded: a few outlines of nuPlan cross themselves."""
    if len(np.unique(outline, axis=0)) < 3:
        raise ValueError("an outline of the map has fewer than three points")
    return Polygon(outline)

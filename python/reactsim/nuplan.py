"""Planners of nuPlan's devkit as planners of the AV.

    from reactsim.nuplan import wrap

    results = reactsim.run(planner=wrap(MyPlanner), baselines=["nuplan-idm", "idm"])

The devkit is imported when `wrap` is called.
"""

from __future__ import annotations

import copy
import dataclasses
import importlib
import math
import re
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np

from .client import (
    DT,
    Array,
    Continuation,
    Kind,
    Light,
    Planner,
    PlannerObservation,
    Scene,
    Trajectory,
    most_poses,
)

__all__ = ["LOCATIONS", "wrap"]

LOCATIONS = (
    "sg-one-north",
    "us-ma-boston",
    "us-nv-las-vegas-strip",
    "us-pa-pittsburgh-hazelwood",
)
"""Names of nuPlan's maps, in the order in which a map factory is asked for them."""

BUFFER = 22  # samples of a full history: 2 s and the present, and one more, as in the devkit
STEP_US = 100_000  # microseconds between two frames
LATE_US = 1_000  # microseconds by which times of planners may be rounded
SAME_LANE = 1.0  # metres between the centre lines of a lane of the scene and that of nuPlan's map
STANDSTILL = 0.5  # m/s: slower vehicles have no steering angle that their motion reveals

_ROOT = "nuplan.common.actor_state"
_DEVKIT = {
    "EgoState": f"{_ROOT}.ego_state",
    "StateSE2": f"{_ROOT}.state_representation",
    "StateVector2D": f"{_ROOT}.state_representation",
    "Point2D": f"{_ROOT}.state_representation",
    "TimePoint": f"{_ROOT}.state_representation",
    "VehicleParameters": f"{_ROOT}.vehicle_parameters",
    "get_pacifica_parameters": f"{_ROOT}.vehicle_parameters",
    "Agent": f"{_ROOT}.agent",
    "OrientedBox": f"{_ROOT}.oriented_box",
    "SceneObjectMetadata": f"{_ROOT}.scene_object",
    "StaticObject": f"{_ROOT}.static_object",
    "TrackedObjects": f"{_ROOT}.tracked_objects",
    "TrackedObjectType": f"{_ROOT}.tracked_objects_types",
    "AbstractMap": "nuplan.common.maps.abstract_map",
    "SemanticMapLayer": "nuplan.common.maps.maps_datatypes",
    "TrafficLightStatusData": "nuplan.common.maps.maps_datatypes",
    "TrafficLightStatusType": "nuplan.common.maps.maps_datatypes",
    "SimulationHistoryBuffer": "nuplan.planning.simulation.history.simulation_history_buffer",
    "DetectionsTracks": "nuplan.planning.simulation.observation.observation_type",
    "PlannerInitialization": "nuplan.planning.simulation.planner.abstract_planner",
    "PlannerInput": "nuplan.planning.simulation.planner.abstract_planner",
    "SimulationIteration": (
        "nuplan.planning.simulation.simulation_time_controller.simulation_iteration"
    ),
}

_AGENTS = {Kind.VEHICLE: "VEHICLE", Kind.PEDESTRIAN: "PEDESTRIAN", Kind.CYCLIST: "BICYCLE"}
_LIGHTS = {
    Light.UNKNOWN: "UNKNOWN",
    Light.ARROW_STOP: "RED",
    Light.ARROW_CAUTION: "YELLOW",
    Light.ARROW_GO: "GREEN",
    Light.STOP: "RED",
    Light.CAUTION: "YELLOW",
    Light.GO: "GREEN",
    # A stop sign: planners would wait in front of a red light forever.
    Light.FLASHING_STOP: "UNKNOWN",
    Light.FLASHING_CAUTION: "YELLOW",
}


def wrap(
    planner: Any,
    *,
    maps: Any = None,
    name: str | None = None,
    extend_history: bool = False,
) -> Planner:
    """Returns a planner of nuPlan's devkit as a planner of the AV, for `run`, `serve` and studies.

    The planner is not changed: it is initialised once per rollout with the route and the map, and
    receives at every plan what the devkit's simulation gives it:

    - ego states: rear axle, m and rad; its velocity (m/s) and acceleration (m/s²) in the frame of
      the vehicle, of the tracker at present, by differences of positions before. The vehicle is the
      Pacifica, scaled to the recorded box of the AV; planners that name the Pacifica itself plan
      for its box.
    - tracked objects without the AV: boxes with centres in m, velocities in m/s along the axes of
      the map. Heights of boxes are NaN. Road users of kind "other" and obstacles are generic
      objects. Objects on roads above or below are included, since planners receive no heights.
    - lights of lanes, as far as they are observed.
    - the route: roadblocks in driving order; the only roadblock of a route is named twice.
    - a history of up to 22 samples at 0.1 s. A scenario of the benchmark begins 1 s before the
      first plan, at which the planner receives 11 samples.

    When agents enter or leave, the same planner goes on with its history, in which the others keep
    their tokens; after an interval between plans that is longer than the history of the scenario,
    the history begins anew.

    The mission goal is the end of the last lane of the route: that of the log is not revealed. The
    time is 0 at the first frame of the history. The returned trajectory is sampled every 0.1 s from
    the present on; `run` follows the poses of its rear axle and ignores its velocities.

    Args:
        planner: An `AbstractPlanner` of the devkit, or a class or function without arguments that
            returns one. Every rollout has a planner of its own: an object is copied (`deepcopy`)
            before it is used, so give a function if it is large, as networks are.
        maps: Map API, for logs of nuPlan: an `AbstractMap`, a factory of maps (then the map of
            `LOCATIONS` in which the route is), or a function of the id of the scenario that returns
            an `AbstractMap`. Coordinates are then those of the map. This needs `reveal_ids=True`
            (`--reveal-ids`). By default the planner receives a map made from that of the scene, in
            the coordinates of the scene, whose origin is the AV at the current frame; see
            `reactsim.nuplan_map.SceneMap`.
        name: Name in tables; that of the planner by default.
        extend_history: Fill the history before its first frame with motion at constant velocity,
            for planners that need two seconds. Without it, such planners fail at their first plans
            with an error of their own, unless the scenario has a longer history.

    Raises:
        ImportError: The devkit is missing.
        TypeError: `planner` is no planner of the devkit, or cannot be copied; or `maps` is none of
            the above.
        ValueError: It needs the recorded scenario, or sensor data.

    A plan fails with a text if the trajectory is missing, begins after the present, ends before the
    next plan, or is not finite; if lanes of the route are not in `maps`; or if the planner fails.

    """
    return _NuplanPlanner(planner, maps, name, extend_history)


def _devkit() -> SimpleNamespace:
    try:
        return SimpleNamespace(
            **{name: getattr(importlib.import_module(of), name) for name, of in _DEVKIT.items()}
        )
    except ImportError as error:
        raise ImportError(
            f"reactsim.nuplan needs nuPlan's devkit and what it imports ({error}): install"
            " github.com/motional/nuplan-devkit in this environment"
        ) from error


class _NuplanPlanner(Planner):
    """Asks a planner of the devkit."""

    def __init__(self, planner: Any, maps: Any, name: str | None, extend_history: bool) -> None:
        self.devkit = _devkit()
        self.maps = maps
        self.extend_history = extend_history
        self._found: dict[str, Any] = {}
        """Maps of the factory by location."""
        is_planner = callable(getattr(planner, "compute_planner_trajectory", None))
        self._make: Callable[[], Any] = planner
        if is_planner and not isinstance(planner, type):
            self._make = lambda: _copied(planner)
        elif not callable(planner):
            raise TypeError(
                f"{planner!r} is no planner of nuPlan's devkit: it has no method"
                " `compute_planner_trajectory`"
            )
        is_map = isinstance(maps, self.devkit.AbstractMap) or hasattr(maps, "build_map_from_name")
        if not (maps is None or is_map or callable(maps)):
            raise TypeError(
                f"`maps` is {maps!r}, expected an AbstractMap of nuPlan's devkit, a factory of maps"
                " or a function"
            )
        first = self._new()
        plain = re.sub(r"[^A-Za-z0-9._@-]+", "-", str(first.name()))[:64]
        self.name = name or plain or type(first).__name__

    def _new(self) -> Any:
        """Returns a planner for one rollout."""
        planner = self._make()
        title = type(planner).__name__
        for method in ("name", "initialize", "observation_type", "compute_planner_trajectory"):
            if not callable(getattr(planner, method, None)):
                raise TypeError(
                    f"{title} is no planner of nuPlan's devkit: it has no method `{method}`"
                )
        if getattr(planner, "requires_scenario", False):
            raise ValueError(f"{title} needs the recorded scenario, which planners do not observe")
        wanted = planner.observation_type()
        if wanted.__name__ != self.devkit.DetectionsTracks.__name__:
            raise ValueError(
                f"{title} observes {wanted.__name__}, but scenarios have tracked objects only"
                " (DetectionsTracks)"
            )
        return planner

    def begin(self, scene: Scene) -> _Episode:
        """Makes a planner for a new rollout; it is initialised at its first plan."""
        before = scene.scenes.continues
        if before is None:
            return _Episode(self.devkit, self._new(), scene)
        episode: _Episode = before.memory
        episode.go_on(scene, before)
        return episode

    def plan(self, seen: PlannerObservation) -> Trajectory:
        """Returns poses of the centre of the AV."""
        episode: _Episode = seen.memory
        if not episode.is_open:
            place = self._place(seen)
            episode.open(place, self.extend_history)
        episode.observe(seen)
        returned = episode.compute(seen)
        return episode.sampled(returned, seen)

    def _place(self, seen: PlannerObservation) -> _Place:
        if self.maps is None:
            return _scene_place(self.devkit, seen)
        scenes = seen.scene.scenes
        if scenes.origins is None or scenes.scenario_ids is None:
            raise ValueError(
                "`maps` needs the place of the scene on the map: give `reveal_ids=True` to"
                " `reactsim.run`, or `--reveal-ids` to `reactsim run`"
            )
        x, y = scenes.origins[seen.scene.index]
        if isinstance(self.maps, self.devkit.AbstractMap):
            return _map_place(self.devkit, seen, (x, y), self.maps)
        build = getattr(self.maps, "build_map_from_name", None)
        if build is None:
            found = self.maps(scenes.scenario_ids[seen.scene.index])
            return _map_place(self.devkit, seen, (x, y), found)
        errors = []
        for location in LOCATIONS:
            try:
                if location not in self._found:
                    self._found[location] = build(location)
                return _map_place(self.devkit, seen, (x, y), self._found[location])
            except Exception as error:
                errors.append(f"{location}: {error}")
        raise ValueError("the scene is in no map of `maps`: " + "; ".join(errors))


def _copied(planner: Any) -> Any:
    try:
        return copy.deepcopy(planner)
    except Exception as error:
        raise TypeError(
            f"{type(planner).__name__} cannot be copied for every rollout"
            f" ({type(error).__name__}: {error}): give a function that makes one"
        ) from error


@dataclasses.dataclass
class _Place:
    """Map, route and lights of a scene as a planner of the devkit receives them."""

    map_api: Any
    origin: tuple[float, float]
    """Coordinates in the map of the origin of the scene, metres."""
    route: list[str]
    """Ids of roadblocks; the only one twice."""
    goal: Any
    connectors: list[list[int]]
    """Ids of the connectors that each light of the scene controls."""

    def __post_init__(self) -> None:
        # Routes of nuPlan have two roadblocks or more, which planners of the devkit assert.
        self.route = self.route if len(self.route) > 1 else self.route * 2


def _scene_place(devkit: SimpleNamespace, seen: PlannerObservation) -> _Place:
    """Returns the place of a scene on a map made from that of the scene."""
    scene_map = importlib.import_module("reactsim.nuplan_map").SceneMap(seen.scene)
    parts_of_lane: dict[int, list[int]] = {}
    for k, part in enumerate(scene_map.parts):
        parts_of_lane.setdefault(part.lane, []).append(k)
    parts = scene_map.parts
    blocks: list[int] = []
    for lane in seen.route:
        of_lane = [parts[k].block for k in parts_of_lane.get(lane, [])]
        for k, block in enumerate(of_lane):
            if block not in blocks:
                # A part of a lane is before the parts that follow it.
                later = [blocks.index(other) for other in of_lane[k + 1 :] if other in blocks]
                blocks.insert(min(later, default=len(blocks)), block)
    if not blocks:
        raise ValueError("the route has no lanes for motor vehicles")
    # The route names lanes: of a lane that is cut, the parts behind the AV are not part of it.
    x, y = seen.scene.history[0, -1, :2]
    here = devkit.Point2D(x, y)
    inside = [
        k
        for k, block in enumerate(blocks)
        if any(e.contains_point(here) for e in scene_map.blocks[block].interior_edges)
    ]
    first = inside[0] if inside and len(parts) > len(parts_of_lane) else 0
    route = [scene_map.blocks[block] for block in blocks[first:]]
    last = route[-1].interior_edges[0].baseline_path.discrete_path[-1]
    lanes = seen.scene.lights.lane.tolist()
    connectors = [
        [int(scene_map.edges[k].id) for k in parts_of_lane.get(lane, [])] for lane in lanes
    ]
    return _Place(scene_map, (0.0, 0.0), [block.id for block in route], last, connectors)


def _map_place(
    devkit: SimpleNamespace, seen: PlannerObservation, origin: tuple[float, float], map_api: Any
) -> _Place:
    """Returns the place of a scene on a map of the devkit, whose lanes are found by position.

    Raises ValueError if a lane of the route or of a light is not in the map.
    """
    if not isinstance(map_api, devkit.AbstractMap):
        raise ValueError(f"`maps` gave {map_api!r}, expected an AbstractMap of nuPlan's devkit")
    found: dict[int, Any] = {}

    def edge(lane: int) -> Any:
        if lane not in found:
            found[lane] = _same_lane(devkit, seen.scene.lanes[lane], origin, map_api)
        return found[lane]

    route = list(dict.fromkeys(edge(lane).get_roadblock_id() for lane in seen.route))
    if not route:
        raise ValueError("the route has no lanes")
    lanes = seen.scene.lights.lane.tolist()
    connectors = [[int(edge(lane).id)] if lane >= 0 else [] for lane in lanes]
    goal = edge(seen.route[-1]).baseline_path.discrete_path[-1]
    return _Place(map_api, origin, route, goal, connectors)


def _same_lane(devkit: SimpleNamespace, lane: Any, origin: Any, map_api: Any) -> Any:
    points = lane.points + np.asarray(origin)
    layers = devkit.SemanticMapLayer
    layer = layers.LANE_CONNECTOR if lane.is_connector else layers.LANE
    probes = [devkit.Point2D(*points[k]) for k in (0, len(points) // 2, -1)]
    best, least = None, math.inf
    near = map_api.get_proximal_map_objects(probes[1], SAME_LANE, [layer])
    for candidate in near[layer]:
        path = candidate.baseline_path
        gaps = [_gap(path.get_nearest_pose_from_position(probe), probe) for probe in probes]
        ends = [_gap(path.discrete_path[k], probes[k]) for k in (0, -1)]
        distance = max(gaps + ends)
        if distance < least:
            best, least = candidate, distance
    if least > SAME_LANE:
        x, y = points[len(points) // 2]
        kind = "connector" if lane.is_connector else "lane"
        raise ValueError(
            f"{kind} {lane.index} of the scene, at ({x:.1f}, {y:.1f}), is not in map"
            f" `{map_api.map_name}`; give the map of the location and version of the log"
        )
    return best


def _gap(a: Any, b: Any) -> float:
    return math.hypot(a.x - b.x, a.y - b.y)


class _Episode:
    """One rollout of a planner of the devkit."""

    def __init__(self, devkit: SimpleNamespace, planner: Any, scene: Scene) -> None:
        self.devkit = devkit
        self.planner = planner
        self.scene = scene
        self.is_open = False
        self.first = 0
        """Frame of the rollout that is frame 0 of the scene; not 0 after agents entered or left."""
        self.frames = 0
        """Number of frames of the rollout that the planner has observed."""
        self.ego_states: list[Any] = []
        self.observations: list[Any] = []
        self.numbers = list(range(scene.n_agents))
        """Number of each agent, which is its token, throughout the rollout."""
        self.obstacle_numbers = [scene.n_agents + k for k in range(len(scene.obstacles))]
        self.next_number = scene.n_agents + len(scene.obstacles)
        length, width = scene.sizes[0].tolist()
        if not (length > 0.0 and width > 0.0):
            raise ValueError(f"the AV has a box of {length} m x {width} m, expected an extent")
        self.vehicle = _vehicle(devkit, length, width)

    def go_on(self, scene: Scene, before: Continuation) -> None:
        """Continues in a scene in which agents have entered or left."""
        self.first += before.frame + 1 - scene.n_history
        numbers, slots = self.numbers, before.slots.tolist()
        self.numbers = [numbers[slot] if slot >= 0 else self._new_number() for slot in slots]
        boxes = map(tuple, self.scene.obstacles.tolist())
        known = dict(zip(boxes, self.obstacle_numbers))
        self.obstacle_numbers = []
        for box in map(tuple, scene.obstacles.tolist()):
            number = known.pop(box, None)
            self.obstacle_numbers.append(self._new_number() if number is None else number)
        self.scene = scene
        if self.first > self.frames:
            # Frames are missing between the last plan and the history of the scene.
            self.ego_states.clear()
            self.observations.clear()

    def _new_number(self) -> int:
        self.next_number += 1
        return self.next_number - 1

    def open(self, place: _Place, extend_history: bool) -> None:
        """Initialises the planner."""
        self.place = place
        self.extend_history = extend_history
        self.planner.initialize(
            self.devkit.PlannerInitialization(
                route_roadblock_ids=place.route, mission_goal=place.goal, map_api=place.map_api
            )
        )
        self.is_open = True

    def observe(self, seen: PlannerObservation) -> None:
        """Appends the frames since the plan before to the history."""
        last = seen.frame + 1
        known = max(self.frames - self.first, 0)
        present = seen.valid[0, :last]
        absent = np.flatnonzero(~present)
        # The states of the AV without a gap, as far as differences need them.
        start = max(int(absent[-1]) + 1 if len(absent) else 0, known - 2)
        motions = ego_motions(seen.states[0, start:last], self.vehicle)
        # Logs have no steering angles, and nuPlan begins simulations without any turn.
        logged = self.scene.n_history - self.first
        motions[: max(logged - start, 0), 4] = 0.0
        if seen.ego is not None:
            motions[-1] = seen.ego
        elif last == logged:
            motions[-1, 4:] = 0.0
        begin = max(start, known, last - BUFFER)
        if not self.ego_states and self.extend_history:
            self._extend(seen, begin, motions[begin - start])
        for frame in range(begin, last):
            self._append(seen, frame, seen.states[:, frame], motions[frame - start])
        self.frames = self.first + last

    def _extend(self, seen: PlannerObservation, first: int, motion: Array) -> None:
        """Prepends frames before `first`, in which all road users keep their velocities."""
        states = seen.states[:, first]
        velocities = np.array([_velocity(seen, agent, first) for agent in range(len(states))])
        straight = np.array([motion[0], motion[1], *np.zeros(5)])
        for frame in range(seen.frame + 1 - BUFFER, first):
            before = states.copy()
            before[:, :2] += velocities * DT * (frame - first)
            self._append(seen, frame, before, straight, at=first)

    def _append(
        self,
        seen: PlannerObservation,
        frame: int,
        states: Array,
        motion: Array,
        at: int | None = None,
    ) -> None:
        """Appends a sample. `at`: frame at which kinds and presence are looked up."""
        time = self._time(frame)
        self.ego_states.append(self._ego(states[0], motion, time))
        self.observations.append(self._objects(seen, frame if at is None else at, states, time))
        del self.ego_states[:-BUFFER], self.observations[:-BUFFER]

    def _time(self, frame: int) -> int:
        """Returns the time of a frame, µs: 0 at the first one that can be in a buffer."""
        before = max(BUFFER - self.scene.n_history, 0) if self.extend_history else 0
        return (self.first + frame + before) * STEP_US

    def _ego(self, state: Array, motion: Array, time: int) -> Any:
        devkit = self.devkit
        x, y = state[:2] + self.place.origin
        heading = math.remainder(state[2], math.tau)
        back = self.vehicle.rear_axle_to_center
        vx, vy, ax, ay, steering, yaw_rate, yaw_acceleration = motion.tolist()
        return devkit.EgoState.build_from_rear_axle(
            rear_axle_pose=devkit.StateSE2(
                float(x - back * math.cos(heading)), float(y - back * math.sin(heading)), heading
            ),
            rear_axle_velocity_2d=devkit.StateVector2D(vx, vy),
            rear_axle_acceleration_2d=devkit.StateVector2D(ax, ay),
            tire_steering_angle=steering,
            time_point=devkit.TimePoint(time),
            vehicle_parameters=self.vehicle,
            is_in_auto_mode=True,
            angular_vel=yaw_rate,
            angular_accel=yaw_acceleration,
        )

    def _objects(self, seen: PlannerObservation, frame: int, states: Array, time: int) -> Any:
        devkit, types = self.devkit, self.devkit.TrackedObjectType
        kinds, sizes = self.scene.kinds.tolist(), self.scene.sizes
        tracked = []
        for agent in range(1, len(states)):
            length, width = sizes[agent].tolist()
            if not (seen.valid[agent, frame] and length > 0.0 and width > 0.0):
                continue
            metadata = self._metadata(self.numbers[agent], time)
            box = self._box(states[agent, :3], length, width)
            kind = _AGENTS.get(kinds[agent])
            if kind is None:
                tracked.append(devkit.StaticObject(types.GENERIC_OBJECT, box, metadata))
                continue
            velocity = devkit.StateVector2D(*_velocity(seen, agent, frame))
            tracked.append(
                devkit.Agent(
                    tracked_object_type=types[kind],
                    oriented_box=box,
                    velocity=velocity,
                    metadata=metadata,
                )
            )
        for number, obstacle in zip(self.obstacle_numbers, self.scene.obstacles):
            box = self._box(obstacle[:3], *obstacle[3:].tolist())
            metadata = self._metadata(number, time)
            tracked.append(devkit.StaticObject(types.GENERIC_OBJECT, box, metadata))
        return devkit.DetectionsTracks(tracked_objects=devkit.TrackedObjects(tracked))

    def _metadata(self, number: int, time: int) -> Any:
        # Tokens have one length and are no words, since planners look for tokens within tokens.
        token = f"{number:06d}"
        return self.devkit.SceneObjectMetadata(
            timestamp_us=time, token=f"{token}-{time}", track_id=number, track_token=token
        )

    def _box(self, pose: Array, length: float, width: float) -> Any:
        x, y = (pose[:2] + self.place.origin).tolist()
        center = self.devkit.StateSE2(x, y, math.remainder(pose[2], math.tau))
        return self.devkit.OrientedBox(center, length=length, width=width, height=math.nan)

    def _lights(self, seen: PlannerObservation) -> list[Any]:
        devkit = self.devkit
        lights = []
        for connectors, state in zip(self.place.connectors, seen.light_states[:, -1].tolist()):
            if state != Light.NOT_OBSERVED:
                status = devkit.TrafficLightStatusType[_LIGHTS[Light(state)]]
                time = self._time(seen.frame)
                lights += [devkit.TrafficLightStatusData(status, id_, time) for id_ in connectors]
        return lights

    def compute(self, seen: PlannerObservation) -> Any:
        """Returns the trajectory of the planner."""
        devkit = self.devkit
        history = devkit.SimulationHistoryBuffer.initialize_from_list(
            BUFFER, list(self.ego_states), list(self.observations), DT
        )
        now = devkit.SimulationIteration(
            time_point=devkit.TimePoint(self._time(seen.frame)),
            index=self.first + seen.frame + 1 - self.scene.n_history,
        )
        current = devkit.PlannerInput(
            iteration=now, history=history, traffic_light_data=self._lights(seen)
        )
        compute = getattr(self.planner, "compute_trajectory", None)
        return (compute or self.planner.compute_planner_trajectory)(current)

    def sampled(self, trajectory: Any, seen: PlannerObservation) -> Trajectory:
        """Returns the poses of the centre of the AV along a trajectory of the devkit."""
        place = f"{type(self.planner).__name__}.compute_planner_trajectory"
        if not callable(getattr(trajectory, "get_state_at_time", None)):
            raise TypeError(
                f"{place} returned {type(trajectory).__name__}, expected an AbstractTrajectory"
            )
        now = self._time(seen.frame)
        start, end = trajectory.start_time.time_us, trajectory.end_time.time_us
        needed = now + seen.steps * STEP_US
        if start > now + LATE_US or end < needed - LATE_US:
            raise ValueError(
                f"{place} returned a trajectory from {(start - now) * 1e-6:g} s to"
                f" {(end - now) * 1e-6:g} s after the present, expected one from 0 s to at least"
                f" {seen.steps * DT:g} s, the time of the next plan"
            )
        count = min((end - now + LATE_US) // STEP_US, most_poses(self.scene, seen.frame))
        times = [min(max(now + k * STEP_US, start), end) for k in range(count + 1)]
        poses = np.array([self._center(trajectory, time, place) for time in times])
        if not np.isfinite(poses).all():
            k = int(np.argmin(np.isfinite(poses).all(axis=1)))
            x, y, heading = poses[k]
            raise ValueError(
                f"{place}: the state after {k * DT:g} s has x {x}, y {y}, heading {heading},"
                " expected finite numbers"
            )
        return Trajectory(poses[1:], present=poses[0])

    def _center(self, trajectory: Any, time: int, place: str) -> Sequence[float]:
        state = trajectory.get_state_at_time(self.devkit.TimePoint(int(time)))
        axle = getattr(state, "rear_axle", None)
        if axle is None:
            raise TypeError(
                f"{place} returned a trajectory of {type(state).__name__}, expected EgoState"
            )
        ahead = self.vehicle.rear_axle_to_center
        x, y = axle.x - self.place.origin[0], axle.y - self.place.origin[1]
        heading = axle.heading
        return [x + ahead * math.cos(heading), y + ahead * math.sin(heading), heading]


def _vehicle(devkit: SimpleNamespace, length: float, width: float) -> Any:
    """Returns the Pacifica of nuPlan, scaled to a box in metres."""
    pacifica = devkit.get_pacifica_parameters()
    if math.isclose(length, pacifica.length, abs_tol=1e-9) and math.isclose(
        width, pacifica.width, abs_tol=1e-9
    ):
        return pacifica
    scale = length / pacifica.length
    return devkit.VehicleParameters(
        width=width,
        front_length=pacifica.front_length * scale,
        rear_length=pacifica.rear_length * scale,
        cog_position_from_rear_axle=pacifica.cog_position_from_rear_axle * scale,
        wheel_base=pacifica.wheel_base * scale,
        vehicle_name="pacifica-scaled",
        vehicle_type=pacifica.vehicle_type,
        height=pacifica.height,
    )


def _velocity(seen: PlannerObservation, agent: int, frame: int) -> tuple[float, float]:
    """Returns the velocity of an agent, m/s; an unknown one is estimated.

    It is the displacement since the frame before, else 0, as for the planners of the program.
    """
    vx, vy = seen.states[agent, frame, 3:].tolist()
    if math.isfinite(vx) and math.isfinite(vy):
        return vx, vy
    if frame == 0 or not seen.valid[agent, frame - 1]:
        return 0.0, 0.0
    before, now = seen.states[agent, frame - 1, :2], seen.states[agent, frame, :2]
    dx, dy = ((now - before) / DT).tolist()
    return dx, dy


def ego_motions(states: Array, vehicle: Any) -> Array:
    """Returns the motion of the rear axle at successive frames, by differences as in the program.

    Args:
        states: States of the centre of the box, [T, 5]: x, y, heading, vx, vy; NaN velocities are
            replaced by differences of positions.
        vehicle: Vehicle parameters of the devkit.

    Returns:
        [T, 7]: velocity x, y (m/s) and acceleration x, y (m/s²) in the frame of the vehicle,
        steering angle (rad; 0 below 0.5 m/s), yaw rate (rad/s), yaw acceleration (rad/s²).

    """
    count = len(states)
    from_ = np.maximum(np.arange(count) - 1, 0)
    to = np.minimum(np.arange(count) + 1, count - 1)
    elapsed = np.maximum(to - from_, 1) * DT

    def rate(values: Array) -> Array:
        change = values[to] - values[from_]
        result: Array = change / (elapsed[:, None] if values.ndim == 2 else elapsed)
        return result

    heading = states[:, 2]
    turn = heading[to] - heading[from_]
    yaw_rate = (turn - math.tau * np.round(turn / math.tau)) / elapsed
    velocity = states[:, 3:].copy()
    unknown = ~np.isfinite(velocity).all(axis=1)
    velocity[unknown] = rate(states[:, :2])[unknown]
    cos, sin = np.cos(heading), np.sin(heading)
    vx = velocity[:, 0] * cos + velocity[:, 1] * sin
    vy = velocity[:, 1] * cos - velocity[:, 0] * sin - yaw_rate * vehicle.rear_axle_to_center
    ax = rate(vx) - yaw_rate * vy
    ay = rate(vy) + yaw_rate * vx
    moving = np.abs(vx) >= STANDSTILL
    curvature = np.where(moving, yaw_rate / np.where(moving, vx, 1.0), 0.0)
    steering = np.arctan(curvature * vehicle.wheel_base)
    return np.stack([vx, vy, ax, ay, steering, yaw_rate, rate(yaw_rate)], axis=1)

"""A stand-in for nuPlan's devkit: the classes that `reactsim.nuplan` uses, with their interface."""

from __future__ import annotations

import dataclasses
import enum
import math
import sys
import types
from typing import Any, Dict, Iterator, List, Optional

import numpy as np


@dataclasses.dataclass(frozen=True)
class Point2D:
    x: float
    y: float


@dataclasses.dataclass(frozen=True)
class StateSE2:
    x: float
    y: float
    heading: float


@dataclasses.dataclass(frozen=True)
class StateVector2D:
    x: float
    y: float


@dataclasses.dataclass(frozen=True, order=True)
class TimePoint:
    time_us: int

    def __post_init__(self) -> None:
        assert isinstance(self.time_us, int) and self.time_us >= 0


@dataclasses.dataclass
class VehicleParameters:
    width: float
    front_length: float
    rear_length: float
    cog_position_from_rear_axle: float
    wheel_base: float
    vehicle_name: str
    vehicle_type: str
    height: Optional[float] = None

    @property
    def length(self) -> float:
        return self.front_length + self.rear_length

    @property
    def rear_axle_to_center(self) -> float:
        return self.length / 2 - self.rear_length


def get_pacifica_parameters() -> VehicleParameters:
    return VehicleParameters(2.297, 4.049, 1.127, 1.67, 3.089, "pacifica", "gen1", 1.777)


class EgoState:
    def __init__(self, **values: Any) -> None:
        self.__dict__.update(values)
        self.rear_axle = values["rear_axle_pose"]
        self.time_us = values["time_point"].time_us

    @classmethod
    def build_from_rear_axle(
        cls,
        *,
        rear_axle_pose: StateSE2,
        rear_axle_velocity_2d: StateVector2D,
        rear_axle_acceleration_2d: StateVector2D,
        tire_steering_angle: float,
        time_point: TimePoint,
        vehicle_parameters: VehicleParameters,
        is_in_auto_mode: bool = True,
        angular_vel: float = 0.0,
        angular_accel: float = 0.0,
    ) -> EgoState:
        return cls(**{name: value for name, value in locals().items() if name != "cls"})


@dataclasses.dataclass
class OrientedBox:
    center: StateSE2
    length: float
    width: float
    height: float


@dataclasses.dataclass(frozen=True)
class SceneObjectMetadata:
    timestamp_us: int
    token: str
    track_id: Optional[int]
    track_token: Optional[str]


class TrackedObjectType(enum.Enum):
    VEHICLE = 0
    PEDESTRIAN = 1
    BICYCLE = 2
    TRAFFIC_CONE = 3
    BARRIER = 4
    CZONE_SIGN = 5
    GENERIC_OBJECT = 6
    EGO = 7


class StaticObject:
    def __init__(
        self, tracked_object_type: Any, oriented_box: OrientedBox, metadata: SceneObjectMetadata
    ) -> None:
        self.tracked_object_type, self.box = tracked_object_type, oriented_box
        self.metadata, self.velocity = metadata, StateVector2D(0.0, 0.0)


class Agent(StaticObject):
    def __init__(self, *, velocity: StateVector2D, **values: Any) -> None:
        super().__init__(**values)
        self.velocity = velocity


@dataclasses.dataclass
class TrackedObjects:
    tracked_objects: List[Any]

    def __iter__(self) -> Iterator[Any]:
        return iter(self.tracked_objects)


@dataclasses.dataclass
class DetectionsTracks:
    tracked_objects: TrackedObjects


class Sensors:
    pass


class TrafficLightStatusType(enum.IntEnum):
    GREEN = 0
    YELLOW = 1
    RED = 2
    UNKNOWN = 3


@dataclasses.dataclass
class TrafficLightStatusData:
    status: TrafficLightStatusType
    lane_connector_id: int
    timestamp: int


@dataclasses.dataclass
class SimulationHistoryBuffer:
    ego_states: List[Any]
    observations: List[Any]
    sample_interval: float

    @classmethod
    def initialize_from_list(
        cls, buffer_size: int, ego_states: List[Any], observations: List[Any], interval: float
    ) -> SimulationHistoryBuffer:
        return cls(ego_states[-buffer_size:], observations[-buffer_size:], interval)

    @property
    def current_state(self) -> Any:
        return self.ego_states[-1], self.observations[-1]


@dataclasses.dataclass
class SimulationIteration:
    time_point: TimePoint
    index: int


@dataclasses.dataclass(frozen=True)
class PlannerInitialization:
    route_roadblock_ids: List[str]
    mission_goal: StateSE2
    map_api: Any


@dataclasses.dataclass(frozen=True)
class PlannerInput:
    iteration: SimulationIteration
    history: SimulationHistoryBuffer
    traffic_light_data: Optional[List[TrafficLightStatusData]] = None


class SemanticMapLayer(enum.IntEnum):
    LANE = 0
    INTERSECTION = 1
    STOP_LINE = 2
    CROSSWALK = 4
    DRIVABLE_AREA = 5
    LANE_CONNECTOR = 11
    BASELINE_PATHS = 12
    WALKWAYS = 14
    CARPARK_AREA = 15
    ROADBLOCK = 17
    ROADBLOCK_CONNECTOR = 18


class StopLineType(enum.IntEnum):
    STOP_SIGN = 1
    TRAFFIC_LIGHT = 2
    YIELD = 4


class LaneConnectorType(enum.IntEnum):
    STRAIGHT = 0
    LEFT = 1
    RIGHT = 2
    UTURN = 3


class IntersectionType(enum.IntEnum):
    DEFAULT = 0


class AbstractMap:
    pass


class MapObject:
    polygon: Any

    def __init__(self, object_id: str) -> None:
        self.id = object_id

    def contains_point(self, point: Point2D) -> bool:
        from shapely.geometry import Point

        return bool(self.polygon.contains(Point(point.x, point.y)))


class PolylineMapObject(MapObject):
    pass


class Lane(MapObject):
    pass


class LaneConnector(MapObject):
    pass


class RoadBlockGraphEdgeMapObject(MapObject):
    pass


class PolygonMapObject(MapObject):
    pass


class StopLine(MapObject):
    def __init__(self, object_id: str, stop_line_type: StopLineType) -> None:
        super().__init__(object_id)
        self.stop_line_type = stop_line_type


class Intersection(MapObject):
    def __init__(self, object_id: str, intersection_type: IntersectionType) -> None:
        super().__init__(object_id)


class Trajectory:
    """A trajectory of the devkit through poses of the rear axle, [P, 3] at times [P], µs."""

    def __init__(self, times: List[int], poses: Any) -> None:
        self.times, self.poses = np.asarray(times), np.asarray(poses, float)

    @property
    def start_time(self) -> TimePoint:
        return TimePoint(int(self.times[0]))

    @property
    def end_time(self) -> TimePoint:
        return TimePoint(int(self.times[-1]))

    def get_state_at_time(self, time_point: TimePoint) -> Any:
        time = time_point.time_us
        assert self.times[0] <= time <= self.times[-1]
        x, y, heading = (float(np.interp(time, self.times, self.poses[:, k])) for k in range(3))
        return types.SimpleNamespace(rear_axle=StateSE2(x, y, heading))


class Planner:
    """A planner of the devkit that keeps its inputs and drives straight on at its speed."""

    requires_scenario = False
    latest: Planner
    """The planner that was made last."""

    def __init__(self) -> None:
        Planner.latest = self
        self.initialized: List[PlannerInitialization] = []
        self.inputs: List[PlannerInput] = []
        self.answer: Any = None

    def name(self) -> str:
        return "Straight on"

    def observation_type(self) -> Any:
        return DetectionsTracks

    def initialize(self, initialization: PlannerInitialization) -> None:
        self.initialized.append(initialization)

    def compute_planner_trajectory(self, current_input: PlannerInput) -> Any:
        self.inputs.append(current_input)
        ego = current_input.history.current_state[0]
        if self.answer is not None:
            return self.answer(ego)
        axle, speed = ego.rear_axle, ego.rear_axle_velocity_2d.x
        seconds = 0.5 * np.arange(17)
        ahead = np.array([math.cos(axle.heading), math.sin(axle.heading)])
        xy = np.array([axle.x, axle.y]) + speed * seconds[:, None] * ahead
        poses = np.column_stack([xy, np.full(17, axle.heading)])
        return Trajectory([ego.time_us + int(s * 1e6) for s in seconds], poses)


_STATE = "nuplan.common.actor_state"
_MAPS = "nuplan.common.maps"
_SIMULATION = "nuplan.planning.simulation"
_MODULES: Dict[str, List[Any]] = {
    f"{_STATE}.state_representation": [Point2D, StateSE2, StateVector2D, TimePoint],
    f"{_STATE}.vehicle_parameters": [VehicleParameters, get_pacifica_parameters],
    f"{_STATE}.ego_state": [EgoState],
    f"{_STATE}.oriented_box": [OrientedBox],
    f"{_STATE}.scene_object": [SceneObjectMetadata],
    f"{_STATE}.tracked_objects_types": [TrackedObjectType],
    f"{_STATE}.static_object": [StaticObject],
    f"{_STATE}.agent": [Agent],
    f"{_STATE}.tracked_objects": [TrackedObjects],
    f"{_MAPS}.abstract_map": [AbstractMap],
    f"{_MAPS}.maps_datatypes": [
        *(SemanticMapLayer, StopLineType, LaneConnectorType, IntersectionType),
        *(TrafficLightStatusType, TrafficLightStatusData),
    ],
    f"{_MAPS}.abstract_map_objects": [
        *(PolylineMapObject, Lane, LaneConnector, RoadBlockGraphEdgeMapObject),
        *(PolygonMapObject, StopLine, Intersection),
    ],
    f"{_SIMULATION}.history.simulation_history_buffer": [SimulationHistoryBuffer],
    f"{_SIMULATION}.observation.observation_type": [DetectionsTracks, Sensors],
    f"{_SIMULATION}.planner.abstract_planner": [PlannerInitialization, PlannerInput],
    f"{_SIMULATION}.simulation_time_controller.simulation_iteration": [SimulationIteration],
}


def install(monkeypatch: Any) -> None:
    """Puts the stand-in in the place of the devkit."""
    for path, members in _MODULES.items():
        parts = path.split(".")
        for k in range(1, len(parts)):
            package = types.ModuleType(".".join(parts[:k]))
            package.__path__ = []
            if package.__name__ not in sys.modules:
                monkeypatch.setitem(sys.modules, package.__name__, package)
        module: Any = types.ModuleType(path)
        for member in members:
            setattr(module, member.__name__, member)
        monkeypatch.setitem(sys.modules, path, module)
        setattr(sys.modules[".".join(parts[:-1])], parts[-1], module)
    # The map is made of the classes of the devkit that was there when it was imported.
    monkeypatch.delitem(sys.modules, "reactsim.nuplan_map", raising=False)

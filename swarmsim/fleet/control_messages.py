"""Messages and services of ROS 2's simulation_interfaces 2.1, as pycdr2 packs them: those that a world answers."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Self

from pycdr2 import IdlStruct
from pycdr2.types import sequence, uint8, uint16, uint64

from swarmsim.fleet.adapters.ros2_messages import Header, Quaternion, RosPose, Time, Twist, Vector3, yaw_of

__all__ = ["Header", "Quaternion", "RosPose", "Time", "Twist", "Vector3", "yaw_of"]  # those of others that it uses

#: Of `Result`.
UNSUPPORTED, OK, NOT_FOUND, INCORRECT_STATE, FAILED = range(5)
#: Of `SetSimulationState` and `SetEntityState`.
ALREADY, INVALID_POSE = 101, 101
STOPPED, PLAYING, PAUSED, QUITTING = range(4)
ROBOT = 1  #: the category of all entities here


@dataclass
class RosAccel(IdlStruct, typename="geometry_msgs/msg/Accel"):
    """An acceleration: m/s^2, rad/s^2. Never told here."""

    linear: Vector3 = field(default_factory=Vector3)
    angular: Vector3 = field(default_factory=Vector3)


@dataclass
class RosResult(IdlStruct, typename="simulation_interfaces/msg/Result"):
    """How a request went."""

    result: uint8 = OK
    error_message: str = ""


@dataclass
class RosEmpty(IdlStruct, typename="simulation_interfaces/srv/Empty_Request"):
    """A request that asks for nothing else; ROS 2 gives it one byte."""

    structure_needs_at_least_one_member: uint8 = 0


@dataclass
class RosAnswer(IdlStruct, typename="simulation_interfaces/srv/Answer_Response"):
    """The response of services that tell no more than how it went."""

    result: RosResult = field(default_factory=RosResult)


@dataclass
class RosSimulatorFeatures(IdlStruct, typename="simulation_interfaces/msg/SimulatorFeatures"):
    """What a simulator can do, by number."""

    features: sequence[uint16] = field(default_factory=list)
    spawn_formats: sequence[str] = field(default_factory=list)
    custom_info: str = ""


@dataclass
class RosFeatures(IdlStruct, typename="simulation_interfaces/srv/GetSimulatorFeatures_Response"):
    """The response of GetSimulatorFeatures."""

    features: RosSimulatorFeatures = field(default_factory=RosSimulatorFeatures)

    @classmethod
    def of(cls, features: Sequence[int], info: str) -> Self:
        """These features, and words about them."""
        return cls(RosSimulatorFeatures(list(features), [], info))


@dataclass
class RosSimulationState(IdlStruct, typename="simulation_interfaces/msg/SimulationState"):
    """Whether time goes on."""

    state: uint8 = PAUSED


@dataclass
class RosStateTold(IdlStruct, typename="simulation_interfaces/srv/GetSimulationState_Response"):
    """The response of GetSimulationState."""

    state: RosSimulationState = field(default_factory=RosSimulationState)
    result: RosResult = field(default_factory=RosResult)


@dataclass
class RosStateWanted(IdlStruct, typename="simulation_interfaces/srv/SetSimulationState_Request"):
    """The request of SetSimulationState."""

    state: RosSimulationState = field(default_factory=RosSimulationState)


@dataclass
class RosSteps(IdlStruct, typename="simulation_interfaces/srv/StepSimulation_Request"):
    """The request of StepSimulation."""

    steps: uint64 = 1


@dataclass
class RosEntityCategory(IdlStruct, typename="simulation_interfaces/msg/EntityCategory"):
    """What kind of thing an entity is."""

    category: uint8 = 0


@dataclass
class RosTagsFilter(IdlStruct, typename="simulation_interfaces/msg/TagsFilter"):
    """Entities with tags; there are none here."""

    tags: sequence[str] = field(default_factory=list)
    filter_mode: uint8 = 0


@dataclass
class RosBounds(IdlStruct, typename="simulation_interfaces/msg/Bounds"):
    """Entities in a place; 0 of type: anywhere."""

    type: uint8 = 0
    points: sequence[Vector3] = field(default_factory=list)


@dataclass
class RosEntityFilters(IdlStruct, typename="simulation_interfaces/msg/EntityFilters"):
    """Which entities are asked for."""

    filter: str = ""
    categories: sequence[RosEntityCategory] = field(default_factory=list)
    tags: RosTagsFilter = field(default_factory=RosTagsFilter)
    bounds: RosBounds = field(default_factory=RosBounds)

    @property
    def kinds(self) -> list[int]:
        """The categories that are asked for; none: all."""
        return [one.category for one in self.categories]


@dataclass
class RosEntitiesWanted(IdlStruct, typename="simulation_interfaces/srv/GetEntities_Request"):
    """The request of GetEntities."""

    filters: RosEntityFilters = field(default_factory=RosEntityFilters)


@dataclass
class RosEntities(IdlStruct, typename="simulation_interfaces/srv/GetEntities_Response"):
    """The response of GetEntities."""

    result: RosResult = field(default_factory=RosResult)
    entities: sequence[str] = field(default_factory=list)

    @classmethod
    def of(cls, names: Sequence[str]) -> Self:
        """Those that were found."""
        return cls(entities=list(names))


@dataclass
class RosEntityState(IdlStruct, typename="simulation_interfaces/msg/EntityState"):
    """Where an entity is and how it moves, in the frame of the world."""

    header: Header = field(default_factory=Header)
    pose: RosPose = field(default_factory=RosPose)
    twist: Twist = field(default_factory=Twist)
    acceleration: RosAccel = field(default_factory=RosAccel)


@dataclass
class RosEntityWanted(IdlStruct, typename="simulation_interfaces/srv/GetEntityState_Request"):
    """The request of GetEntityState."""

    entity: str = ""


@dataclass
class RosEntityTold(IdlStruct, typename="simulation_interfaces/srv/GetEntityState_Response"):
    """The response of GetEntityState."""

    result: RosResult = field(default_factory=RosResult)
    state: RosEntityState = field(default_factory=RosEntityState)


@dataclass
class RosEntityMoved(IdlStruct, typename="simulation_interfaces/srv/SetEntityState_Request"):
    """The request of SetEntityState."""

    entity: str = ""
    state: RosEntityState = field(default_factory=RosEntityState)
    set_pose: bool = False
    set_twist: bool = False
    set_acceleration: bool = False

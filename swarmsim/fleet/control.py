"""The control of a running world by the services of ROS 2's simulation_interfaces, over keys of zenoh."""

from __future__ import annotations

import json
import math
import queue
import re
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, Protocol, final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.robots import LONGEST
from swarmsim.core.state import Knowledge, Moment, State
from swarmsim.fleet.addresses import Address

if TYPE_CHECKING:
    import zenoh
    from pycdr2 import IdlStruct

_WHO: Final = "--control"
_LARGEST: Final = 2**16  # bytes of a request
_WAITING: Final = 1000  # requests; more are dropped
_FILTER: Final = 64  # characters of a filter
_NAME: Final = re.compile(r"robot_(\d{1,5})")
#: Of SimulatorFeatures: getting and setting states of entities and of the simulation, pausing, one and many steps.
_FEATURES: Final = (10, 11, 24, 25, 26, 31, 32)
_LACKING: Final = (
    "entities are spawned by the scenario; no reset, worlds, tags, bounds, infos, twists, accelerations or actions"
)


class Carrying(Protocol):
    """Bodies that can be put somewhere."""

    def state(self) -> State:
        """Where they are."""
        ...

    def remove(self, robots: NDArray[np.int64]) -> None:
        """Take robots (r,) away."""
        ...

    def place(self, robots: NDArray[np.int64], pose: NDArray[np.float64]) -> None:
        """Put robots (r,) at poses (r, 3)."""
        ...


class EndAskedError(Exception):
    """The end of the run was asked for."""


@final
class WorldControl:
    """An observer that lets a world's iterations begin only as it is asked to: it begins paused.

    All requests are answered between two iterations, by the thread that simulates. What cannot be read is counted.
    """

    def __init__(self, address: str, bodies: Carrying, period: float, page: tuple[float, ...]) -> None:
        """Listens at HOST:PORT. `page` has the left, lower, right and upper edge, m. Raises InputError."""
        try:
            import zenoh  # noqa: F401

            from swarmsim.fleet import control_messages
        except ImportError as problem:
            raise InputError(
                f"{_WHO}: needs eclipse-zenoh and pycdr2; install them with: pip install eclipse-zenoh pycdr2"
            ) from problem
        self._m, self._bodies, self._period, self._page = control_messages, bodies, period, page
        self._state, self._playing, self._left = bodies.state(), False, 0
        self._stepping: zenoh.Query | None = None  # to be answered once all steps are done
        self._asked: queue.Queue[tuple[str, zenoh.Query]] = queue.Queue(_WAITING)
        self._session = _listening(Address.of(address, _WHO))
        self._services = {
            "get_simulator_features": self._features,
            "get_simulation_state": self._told,
            "set_simulation_state": self._set,
            "step_simulation": self._step,
            "get_entities": self._entities,
            "get_entity_state": self._entity,
            "set_entity_state": self._move,
        }
        #: What was not answered, by reason.
        self.counts = Counter[str]()
        self._held = [self._session.declare_queryable(name, self._taking(name)) for name in self._services]

    def begin(self) -> None:
        """Wait until the first iteration is asked for. Raises EndAskedError if the end is."""
        self._answer()

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Answer what has been asked, and wait while the world is paused."""
        self._state = self._bodies.state()
        self._left = max(self._left - 1, 0)
        if not self._left and self._stepping is not None:
            self._stepping.reply("step_simulation", self._m.RosAnswer().serialize())
            self._stepping = None
        self._answer()

    def close(self) -> None:
        """Answer no more."""
        self._held.clear()
        self._session.close()

    def _answer(self) -> None:
        while True:
            try:  # a query ends once nobody holds it
                self._serve(*self._asked.get(block=self._is_paused))
            except queue.Empty:
                return

    @property
    def _is_paused(self) -> bool:
        return not self._playing and not self._left

    def _taking(self, name: str) -> Callable[[zenoh.Query], None]:
        def take(query: zenoh.Query) -> None:
            try:
                self._asked.put_nowait((name, query))
            except queue.Full:
                self.counts["full"] += 1

        return take

    def _serve(self, name: str, query: zenoh.Query) -> None:
        try:
            data = b"" if query.payload is None else query.payload.to_bytes()
            if len(data) > _LARGEST:
                raise ValueError("too long")
            told = self._services[name](data, query)
        except EndAskedError:
            raise
        except Exception:  # whatever a stranger's bytes make of a library
            self.counts["no request"] += 1
            return
        if told is not None:
            query.reply(name, told.serialize())

    def _features(self, data: bytes, query: zenoh.Query) -> IdlStruct:
        return self._m.RosFeatures.of(_FEATURES, f"swarmsim: {_LACKING}")

    def _told(self, data: bytes, query: zenoh.Query) -> IdlStruct:
        state = self._m.PLAYING if self._playing else self._m.PAUSED
        return self._m.RosStateTold(self._m.RosSimulationState(state))

    def _set(self, data: bytes, query: zenoh.Query) -> IdlStruct:
        wanted = self._m.RosStateWanted.deserialize(data).state.state
        if wanted == self._m.QUITTING:
            query.reply("set_simulation_state", self._m.RosAnswer().serialize())
            raise EndAskedError
        if wanted not in (self._m.PLAYING, self._m.PAUSED):
            return self._no(self._m.UNSUPPORTED, f"state {wanted}; expected playing 1, paused 2 or quitting 3")
        if self._playing == (wanted == self._m.PLAYING):
            return self._no(self._m.ALREADY, "it is so already")
        self._playing = wanted == self._m.PLAYING
        return self._m.RosAnswer()

    def _step(self, data: bytes, query: zenoh.Query) -> IdlStruct | None:
        steps = self._m.RosSteps.deserialize(data).steps
        if not self._is_paused:
            return self._no(self._m.INCORRECT_STATE, "the simulation is not paused; expected that it is, to step")
        if not 1 <= steps <= LONGEST:
            return self._no(self._m.FAILED, f"{steps} steps; expected from 1 to {LONGEST}")
        self._left, self._stepping = steps, query
        return None

    def _entities(self, data: bytes, query: zenoh.Query) -> IdlStruct:
        wanted = self._m.RosEntitiesWanted.deserialize(data).filters
        if wanted.tags.tags or wanted.bounds.type or len(wanted.filter) > _FILTER:
            why = f"filters by tags, by bounds or by more than {_FILTER} characters are not known"
            return self._m.RosEntities(self._m.RosResult(self._m.UNSUPPORTED, why))
        try:
            filtered = re.compile(wanted.filter)
        except re.error as problem:
            return self._m.RosEntities(self._m.RosResult(self._m.FAILED, f"filter: {problem}"))
        kinds = wanted.kinds
        names = [f"robot_{robot}" for robot in range(len(self._state.alive))]
        found = [name for name in names if filtered.search(name) and (not kinds or self._m.ROBOT in kinds)]
        return self._m.RosEntities.of(found)

    def _entity(self, data: bytes, query: zenoh.Query) -> IdlStruct:
        name = self._m.RosEntityWanted.deserialize(data).entity
        robot = self._robot(name)
        if robot is None:
            return self._m.RosEntityTold(self._m.RosResult(self._m.NOT_FOUND, self._unknown(name)))
        (x, y, yaw), (along_x, along_y, turn) = self._state.pose[robot].tolist(), self._state.velocity[robot].tolist()
        seconds, nanoseconds = divmod(round(1e9 * self._state.iteration * self._period), 10**9)
        m = self._m
        header = m.Header(m.Time(seconds, nanoseconds), "world")
        pose = m.RosPose(m.Vector3(x, y, 0.0), m.Quaternion(0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)))
        twist = m.Twist(m.Vector3(along_x, along_y, 0.0), m.Vector3(0.0, 0.0, turn))
        found: IdlStruct = m.RosEntityTold(state=m.RosEntityState(header, pose, twist))
        return found

    def _move(self, data: bytes, query: zenoh.Query) -> IdlStruct:
        asked = self._m.RosEntityMoved.deserialize(data)
        robot, place = self._robot(asked.entity), asked.state.pose.position
        if robot is None:
            return self._no(self._m.NOT_FOUND, self._unknown(asked.entity))
        if asked.set_twist or asked.set_acceleration or not asked.set_pose:
            return self._no(self._m.UNSUPPORTED, "robots move by their wheels; expected set_pose alone")
        if asked.state.header.frame_id not in ("", "world"):
            return self._no(self._m.UNSUPPORTED, f"frame {asked.state.header.frame_id!r}; expected 'world'")
        yaw = self._m.yaw_of(asked.state.pose.orientation)
        left, lower, right, upper = self._page
        if not (left <= place.x <= right and lower <= place.y <= upper and math.isfinite(yaw)):
            return self._no(self._m.INVALID_POSE, f"{place.x:g}, {place.y:g} m is not on the page {self._page}")
        if not self._state.alive[robot]:
            return self._no(self._m.FAILED, f"{asked.entity} is dead")
        self._bodies.remove(np.array([robot]))
        self._bodies.place(np.array([robot]), np.array([[place.x, place.y, yaw]]))
        return self._m.RosAnswer()

    def _robot(self, name: str) -> int | None:
        """A robot's number, by its name."""
        matched = _NAME.fullmatch(name)
        number = -1 if matched is None else int(matched[1])
        return number if 0 <= number < len(self._state.alive) else None

    def _unknown(self, name: str) -> str:
        return f"no entity is called {name[:40]!r}; expected robot_0 to robot_{len(self._state.alive) - 1}"

    def _no(self, code: int, why: str) -> IdlStruct:
        return self._m.RosAnswer(self._m.RosResult(code, why))


def _listening(place: Address) -> zenoh.Session:
    """A session that listens at an address. Raises InputError."""
    import zenoh

    config = zenoh.Config()
    for key, value in {
        "mode": "router",
        "scouting/multicast/enabled": False,
        "listen/endpoints": [f"tcp/{place}"],
        "listen/timeout_ms": 0,
        "listen/exit_on_failure": True,
    }.items():
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as problem:
        raise InputError(
            f"{_WHO}: cannot listen at {place}: the port is taken, or the host is not this machine; expected a free one"
        ) from problem

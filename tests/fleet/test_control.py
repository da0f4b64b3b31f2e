"""A running world is controlled by ROS 2's simulation_interfaces, whose messages another library packs and reads."""

from __future__ import annotations

import json
import math
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from conftest import ROOT
from fleet.crews import fleet_of, free_fleet, in_threads
from fleet.places import free, until
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from swarmsim.api.fleets import controlled
from swarmsim.core.errors import InputError
from swarmsim.fleet.control import EndAskedError

ROOM = ROOT / "scenarios" / "room.toml"
#: The interfaces' fields in their order, of version 2.1; services as the messages that they consist of.
KINDS = {
    "Result": "uint8 result\nstring error_message",
    "SimulatorFeatures": "uint16[] features\nstring[] spawn_formats\nstring custom_info",
    "SimulationState": "uint8 state",
    "EntityCategory": "uint8 category",
    "TagsFilter": "string[] tags\nuint8 filter_mode",
    "Bounds": "uint8 type\ngeometry_msgs/Vector3[] points",
    "EntityFilters": "string filter\nsim/EntityCategory[] categories\nsim/TagsFilter tags\nsim/Bounds bounds",
    "EntityState": "std_msgs/Header header\ngeometry_msgs/Pose pose\ngeometry_msgs/Twist twist\n"
    "geometry_msgs/Accel acceleration",
    "Empty": "uint8 structure_needs_at_least_one_member",
    "Answer": "sim/Result result",
    "Features": "sim/SimulatorFeatures features",
    "StateTold": "sim/SimulationState state\nsim/Result result",
    "StateWanted": "sim/SimulationState state",
    "Steps": "uint64 steps",
    "EntitiesWanted": "sim/EntityFilters filters",
    "Entities": "sim/Result result\nstring[] entities",
    "EntityWanted": "string entity",
    "EntityTold": "sim/Result result\nsim/EntityState state",
    "EntityMoved": "string entity\nsim/EntityState state\nbool set_pose\nbool set_twist\nbool set_acceleration",
}
STORE = get_typestore(Stores.ROS2_HUMBLE)
for name, text in KINDS.items():
    STORE.register(get_types_from_msg(text.replace("sim/", "sim/msg/"), f"sim/msg/{name}"))


def of(kind: str, *fields: object) -> Any:
    whole = kind if "/" in kind else f"sim/msg/{kind}"
    return STORE.types[whole](*fields)


class Tool:
    """Calls services as a tool with ROS 2 behind a bridge would."""

    def __init__(self, place: str) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/{place}"]))
        self.session = zenoh.open(config)

    def raw(self, service: str, payload: bytes, seconds: float = 20.0) -> list[bytes]:
        told = [one.ok for one in self.session.get(service, payload=payload, timeout=seconds)]
        return [one.payload.to_bytes() for one in told if one is not None]

    def __call__(self, service: str, asked: Any, answer: str) -> Any:
        kind = asked.__msgtype__
        (told,) = self.raw(service, bytes(STORE.serialize_cdr(asked, kind)))
        return STORE.deserialize_cdr(told, f"sim/msg/{answer}")


@pytest.fixture
def world(tmp_path: Path) -> Iterator[tuple[Tool, Callable[[], int], list[BaseException]]]:
    """A tool, the iteration of the world that it controls, and how that has ended."""
    place, fleet, ended = free(), fleet_of(ROOM, iterations=60), list[BaseException]()

    def live() -> None:
        with in_threads(fleet, str(tmp_path)):
            try:
                with controlled(fleet, place) as asked:
                    fleet.run.simulation.run(asked)
            except BaseException as problem:
                ended.append(problem)

    thread = threading.Thread(target=live)
    thread.start()
    tool = until_there(place)
    yield tool, lambda: fleet.run.simulation.state.iteration, ended
    tool.raw("set_simulation_state", bytes(STORE.serialize_cdr(state(3), "sim/msg/StateWanted")), 3.0)
    thread.join()
    tool.session.close()


def until_there(place: str) -> Tool:
    found: list[Tool] = []

    def there() -> bool:
        try:
            found.append(Tool(place))
        except zenoh.ZError:
            return False
        return True

    until(there, 60.0)
    until(lambda: bool(found[0].raw("get_simulation_state", b"\0\1\0\0\0")), 60.0)
    return found[0]


def state(number: int) -> Any:
    return of("StateWanted", of("SimulationState", number))


def test_a_tool_steps_pauses_asks_and_moves(world) -> None:
    tool, iteration, ended = world
    empty = of("Empty", 0)
    told = tool("get_simulator_features", empty, "Features").features
    assert told.features.tolist() == [10, 11, 24, 25, 26, 31, 32]
    assert told.custom_info.startswith("swarmsim")
    assert tool("get_simulation_state", empty, "StateTold").state.state == 2
    assert iteration() == 0
    for steps, sum_ in ((1, 1), (4, 5)):
        assert tool("step_simulation", of("Steps", steps), "Answer").result.result == 1
        assert iteration() == sum_
    assert tool("step_simulation", of("Steps", 0), "Answer").result.result == 4
    everything = of(
        "EntityFilters", "", [], of("TagsFilter", [], 0), of("Bounds", 0, []),
    )  # fmt: skip
    found = tool("get_entities", of("EntitiesWanted", everything), "Entities")
    assert (found.result.result, found.entities) == (1, ["robot_0", "robot_1", "robot_2"])
    everything.filter, everything.categories = "_[12]$", [of("EntityCategory", 1)]
    assert tool("get_entities", of("EntitiesWanted", everything), "Entities").entities == ["robot_1", "robot_2"]
    everything.categories = [of("EntityCategory", 2)]
    assert tool("get_entities", of("EntitiesWanted", everything), "Entities").entities == []
    everything.filter = "("
    assert tool("get_entities", of("EntitiesWanted", everything), "Entities").result.result == 4
    everything.filter, everything.bounds = "", of("Bounds", 3, [])
    assert tool("get_entities", of("EntitiesWanted", everything), "Entities").result.result == 0

    first = tool("get_entity_state", of("EntityWanted", "robot_1"), "EntityTold")
    assert first.result.result == 1
    assert (first.state.header.stamp.sec, first.state.header.frame_id) == (5, "world")
    assert tool("get_entity_state", of("EntityWanted", "robot_3"), "EntityTold").result.result == 2
    there = first.state
    there.pose.position.x, there.pose.position.y = 1.5, 1.0
    there.pose.orientation = of("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(0.5), math.cos(0.5))
    moved = of("EntityMoved", "robot_1", there, True, False, False)
    assert tool("set_entity_state", moved, "Answer").result.result == 1
    assert tool("step_simulation", of("Steps", 1), "Answer").result.result == 1
    second = tool("get_entity_state", of("EntityWanted", "robot_1"), "EntityTold").state.pose
    assert np.hypot(second.position.x - 1.5, second.position.y - 1.0) < 0.2
    moved.set_twist = True
    assert tool("set_entity_state", moved, "Answer").result.result == 0
    moved.set_twist, there.pose.position.x = False, 1e9
    assert tool("set_entity_state", moved, "Answer").result.result == 101

    assert tool("set_simulation_state", state(2), "Answer").result.result == 101
    assert tool("set_simulation_state", state(0), "Answer").result.result == 0
    assert tool("set_simulation_state", state(1), "Answer").result.result == 1
    until(lambda: iteration() > 8, 20.0)
    assert tool("step_simulation", of("Steps", 1), "Answer").result.result == 3
    assert tool("set_simulation_state", state(2), "Answer").result.result == 1
    now = iteration()
    assert tool.raw("get_entity_state", b"\0\1\0\0\xff\xff\xff\xff", 0.5) == []  # no request
    assert iteration() == now < 60
    assert tool("set_simulation_state", state(3), "Answer").result.result == 1
    until(lambda: bool(ended))
    assert isinstance(ended[0], EndAskedError)


def test_a_fleet_at_a_pace_has_no_such_control() -> None:
    with (
        pytest.raises(InputError, match="--control: at a pace the clock says when iterations begin; expected --pace l"),
        controlled(free_fleet(ROOM, pace=10.0, iterations=3), free()),
    ):
        pass

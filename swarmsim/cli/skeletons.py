"""Parts to start from, each with a test that passes."""

from __future__ import annotations

import keyword
from pathlib import Path
from string import Template
from typing import Final

from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.registry import nearest
from swarmsim.core.scenario import PLACES

MIND: Final = '''
"""A mind of one's own: one instance is one robot's mind, and its memory."""


class $Name:
    """Drives on, and turns away from walls that it senses and robots that it hears nearby."""

    says = {"x": "f8", "y": "f8"}  # the fields of its message

    def __init__(self, speed: float = 0.1):  # keys of the scenario
        self.speed = speed  # m/s

    def say(self, me):
        return me.x, me.y

    def step(self, me):
        near = [other for other in me.heard if (other.x - me.x) ** 2 + (other.y - me.y) ** 2 < 0.3**2]
        blocked = len(me.walls) > 0 and min(((me.walls - (me.x, me.y)) ** 2).sum(axis=1)) < 0.3**2
        return me.drive(0.3 * self.speed, 1.0) if near or blocked else me.drive(self.speed)
'''

STRATEGY: Final = '''
"""A strategy as a function of arrays: row i of what it gives follows from row i of what it sees."""

import numpy as np


def $name(observations, *, ahead: float = 0.05, turn: float = 0.2):
    """Everybody drives a circle, at `ahead` m/s and `turn` rad/s."""
    return np.tile([ahead, turn], (len(observations.alive), 1))
'''

COMPUTATION: Final = '''
"""A computation as a function of arrays: every robot's new value, which it says, from its own and those it hears."""

import numpy as np


def $name(observations, value, *, gain: float = 0.2):
    """Where the swarm's middle is: each robot's estimate goes towards those that it hears."""
    if value is None:  # at first, and after a robot has forgotten
        return observations.pose[:, :2].copy()
    inbox, new = observations.inbox, value.copy()
    np.add.at(new, inbox.receivers, gain * (inbox.content.value - value[inbox.receivers]))
    return new
'''

TASK: Final = '''
"""A task as a function of a moment: what is measured, and whether it is done."""

import numpy as np


def $name(moment, *, wanted: float = 1.0):
    """How far live robots are from their middle in the mean, in m; done once they are `wanted` away."""
    place = moment.state.pose[moment.state.alive, :2]
    away = np.hypot(*(place - place.mean(axis=0)).T).mean()
    return away, away >= wanted
'''

TOPOLOGY: Final = '''
"""A topology as a function of the state: who hears whom, among the live, sorted."""

import numpy as np


def $name(state, *, ahead: int = 1):
    """Each live robot hears the one that is `ahead` of it in a ring of live robots."""
    live = np.flatnonzero(state.alive)
    links = np.stack([live, np.roll(live, -ahead)], axis=1)
    return links[links[:, 0] != links[:, 1]].astype(np.int32)
'''

CHANNEL: Final = '''
"""A channel: what becomes of messages."""

import numpy as np
from msgspec import Struct
from swarmsim.core.messages import Delivery


class $Name(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Messages get through in one iteration of `every`."""

    every: int = 2  # iterations

    def build(self, setting):
        return Channel(self.every)


class Channel:
    def __init__(self, every):
        self._every = every

    def deliver(self, state, links, sizes):
        sent = np.full(len(links), state.iteration)
        letters = np.column_stack([links, sent, sizes[links[:, 1]]]).astype(np.int32)
        none = letters[:0]
        if state.iteration % self._every:
            return Delivery(none, (("jammed", letters),), state.iteration)
        return Delivery(letters, (("jammed", none),), state.iteration)
'''

SENSOR: Final = '''
"""A sensor: what robots measure of the world around them."""

from msgspec import Struct
from swarmsim.robots.sensors import IrRing


class $Name(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """The ring of infra-red beams, which misses every other iteration."""

    reach: float = 1.0  # m

    def build(self, setting):
        return Sensor(IrRing(reach=self.reach).build(setting))


class Sensor:
    def __init__(self, inner):
        self._inner = inner
        self.channels = inner.channels

    def sense(self, state):
        readings = self._inner.sense(state)
        return readings.blanked(state.alive) if state.iteration % 2 else readings
'''

FAULT: Final = '''
"""A fault: something goes wrong in one of the parts, which it wraps."""

from dataclasses import replace

import numpy as np
from msgspec import Struct


class $Name(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """From iteration `at` on, robots hear nobody with a higher number than their own."""

    at: int = 0  # iteration

    def build(self, setting):
        return self

    def install(self, parts):
        return replace(parts, topology=OneWay(parts.topology, self.at))


class OneWay:
    def __init__(self, inner, at):
        self._inner, self._at = inner, at

    def links(self, state):
        links = self._inner.links(state)
        return links[links[:, 0] > links[:, 1]] if state.iteration >= self._at else links
'''

TEST: Final = '''
from pathlib import Path

from swarmsim.testing import check_contracts

HERE = Path(__file__).parent
ROOM = """<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 4 4" width="4m" height="4m">
  <g id="walls"><path fill-rule="evenodd" d="M0 0H4V4H0Z M0.2 0.2V3.8H3.8V0.2Z"/></g>
  <g id="spawn"><rect id="floor" x="0.5" y="0.5" width="3" height="3"/></g>
</svg>"""
SCENARIO = """
world = "room.svg"
$extra
[robots]
count = 4
spawn = "floor"

[network]
topology = $topology
$table
"""


def test_$name(tmp_path):
    (tmp_path / "room.svg").write_text(ROOM)
    (tmp_path / "scenario.toml").write_text(SCENARIO.replace("HERE", HERE.as_posix()))
    check_contracts(tmp_path / "scenario.toml", allow_code=True)
'''

SKELETONS: Final = {
    "mind": MIND, "strategy": STRATEGY, "computation": COMPUTATION, "task": TASK, "topology": TOPOLOGY,
    "channel": CHANNEL, "sensor": SENSOR, "fault": FAULT,
}  # fmt: skip
FUNCTIONS: Final = ("strategy", "computation", "task", "topology")  # kinds whose skeleton is a function


def _names(kind: str, name: str) -> tuple[str, str]:
    """The name of the module, and that of the part in it. Raises InputError."""
    if kind not in SKELETONS:
        raise InputError(f"new {kind}: no such kind of part; {nearest(kind, SKELETONS)}")
    module = name.replace("-", "_").lower()
    if not module.isidentifier() or keyword.iskeyword(module):
        raise InputError(f"new {kind} {name}: not a name for a part; expected letters, digits and _, as in my_rule")
    return module, module if kind in FUNCTIONS else "".join(word.capitalize() for word in module.split("_"))


def written(kind: str, name: str, folder: Path) -> list[Path]:
    """Write a part and its test into a folder; gives the files. Raises InputError; nothing is overwritten."""
    module, part = _names(kind, name)
    files = [folder / f"{module}.py", folder / f"test_{module}.py"]
    for path in files:
        if path.exists():
            raise InputError(f"{path}: exists already; expected a new name, nothing is overwritten")
    use = f'{{use = "HERE/{module}.py:{part}"}}'
    extra = {
        "fault": f"faults = [{use}]",
        "channel": "",
        "mind": f'mind = {use}\ntask = {{use = "spacing"}}',
        "computation": f'mind = {{computation = {use}, strategy = {{use = "stand"}}}}\ntask = {{use = "spacing"}}',
        "strategy": f"mind = {{strategy = {use}}}",
    }.get(kind, "" if kind == "topology" else f"{kind} = {use}")
    topology = use if kind == "topology" else '{use = "full"}'
    table = f"channel = {use}" if kind == "channel" else ""
    code = Template(SKELETONS[kind]).substitute(name=module, Name=part)
    test = Template(TEST).substitute(name=module, extra=extra, topology=topology, table=table)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for path, text in zip(files, (code, test), strict=True):
            path.write_text(text.lstrip("\n"), encoding="utf-8")
    except OSError as problem:
        raise unwritten(folder, problem, "a place for files") from problem
    return files


def advice(kind: str, name: str) -> str:
    """What to put into the scenario, and how to run both."""
    module, part = _names(kind, name)
    table = "[[faults]]" if kind == "fault" else "[mind]" if kind == "mind" else f"[{'.'.join(PLACES[kind])}]"
    return (
        f'in the scenario beside it: {table} use = "./{module}.py:{part}"\n'
        f"then: swarmsim run SCENARIO.toml --allow-code\nits test: python -m pytest test_{module}.py"
    )

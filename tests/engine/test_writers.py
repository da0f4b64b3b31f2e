"""Parts of others that write to what they are given, or to what they gave, or that end the program, falsify nothing."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, called, readings_of
from numpy.testing import assert_equal

from swarmsim.core.errors import InputError, PartError
from swarmsim.core.lending import Lender, copied, frozen, lent
from swarmsim.core.readings import Tiles
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.core.state import State
from swarmsim.engine.build import build
from swarmsim.recording.digests import Digests

ITERATIONS = 12
PARTS = '''
import signal
import sys
from dataclasses import fields, is_dataclass, replace

import numpy as np
from msgspec import Struct

from swarmsim.core.lending import copied
from swarmsim.network.channel import Perfect
from swarmsim.network.topology import NearestNeighbours
from swarmsim.operations.mapping.computation import OccupancyGrid
from swarmsim.operations.mapping.measures.coverage import Coverage
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier
from swarmsim.operations.mapping.sharing.policies import CurrentTile
from swarmsim.robots.localisation import Exact as Placed
from swarmsim.robots.motion import PurePursuit
from swarmsim.robots.sensors import IrRing


def arrays(value):
    """All arrays in a value, at any depth."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, (tuple, list)):
        for one in value:
            yield from arrays(one)
    elif isinstance(value, dict):
        yield from arrays(list(value.values()))
    elif is_dataclass(value):
        for field in fields(value):
            yield from arrays(getattr(value, field.name))


def scribbled(value):
    """Write to all arrays that let themselves be written to."""
    for array in arrays(value):
        if array.flags.writeable:
            array[...] = 1


class Wrapped:
    """A part of ours, whose verbs do something else besides."""

    def __init__(self, inner, how, *verbs):
        self.inner, self.how, self.calls, self.gave = inner, how, 0, {}
        for verb in verbs:
            setattr(self, verb, self.asked(verb))
        self.verb = verbs[0]

    def __getattr__(self, name):
        return getattr(self.inner, name)

    @property
    def codec(self):
        return self.inner.codec

    def asked(self, verb):
        ours = getattr(self.inner, verb)

        def ask(*given):
            self.calls += verb == self.verb
            if self.calls == 3 and self.how not in ("tries", "late"):
                ended(self.how, given)
            if self.how == "late":
                scribbled(self.gave.get(verb))
            found = ours(*given)
            if self.how == "late":
                self.gave[verb] = found = copied(found)
            if self.how == "tries" and verb != "follow":  # ours keeps these copies
                scribbled(given)
            return found

        return ask


def ended(how, given):
    if how == "writes":
        for array in arrays(given):
            array[...] = 1
    if how == "exits":
        sys.exit(0)
    if how == "interrupts":
        raise KeyboardInterrupt
    if how == "pressed":
        signal.raise_signal(signal.SIGINT)


class Base(Struct, frozen=True):
    how: str = "honest"


class Sensor(Base, frozen=True):
    def build(self, context):
        return Wrapped(IrRing().build(context), self.how, "sense")


class Localisation(Base, frozen=True):
    def build(self, context):
        return Wrapped(Placed().build(context), self.how, "locate")


class Computation(Base, frozen=True):
    def build(self, context):
        return Wrapped(OccupancyGrid().build(context), self.how, "say", "hear")


class Hearing(Base, frozen=True):
    def build(self, context):
        return Wrapped(OccupancyGrid().build(context), self.how, "hear", "say")


class Sharing(Base, frozen=True):
    def build(self, context):
        return Wrapped(CurrentTile().build(context), self.how, "say", "accepted")


class Strategy(Base, frozen=True):
    def build(self, context):
        return Wrapped(NearestFrontier().build(context), self.how, "step")


class Topology(Base, frozen=True):
    def build(self, context):
        return Wrapped(NearestNeighbours(k=1).build(context), self.how, "links")


class Channel(Base, frozen=True):
    def build(self, context):
        return Wrapped(Perfect().build(context), self.how, "deliver")


class Motion(Base, frozen=True):
    def build(self, context):
        return Wrapped(PurePursuit().build(context), self.how, "follow", "command")


class Task(Base, frozen=True):
    def build(self, context):
        return Judging(Coverage().build(context), self.how, "measure")


class Judging(Wrapped):
    def summaries(self):
        return [Wrapped(one, self.how, "sample") for one in self.inner.summaries()]


class Fault(Base, frozen=True):
    """Wraps the sensor, and looks at what happens between iterations."""

    def build(self, context):
        return self

    def install(self, parts):
        parts.schedule.enter(Wrapped(Calm(), self.how, "advance"))
        return replace(parts, sensor=Wrapped(parts.sensor, self.how, "sense"))


class Calm:
    def advance(self, now):
        return ()


class Builds(Base, frozen=True):
    def __post_init__(self):
        if self.how.startswith("early "):
            ended(self.how.removeprefix("early "), ())

    def build(self, context):
        ended(self.how, ())
        return NearestFrontier().build(context)
'''
PLACES = {
    "Sensor": "sensor",
    "Localisation": "localisation",
    "Computation": "mind.computation",
    "Hearing": "mind.computation",
    "Sharing": "mind.computation.sharing",
    "Strategy": "mind.strategy",
    "Topology": "network.topology",
    "Channel": "network.channel",
    "Motion": "motion",
    "Task": "task",
    "Fault": "faults",
}


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The room, with parts in a file beside the scenario."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "mine.py").write_text(PARTS)
    text = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    (folder / "room.toml").write_text(text)
    return folder / "room.toml"


def run_of(room: Path, *keys: str):
    with registry.own_code(True):
        return build(load(room, [*keys, f"stop.iterations={ITERATIONS}"]), str(room))


def keys_of(part: str, how: str) -> str:
    table = f"{{use='./mine.py:{part}', how='{how}'}}"
    return f"{PLACES[part]}={f'[{table}]' if part == 'Fault' else table}"


def outcome(run) -> tuple[list, list]:
    """Digests of all iterations, and all numbers at the end."""
    digests, summaries = Digests(), run.simulation.parts.task.summaries()
    run.simulation.run([*summaries, digests])  # those who could write look first
    return digests.rows, [one.summary() for one in summaries]


@pytest.fixture(scope="module")
def plain(room: Path) -> tuple[list, list]:
    return outcome(run_of(room))


@pytest.mark.parametrize("how", ["tries", "late"])
@pytest.mark.parametrize("part", PLACES)
def test_who_writes_to_arrays_of_others_or_to_its_own_later_changes_nothing(room, plain, part: str, how: str) -> None:
    """Even where nothing is raised: `verify` would call such a run equal."""
    found = outcome(run_of(room, keys_of(part, how)))
    if part == "Sensor":  # it is not known what somebody else's can see in the end
        plain = outcome(run_of(room, keys_of(part, "honest")))
    assert_equal(found[0], plain[0])
    assert_equal(found[1], plain[1])


@pytest.mark.parametrize("part", [part for part in PLACES if part != "Motion"])  # which gets copies, and may write
def test_who_writes_to_what_it_is_given_is_named(room, part: str) -> None:
    seam = "computation" if part in ("Hearing", "Sharing") else part.lower()
    with pytest.raises(PartError, match=rf"(?s){seam} .*, iteration 2: ValueError: .*read-only.* in ended: array"):
        run_of(room, keys_of(part, "writes")).simulation.run()


@pytest.mark.parametrize(("how", "told"), [("exits", "SystemExit: 0"), ("interrupts", "KeyboardInterrupt: ")])
@pytest.mark.parametrize("part", PLACES)
def test_who_ends_the_program_is_named(room, part: str, how: str, told: str) -> None:
    seam = "computation" if part in ("Hearing", "Sharing") else part.lower()
    with pytest.raises(PartError, match=rf"(?s){seam} .*, iteration 2: {told}.*mine\.py.* in ended: "):
        run_of(room, keys_of(part, how)).simulation.run()


@pytest.mark.parametrize("part", PLACES)
def test_ctrl_c_is_nobodys_failure(room, part: str) -> None:
    with pytest.raises(KeyboardInterrupt):
        run_of(room, keys_of(part, "pressed")).simulation.run()


@pytest.mark.parametrize("how", ["exits", "interrupts", "early exits", "early interrupts"])
def test_who_ends_the_program_when_it_is_built_is_bad_input(room, how: str) -> None:
    with pytest.raises(InputError, match=r"(?s)mind\.strategy\.|own code ends the program: .*in ended: "):
        run_of(room, f"mind.strategy={{use='./mine.py:Builds', how='{how}'}}")


def test_who_interrupts_when_it_is_read_is_bad_input(room) -> None:
    (room.parent / "rude.py").write_text("raise KeyboardInterrupt\n")
    with pytest.raises(InputError, match=r"(?s)rude\.py:Any' cannot be imported; .*KeyboardInterrupt.*in <module>"):
        run_of(room, "mind.strategy={use='./rude.py:Any'}")


def test_the_command_line_ends_with_a_failure_and_not_as_if_all_were_well(room, tmp_path: Path) -> None:
    ended = called("run", room, "--allow-code", "--set", keys_of("Sensor", "exits"), "--out", tmp_path / "run")
    assert ended.returncode == 3
    assert re.search(r"sensor mine\.py:\w+, iteration 2: SystemExit: 0", ended.stderr)


def test_what_is_lent_shows_what_it_is_of_and_is_given_back_as_that() -> None:
    state = State(0, np.ones((2, 3)), np.zeros((2, 3)), np.zeros((2, 2)), np.ones(2, np.bool_))
    lender = Lender()
    seen = lender.lent(state)
    state.pose[0, 0] = 5.0
    assert seen.pose[0, 0] == 5.0
    assert lender.lent(state) is seen
    assert lender.taken((seen.pose,))[0] is state.pose
    for changed in (seen.pose, lent({"a": [state.pose]})["a"][0], frozen((np.zeros(2),))[0]):
        with pytest.raises(ValueError, match="read-only"):
            changed[...] = 0
    mine = readings_of(Tiles(np.zeros((1, 2, 2), np.uint8), np.zeros((1, 2), np.int32)))
    for other in (lender.taken(mine), copied(mine)):
        mine.tiles.values[...] = 1
        assert not other.tiles.values.any()
        mine.tiles.values[...] = 0

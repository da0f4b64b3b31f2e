"""Parts of others that break their contracts are refused with name and iteration; all of ours keep theirs."""

from __future__ import annotations

from pathlib import Path

import pytest
from conftest import ROOT, made
from typer.testing import CliRunner

from swarmsim import testing
from swarmsim.cli import app
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load, minds_of
from swarmsim.engine.build import build
from swarmsim.operations.mapping.exploration.strategy import Exploring

PARTS = '''
from dataclasses import replace

import numpy as np
from msgspec import Struct

from swarmsim.core.messages import Delivery
from swarmsim.core.readings import Readings, Tiles
from swarmsim.core.state import Intents, Measured
from swarmsim.operations.mapping.computation import OccupancyGrid
from swarmsim.operations.mapping.exploration.nearest import NearestFrontier
from swarmsim.operations.mapping.maps import Maps
from swarmsim.robots.sensors import IrRing


class Links(Struct, frozen=True):
    rows: tuple = ((0, 1),)
    kind: str = "int32"

    def build(self, context):
        return self

    def links(self, state):
        return list(self.rows) if self.kind == "list" else np.array(self.rows, self.kind)


class Lying(Struct, frozen=True):
    """Claims to know everything, with or without saying so in its changes."""

    says_so: bool = False

    def build(self, context):
        return Liar(OccupancyGrid().build(context), self.says_so)


class Liar:
    knowledge_type = Maps

    def __init__(self, inner, says_so):
        self.inner, self.says_so, self.codec = inner, says_so, None
        self.reset, self.copy_from, self.say = inner.reset, inner.copy_from, inner.say

    def hear(self, senses, inbox):
        maps = self.inner.hear(senses, inbox)
        if senses.iteration < 3:
            return maps
        everything = np.ones_like(maps.observed)
        if not self.says_so:
            return replace(maps, observed=everything)
        robot, cell = np.nonzero(~maps.observed.reshape(len(everything), -1))
        more = np.column_stack([robot, cell, np.ones(len(cell))]).astype(np.int32)
        return replace(maps, observed=everything, changes=np.concatenate([maps.changes, more]))


class Honest(Struct, frozen=True):
    def build(self, context):
        return Brief(OccupancyGrid().build(context), 0)


class Short(Struct, frozen=True):
    """Says that its messages are shorter than they are."""

    def build(self, context):
        return Brief(OccupancyGrid().build(context), 1)


class Brief:
    knowledge_type = Maps
    codec = property(lambda self: self.inner.codec)

    def __init__(self, inner, less):
        self.inner, self.less = inner, less
        self.hear, self.reset, self.copy_from = inner.hear, inner.reset, inner.copy_from

    def say(self, senses):
        said = self.inner.say(senses)
        return replace(said, sizes=said.sizes - np.int32(self.less))


class Strategy(Struct, frozen=True):
    does: str

    def build(self, context):
        return Walker(self.does, NearestFrontier().build(context))


class Walker:
    requires_knowledge = Maps

    def __init__(self, does, inner):
        self.does, self.inner = does, inner

    def step(self, senses, inbox, knowledge):
        intents = self.inner.step(senses, inbox, knowledge)
        if senses.iteration < 2:
            return intents
        if self.does == "nan":
            return replace(intents, waypoints=np.full_like(intents.waypoints, np.nan))
        if self.does == "write":
            knowledge.observed[:] = True
        if self.does == "raise":
            return {}["nothing"]
        return "somewhere"


class Tiled(Struct, frozen=True):
    """A sensor with tiles of another size."""

    def build(self, context):
        return IrRing(tile=(9, 9), reach=2.0, beams=120).build(context)


class Unbuildable(Struct, frozen=True):
    def build(self):
        return None
'''


@pytest.fixture
def own(tmp_path: Path):
    """Builds the room with parts in a file beside the scenario."""
    (tmp_path / "mine.py").write_text(PARTS)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    path = tmp_path / "room.toml"
    path.write_text(room)

    def opened(*overrides: str):
        with registry.own_code(True):
            return build(load(path, overrides), str(path))

    opened.path = path
    return opened


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("rows=[[1, 1]]", r"links\[0\]: \[1, 1\]: a robot hears itself"),
        ("rows=[[0, 1], [0, 1]]", r"links\[1\]: \[0, 1\]: it repeats the link before"),
        ("rows=[[1, 0], [0, 1]]", r"links\[1\]: .*sorted by receiver, then sender"),
        ("rows=[[0, 9]]", r"links\[0\]: \[0, 9\]; expected ids from 0 to 2"),
        ('kind="list"', "links: list; expected an array, int32"),
        ('kind="float64"', "links: float64 of shape"),
        ("rows=[0, 1]", r"links: int32 of shape \(2,\); expected int32 of shape \(any, 2\)"),
    ],
)
def test_a_topology_that_breaks_its_contract_is_refused_by_name_and_iteration(own, keys: str, words: str) -> None:
    run = own(f'network.topology={{use="./mine.py:Links", {keys}}}')
    with pytest.raises(PartError, match=rf"topology .*Links, iteration 0: {words}"):
        run.simulation.run()


def test_links_of_the_dead_are_refused(own) -> None:
    run = own('network.topology={use="./mine.py:Links"}', 'faults=[{use="crash", at=4, robots=[1]}]')
    with pytest.raises(PartError, match=r"topology .*, iteration 4: links\[0\]: \[0, 1\]: one of the two is dead"):
        run.simulation.run()


def test_nobody_finishes_by_claiming_what_nothing_has_shown(own) -> None:
    quiet = own('mind.computation={use="./mine.py:Lying"}')
    with pytest.raises(PartError, match=r"Liar, iteration 3: robot 0's map holds \d+ cells, but its changes say \d+"):
        quiet.simulation.run()
    loud = own('mind.computation={use="./mine.py:Lying", says_so=true}')
    with pytest.raises(PartError, match=r"Liar, iteration 3: robot 0 claims to know cell \(0, 0\), which no tile has"):
        loud.simulation.run()
    assert not loud.simulation.finished


def test_a_computation_of_somebody_elses_that_keeps_its_word_runs_as_ours(own) -> None:
    run, ours = own('mind.computation={use="./mine.py:Honest"}'), made()
    assert run.simulation.run()
    assert ours.simulation.run()
    assert run.simulation.state.iteration == ours.simulation.state.iteration


@pytest.mark.parametrize(
    ("does", "words"),
    [
        ("nan", r"waypoints: \[0, 0, 0\] is not finite"),
        ("write", "ValueError: assignment destination is read-only\n.*mine.py, line"),
        ("raise", "KeyError: 'nothing'\n.*mine.py, line .*in step"),
        ("talk", "step: str; expected Intents"),
    ],
)
def test_a_strategy_that_breaks_its_contract_is_refused_with_its_own_lines(own, does: str, words: str) -> None:
    run = own(f'mind.strategy={{use="./mine.py:Strategy", does="{does}"}}')
    with pytest.raises(PartError, match=rf"(?s)strategy .*Walker, iteration 2: {words}") as refused:
        run.simulation.run()
    assert str(ROOT / "swarmsim") not in str(refused.value)


FAILING = """
from dataclasses import replace

import numpy as np
from msgspec import Struct
from swarmsim.operations.mapping.sharing.policies import CurrentTile
from swarmsim.robots.motion import PurePursuit
from swarmsim.robots.particles import Particles, PointBodies


class Base(Struct, frozen=True):
    wrong: bool = False


class Fields(Base, frozen=True):
    noise: float = 0.0

    def build(self, context):
        return self

    def value(self, time, points):
        if time < 2.0:
            return np.zeros(len(points))
        return np.zeros((1, 1)) if self.wrong else 1 // 0


class Motions(Base, frozen=True):
    def build(self, context):
        return Motion(PurePursuit().build(context), self.wrong)


class Motion:
    def __init__(self, inner, wrong):
        self.inner, self.wrong, self.count = inner, wrong, 0

    def follow(self, intents):
        self.count += 1
        self.inner.follow(intents)

    def command(self, pose):
        if self.count > 2:
            return np.full((3, 2), np.nan) if self.wrong else 1 // 0
        return self.inner.command(pose)


class Physics(Base, frozen=True):
    def build(self, context):
        return Bodies(Particles(), context)


class Bodies(PointBodies):
    def drive(self, motion, period):
        if self._iteration == 2:
            return 1 // 0
        return super().drive(motion, period)


class Shares(Base, frozen=True):
    def build(self, context):
        return Sharing(CurrentTile().build(context), self.wrong)


class Sharing:
    codec = property(lambda self: self.inner.codec)

    def __init__(self, inner, wrong):
        self.inner, self.wrong = inner, wrong
        self.accepted = inner.accepted

    def say(self, senses, maps):
        said = self.inner.say(senses, maps)
        if senses.iteration < 2:
            return said
        return replace(said, sizes=said.sizes.astype(float)) if self.wrong else 1 // 0


class Faults(Base, frozen=True):
    def build(self, context):
        return self

    def install(self, parts):
        parts.schedule.enter(self)
        return parts

    def advance(self, now):
        return 1 // 0 if now.iteration == 2 else ()
"""


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (["field={use='./failing.py:Fields'}"], r"field failing\.py:Fields, iteration \d+: ZeroDivisionError"),
        (
            ["field={use='./failing.py:Fields', wrong=true}"],
            r"field failing\.py:Fields, .*value: float64 of shape",
        ),
        (["motion={use='./failing.py:Motions'}"], r"motion failing\.py:Motion, iteration 2: ZeroDivisionError"),
        (["motion={use='./failing.py:Motions', wrong=true}"], r"motion .*command: \[0, 0\] is not finite"),
        (["physics={use='./failing.py:Physics'}"], r"iteration 2, physics .*failing\.py:Physics: ZeroDivisionError"),
        (["mind.computation.sharing={use='./failing.py:Shares'}"], r"computation .*, iteration 2: ZeroDivisionError"),
        (
            ["mind.computation.sharing={use='./failing.py:Shares', wrong=true}"],
            r"computation .*2: sizes: float64",
        ),
        (["faults=[{use='./failing.py:Faults'}]"], r"fault failing\.py:Faults, iteration 2: ZeroDivisionError"),
    ],
)
def test_whatever_part_of_somebody_elses_fails_is_named_with_its_own_lines(own, keys, words: str) -> None:
    (own.path.parent / "failing.py").write_text(FAILING)
    run = own(*keys)
    with pytest.raises(PartError, match=f"(?s){words}") as failed:
        run.simulation.run()
    if "Zero" in words:
        assert "1 // 0" in str(failed.value)
        assert str(ROOT / "swarmsim") not in str(failed.value)


def test_what_our_own_code_raises_is_not_blamed_on_others(own, monkeypatch: pytest.MonkeyPatch) -> None:
    run = own('mind.strategy={use="./mine.py:Strategy", does="nothing"}', "stop.iterations=1")

    def broken(*_):
        raise RuntimeError("ours")

    monkeypatch.setattr(run.simulation.parts.task, "measure", broken)
    with pytest.raises(RuntimeError, match="ours"):
        run.simulation.run()


def test_tiles_of_another_size_are_recorded(own, tmp_path: Path) -> None:
    run = own('sensor={use="./mine.py:Tiled"}')
    with run.recorder(tmp_path / "r.h5") as recorder:
        assert run.simulation.run([recorder])
    from swarmsim.recording.reader import Recording

    assert Recording(tmp_path / "r.h5")["tiles"].shape[1:] == (3, 9, 9)


def test_a_part_that_cannot_be_built_is_bad_input(own) -> None:
    with pytest.raises(InputError, match=r"mind\.strategy\.use: .*Unbuildable' cannot be built: TypeError"):
        own('mind.strategy={use="./mine.py:Unbuildable"}')
    with pytest.raises(InputError, match=r"mind\.strategy\.use: .*mine\.py' has no 'Missing'"):
        own('mind.strategy={use="./mine.py:Missing"}')


LACKING = """
from msgspec import Struct


class Lacks(Struct, frozen=True):
    def build(self, context):
        return self


class Fault(Struct, frozen=True):
    gives: bool = False

    def build(self, context):
        return self

    def install(self, parts):
        return None if self.gives else parts.nothing
"""


def test_parts_that_lack_what_their_seam_asks_for_are_bad_input(own) -> None:
    (own.path.parent / "lacking.py").write_text(LACKING)
    for keys, words in (
        (
            "mind.strategy={use='./lacking.py:Lacks'}",
            r"what .*Lacks' builds, .*Lacks, lacks requires_knowledge, step",
        ),
        (
            "mind.computation={use='./lacking.py:Lacks'}",
            r"lacks knowledge_type, codec, say, hear, reset, copy_from; expected",
        ),
        (
            "task={use='./lacking.py:Lacks'}",
            r"task\.use: .*lacks requires_knowledge, curve, measure, summaries; expected a task",
        ),
        ("network.topology={use='./lacking.py:Lacks'}", r"network\.topology\.use: .*lacks links"),
        ("faults=[{use='./lacking.py:Fault'}]", r"faults\[0\]\.use: .*cannot be installed: AttributeError"),
        (
            "faults=[{use='./lacking.py:Fault', gives=true}]",
            r"faults\[0\]\.use: .*installs NoneType; expected",
        ),
    ):
        with pytest.raises(InputError, match=words):
            own(keys)


PHASES = """
from dataclasses import replace

from msgspec import Struct


class Old(Struct, frozen=True):
    knowledge_type = requires_knowledge = codec = property(lambda self: None)

    def build(self, context):
        return self

    def install(self, parts):
        return replace(parts, strategy=self)

    def say(self, observations):
        pass

    def hear(self, observations):
        pass

    def step(self, observations):
        pass

    def reset(self, robots):
        pass

    def copy_from(self, robots, source):
        pass
"""


@pytest.mark.parametrize(
    ("key", "line"),
    [
        ("mind.computation={{{}}}", "def hear(self, senses, inbox):"),
        ("mind.strategy={{{}}}", "def step(self, senses, inbox, knowledge):"),
        ("faults=[{{{}}}]", "def step(self, senses, inbox, knowledge):"),
    ],
)
def test_a_mind_that_takes_other_phases_is_told_the_line_to_write(own, key: str, line: str) -> None:
    (own.path.parent / "old.py").write_text(PHASES)
    with pytest.raises(InputError) as refused:
        own(key.format("use='./old.py:Old'"))
    told = str(refused.value)
    assert f"expected '{line}'\n" in told
    assert "with the wrong parameters (observations)" in told
    assert f"in {line.split('(')[0][4:]}: {line.split('(')[0]}(self, observations):" in told  # its own line


def test_a_strangers_scenario_runs_no_code_unless_it_is_allowed(own, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(f"import pathlib\npathlib.Path({str(tmp_path / 'ran')!r}).touch()\n{PARTS}")
    asked = ["run", str(own.path), "--set", 'mind.computation={use="./mine.py:Honest"}', "--out", str(tmp_path / "run")]
    refused = CliRunner().invoke(app, asked)
    assert isinstance(refused.exception, InputError)
    assert "expected --allow-code" in str(refused.exception)
    assert not (tmp_path / "ran").exists()
    assert CliRunner().invoke(app, [*asked, "--allow-code"]).exit_code == 0
    assert (tmp_path / "ran").exists()


def test_knowledge_and_strategies_that_do_not_go_together_are_refused() -> None:
    with pytest.raises(
        InputError, match=r"mind\.strategy\.use: 'nearest-frontier' reads Maps, and 'heading-consensus'"
    ):
        made('mind.computation={use="heading-consensus"}')
    with pytest.raises(InputError, match=r"task\.use: 'alignment' reads Headings, and 'occupancy-grid' gives Maps"):
        made('task={use="alignment"}')


SCENARIOS = {
    "occupancy-grid": "room",
    "heading-consensus": "operations/turn",
    "average-consensus": "operations/average-consensus",
    "field-estimate": "operations/field",
    "reactive": "operations/wandering",
    "positions": "operations/rendezvous",
    "locate-source": "computing/buoys-disputed",
}
GOALS = ("market", "reserved-frontier")
RULES = [name for name, kind in registry.known("strategy").items() if issubclass(kind, Exploring)]
MINDS = [
    *(
        ("room", f'mind={{strategy={{use="{name}"}}, computation={{sharing={{use="{share}"}}}}}}')
        for name in RULES
        for share in ("tile-and-goal" if name in GOALS else "gossip",)
    ),
    *(("room", f'mind.computation.sharing={{use="{policy}"}}') for policy in registry.known("sharing")),
    ("room", 'mind={strategy={use="oracle-frontier"}, computation={sharing={use="tile-and-goal"}}}'),
    *((scenario, "seed=1") for name, scenario in SCENARIOS.items() if name != "occupancy-grid"),
    ("operations/heading-consensus", "seed=1"),
    ("operations/pursuit", "seed=1"),
    ("operations/moving-field", "robots.count=7"),
    ("computing/heat", "robots.count=4"),
    ("computing/stigmergy", "robots.count=4"),
    ("computing/buoys", "robots.count=3"),
    *((f"operations/{name}", "seed=2") for name in ("dispersion", "area-coverage", "perimeter", "formation", "lights")),
]
FAULTS = 'faults=[{use="crash", at=8, duration=6, count=1}]'


def path_of(scenario: str) -> Path:
    return ROOT / "scenarios" / f"{scenario}.toml"


def test_every_computation_strategy_and_task_is_tried() -> None:
    tried = [load(path_of(scenario), [key]) for scenario, key in MINDS]
    minds = [one.mind for scenario in tried for one in minds_of(scenario)]
    assert {mind.computation.use for mind in minds} == registry.known("computation").keys()
    assert {mind.strategy.use for mind in minds} == registry.known("strategy").keys()
    assert {scenario.task.use for scenario in tried} == registry.known("task").keys()


@pytest.mark.parametrize(("scenario", "key"), MINDS)
@pytest.mark.parametrize(
    "check",
    [
        testing.check_strictly,
        testing.check_determinism,
        testing.check_alone,
        testing.check_silence,
        testing.check_locality,
        testing.check_one_robot,
        testing.check_permutation,
    ],
)
def test_our_minds_and_tasks_keep_every_contract(scenario: str, key: str, check) -> None:
    keys = [key] if check is testing.check_alone else [key, FAULTS]
    keys += ALONE.get(scenario, []) if check is testing.check_alone else []
    check(path_of(scenario), keys)


#: What names more than one robot.
ALONE = {
    "operations/turn": ["mind.computation.leaders=[0]"],
    "operations/formation": ["mind.strategy.places=[[1.0, 0.0]]", "task.places=[[1.0, 0.0]]"],
}

NOSY = """
import numpy as np
from swarmsim.core.state import Measured


def herd(observations):
    \"\"\"Everybody drives as fast as robots are far apart, which nobody has told them.\"\"\"
    return np.tile([0.01 * np.ptp(observations.pose[:, 0]), 0.0], (len(observations.alive), 1))


def whim(moment):
    return Measured({"whim": 0.0, f"whim_{moment.state.iteration}": 1.0})


class Restless:
    calls = 0

    def step(self, me):
        Restless.calls += 1
        return me.drive(0.001 * Restless.calls)


class Lost:
    def step(self, me):
        return me.drive(np.nan)
"""


def test_the_checks_find_who_breaks_contracts(own, tmp_path: Path) -> None:
    (tmp_path / "nosy.py").write_text(NOSY)
    with pytest.raises(AssertionError, match="robot 0: does something else when others sense"):
        testing.check_locality(own.path, ['mind.strategy={use="./nosy.py:herd"}'], allow_code=True)
    with pytest.raises(AssertionError, match="two runs with the same seed differ in iteration 0"):
        testing.check_determinism(own.path, ['mind.strategy={use="./nosy.py:Restless"}'], allow_code=True)
    with pytest.raises(AssertionError, match=r"topology mine\.py:Links, iteration 0: links\[0\]: \[1, 1\]: a robot"):
        testing.check_strictly(own.path, ['network.topology={use="./mine.py:Links", rows=[[1, 1]]}'], allow_code=True)
    with pytest.raises(AssertionError, match="robot 0: 20 bytes announced, 21 packed"):
        testing.check_strictly(own.path, ['mind.computation={use="./mine.py:Short"}'], allow_code=True)
    with pytest.raises(AssertionError, match=r"task nosy\.py:whim, iteration 1: measure: .*expected the same names"):
        testing.check_strictly(own.path, ['task={use="./nosy.py:whim"}'], allow_code=True)
    with pytest.raises(AssertionError, match=r"strategy nosy\.py:Lost, iteration 0: robot 0: me\.drive: ahead: nan"):
        testing.check_contracts(own.path, ['mind.strategy={use="./nosy.py:Lost"}'], allow_code=True)
    testing.check_contracts(own.path, ['mind.computation={use="./mine.py:Honest"}'], allow_code=True)


SUMMARY = """
from msgspec import Struct
from swarmsim.core.parts import Curve
from swarmsim.core.state import Knowledge, Measured


class Gap(Struct, frozen=True):
    how: str

    def build(self, context):
        return Measuring(self.how)


class Measuring:
    requires_knowledge, curve = Knowledge, Curve("gap", "gap, m")

    def __init__(self, how):
        self.how = how

    def measure(self, moment):
        return Measured({"gap": 1.0})

    def summaries(self):
        return [Numbers(self.how)]


class Numbers:
    def __init__(self, how):
        self.how = how

    def sample(self, moment):
        pass

    def summary(self):
        return {"name": {"messages": 1}, "text": {"gap_end": "wide"}, "fine": {"gap_end": None}}[self.how]
"""


@pytest.mark.parametrize(
    ("how", "words"),
    [
        (
            "name",
            r"summary: 'messages' is measured of every run; expected another name, as 'own_messages' \(taken: bytes, ",
        ),
        ("text", r"summary: 'gap_end': 'wide'; expected a number, or None\n.*, in summary: def summary\(self\):"),
        ("none", r"KeyError: 'none'\n.*, in summary: return "),
    ],
)
def test_numbers_of_a_whole_run_do_not_stand_in_the_place_of_others(own, how: str, words: str) -> None:
    (own.path.parent / "gap.py").write_text(SUMMARY)
    run = own(f'task={{use="./gap.py:Gap", how="{how}"}}', "stop.iterations=2")
    (summary,) = run.simulation.parts.task.summaries()
    run.simulation.run([summary])
    with pytest.raises(PartError, match=rf"task gap\.py:Numbers, iteration 1: {words}"):
        summary.summary()
    fine = own('task={use="./gap.py:Gap", how="fine"}').simulation.parts.task.summaries()
    assert fine[0].summary() == {"gap_end": None}

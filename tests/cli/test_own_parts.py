"""Mistakes in parts that people write themselves: each ends in one message that names what to mend, and where."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from conftest import ROOT, called

from swarmsim.recording import layout

HEAD = """
import sys
from dataclasses import dataclass, replace

import numpy as np
from msgspec import Struct

from swarmsim.core.messages import MessageBatch, PlainCodec, Broadcast
from swarmsim.core.state import Estimates, Intents, Knowledge, Measured, Record


def nothing(moment):
    return 0.0


class Stander:
    def step(self, me):
        return None


"""
#: A scenario's keys for each kind of part that is tried, as `./mine.py:NAME`.
KEYS = {
    "mind": ("mind={{use={use}}}", 'task={{use="./mine.py:nothing"}}'),
    "strategy": ("mind.strategy={{use={use}}}",),
    "computation": (
        "mind.computation={{use={use}}}", 'mind.strategy={{use="stand"}}', 'task={{use="./mine.py:nothing"}}'
    ),
    "topology": ("network.topology={{use={use}}}",),
    "sensor": ("sensor={{use={use}}}",),
    "localisation": ("localisation={{use={use}}}",),
    "field": ("field={{use={use}}}",),
    "task": ("task={{use={use}}}",),
}  # fmt: skip


def mind(body: str, attributes: str = "", asked: str = "None") -> str:
    """A class with these lines, which decides `asked`."""
    lines = [*attributes.splitlines(), *body.splitlines()]
    return (
        "class Mine:\n"
        + "".join(f"    {line}\n" for line in lines)
        + f"    def step(self, me):\n        return {asked}\n"
    )


def saying(says: str, answer: str) -> str:
    return mind(f"def say(self, me):\n    return {answer}", f"message_fields = {says}")


def function(gives: str, arguments: str) -> str:
    return f"def mine({arguments}):\n    return {gives}\n"


def knowing(record: str, kind: str = "Known", fields: str = "energy: np.ndarray", given: str = "np.zeros(3)") -> str:
    """A computation whose knowledge has this field, or this record."""
    own = (
        f"\n    def arrays(self):\n        return ()\n\n    def record(self):\n        return {record}\n"
        if record
        else ""
    )
    return f"""
@dataclass(frozen=True, eq=False)
class {kind}({"Knowledge" if record else "Estimates"}):
    {fields}
{own}

@dataclass(frozen=True, slots=True, eq=False)
class Nothing(MessageBatch):
    none: np.ndarray


class Mine(Struct, frozen=True):
    def build(self, context):
        return Computation()


class Computation:
    knowledge_type = {kind}
    codec = PlainCodec(Nothing(np.zeros(0)))

    def say(self, senses):
        self.iteration = senses.iteration
        return Broadcast.each(Nothing(np.zeros(3)), self.codec.size)

    def hear(self, senses, inbox):
        return {kind}({given})

    def reset(self, robots):
        pass

    def copy_from(self, robots, source):
        pass
"""


def wrapping(verb: str, made: str, gives: str) -> str:
    """A part of one of ours, whose verb gives something else: `found` is what ours gives."""
    place, _, name = made.rpartition(".")
    return f"""
from {place} import {name}


class Mine(Struct, frozen=True):
    def build(self, context):
        return Wrapped({name}().build(context))


class Wrapped:
    def __init__(self, inner):
        self.inner = inner
        self.channels = getattr(inner, "channels", None)

    def {verb}(self, *given):
        found = self.inner.{verb}(*given)
        return {gives}
"""


FIELD = """
class Mine(Struct, frozen=True):
    noise: float = 0.0

    def build(self, context):
        return self

    def value(self, time, points):
        return np.ma.zeros(len(points)) if time == 3.0 else np.zeros(len(points))
"""
SENSOR, PERFECT = "swarmsim.robots.sensors.IrRing", "swarmsim.robots.localisation.Exact"
#: What is wrong, the part's seam, its code, the exit code and words that the message has, the line of code among them.
MISTAKES: dict[str, tuple[str, str, int, list[str]]] = {
    # What minds say
    "three values of four": (
        "mind",
        saying("{'a': 'f8', 'b': 'f8', 'c': 'f8', 'd': 'f8'}", "1.0, 2.0, 3.0"),
        3,
        ["robot 0: say gave 3 values, (1.0, 2.0, 3.0); expected 4", "a, b, c, d", "in say: def say(self, me):"],
    ),
    "one value of two": (
        "mind",
        saying("{'a': 'f8', 'b': 'f8'}", "1.0"),
        3,
        ["robot 0: say gave 1 value, 1.0; expected 2"],
    ),
    "a name that says lacks": (
        "mind",
        saying("{'yaw': 'f8'}", "{'yaws': 1.0}"),
        3,
        ["robot 0: say gave 'yaws'", "did you mean 'yaw'?", "in say"],
    ),
    "a name that say forgets": (
        "mind",
        saying("{'x': 'f8', 'y': 'f8'}", "{'x': 1.0}"),
        3,
        ["robot 0: say gave no y; expected", "x, y"],
    ),
    "text to say": (
        "mind",
        saying("{'yaw': 'f8'}", "'north'"),
        3,
        ["robot 0: say gave yaw: 'north'; expected a number", "in say"],
    ),
    "nothing to say": ("mind", saying("{'yaw': 'f8'}", "None"), 3, ["robot 0: say gave yaw: None; expected a number"]),
    "half a step": ("mind", saying("{'steps': 'i4'}", "2.5"), 3, ["robot 0: say gave steps: 2.5 does not fit int32"]),
    "too much for its type": ("mind", saying("{'far': 'i4'}", "1e30"), 3, ["say gave far: 1e+30 does not fit int32"]),
    "a masked value to say": (
        "mind",
        saying("{'a': 'f8', 'b': 'f8'}", "np.ma.array([1.0, 2.0], mask=[0, 1])"),
        3,
        ["robot 0: say gave 1 value, a masked array of float64"],
    ),
    "says as a tuple": (
        "mind",
        saying("('x', 'y')", "1.0, 2.0"),
        2,
        [
            "message_fields is ('x', 'y'); expected names with their types, as in {'x': 'f8'}",
            "in message_fields: message_fields = ('x', 'y')",
        ],
    ),
    "says with a type that is none": (
        "mind",
        saying("{'x': 'f9'}", "1.0"),
        2,
        ["message_fields: x: no type is called 'f9'", "known: ?, f4, f8", "in message_fields"],
    ),
    "says with objects": (
        "mind",
        saying("{'x': object}", "1.0"),
        2,
        ["message_fields: x: <class 'object'> holds no numbers"],
    ),
    "says a word of Python": (
        "mind",
        saying("{'class': 'f8'}", "1.0"),
        2,
        ["message_fields: 'class' cannot be a field", "in message_fields"],
    ),
    "says who sent it": (
        "mind",
        saying("{'sender': 'i4'}", "1"),
        2,
        ["message_fields: 'sender' is what messages have besides", "in message_fields"],
    ),
    "says how columns are taken": (
        "mind",
        saying("{'take': 'f8'}", "1.0"),
        2,
        ["message_fields: 'take' is what messages have besides"],
    ),
    "says without say": (
        "mind",
        mind("", "message_fields = {'x': 'f8'}"),
        2,
        ["Mine: expected both 'message_fields', the fields of a message, and 'say'"],
    ),
    # What minds show
    "shows what was never set": (
        "mind",
        mind("def __init__(self):\n    self.enrgy = 1.0", "recorded = ('energy',)"),
        3,
        [
            "robot 0 has no 'energy', which 'recorded' names; did you mean 'enrgy'?",
            "in recorded: recorded = ('energy',)",
        ],
    ),
    "shows one text": (
        "mind",
        mind("def __init__(self):\n    self.energy = 1.0", "recorded = 'energy'"),
        2,
        ["recorded is 'energy'; expected names, as in ('energy',)", "in recorded: recorded = 'energy'"],
    ),
    "shows text": (
        "mind",
        mind("mode = 'idle'", "recorded = ('mode',)"),
        3,
        ["robot 0 shows 'mode': 'idle', which is no number", "in recorded"],
    ),
    "shows what a task finds otherwise": (
        "mind",
        mind("minds = 1.0", "recorded = ('minds',)"),
        2,
        ["recorded: 'minds' is what a task finds otherwise"],
    ),
    "shows a method": ("mind", mind("", "recorded = ('step',)"), 2, ["recorded: 'step' is a method", "in recorded"]),
    # What minds decide
    "drives at no number": (
        "mind",
        mind("", asked="me.drive(float('nan'), 0) if me.iteration == 2 and me.id == 1 else None"),
        3,
        [
            "strategy mine.py:Mine, iteration 2: robot 1: me.drive: ahead: nan, which is not finite",
            "in step: return me.drive(",
        ],
    ),
    "turns at infinity": (
        "mind",
        mind("", asked="me.drive(0.1, np.inf)"),
        3,
        ["robot 0: me.drive: turn: inf", "in step: return"],
    ),
    "heads for no number": (
        "mind",
        mind("", asked="me.head(np.nan, 0.1)"),
        3,
        ["robot 0: me.head: yaw: nan", "in step: return"],
    ),
    "heads for infinity": (
        "mind",
        mind("", asked="me.head(np.inf, 0.1)"),
        3,
        ["robot 0: me.head: yaw: inf", "in step: return"],
    ),
    "heads at no number": (
        "mind",
        mind("", asked="me.head(0.0, np.nan)"),
        3,
        ["robot 0: me.head: ahead: nan", "in step: return"],
    ),
    "drives at a word": (
        "mind",
        mind("", asked="me.drive('fast')"),
        3,
        ["robot 0: me.drive: ahead: 'fast', which is no number"],
    ),
    "drives at what is masked": (
        "mind",
        mind("", asked="me.drive(np.ma.masked)"),
        3,
        ["robot 0: me.drive: ahead: masked, which is no number"],
    ),
    "goes to no number": (
        "mind",
        mind("", asked="me.go((np.nan, 0.0))"),
        3,
        ["robot 0: me.go: (nan, 0.0)", "finite", "in step: return"],
    ),
    "goes to three numbers": (
        "mind",
        mind("", asked="me.go((1.0, 2.0, 3.0))"),
        3,
        ["robot 0: me.go:", "of shape (1, 3)", "in step: return"],
    ),
    "goes nowhere": ("mind", mind("", asked="me.go([])"), 3, ["robot 0: me.go: [", "expected a place (2,)"]),
    "goes to what is masked": (
        "mind",
        mind("", asked="me.go(np.ma.array([1.0, 2.0], mask=[0, 1]))"),
        3,
        ["robot 0: me.go: a masked array"],
    ),
    "gives a tuple": (
        "mind",
        mind("", asked="(0.1, 0.2)"),
        3,
        ["robot 0: step gave (0.1, 0.2); expected me.drive(...)", "in step: def step(self, me):"],
    ),
    "misspells a field of me": (
        "mind",
        mind("", asked="me.drive(me.spede)"),
        3,
        ["has no attribute 'spede'; did you mean 'speed'?", "robot 0", "in step: return"],
    ),
    "forgets me": (
        "mind",
        "class Mine:\n    def step(self):\n        return None\n",
        3,
        ["robot 0", "in step: def step(self):"],
    ),
    "leaves": (
        "mind",
        mind("", asked="sys.exit(0)"),
        3,
        ["strategy mine.py:Mine, iteration 0: SystemExit: 0, robot 0", "in step: return sys.exit(0)"],
    ),
    # Functions that decide
    "no numbers for all": (
        "strategy",
        function("np.full((3, 2), np.nan)", "observations"),
        3,
        ["twists[0]: robot 0 at [nan, nan]", "in mine: def mine("],
    ),
    "no number for one": (
        "strategy",
        function("np.array([[0.1, 0.0], [0.1, np.nan], [0.0, 0.0]])", "observations"),
        3,
        ["strategy mine.py:mine, iteration 0: twists[1]: robot 1 at [0.1, nan]", "0 to stand"],
    ),
    "a masked array to do": (
        "strategy",
        function("np.ma.zeros((3, 2))", "observations"),
        3,
        ["mine gave a masked array", "(3, 2)"],
    ),
    "too few rows": (
        "strategy",
        function("np.zeros((2, 2))", "observations"),
        3,
        ["shape (2, 2); expected", "(3, 2)", "in mine"],
    ),
    "changes what it is given": (
        "strategy",
        "def mine(observations):\n    place = observations.pose[:, :2]\n    place -= place.mean(axis=0)\n",
        3,
        ["read-only", "in mine: place -= place.mean(axis=0)"],
    ),
    "a goal that is nowhere": (
        "strategy",
        "def mine(observations):\n    found = Intents.twisting(np.zeros((3, 2)))\n"
        "    return replace(found, goals=np.full((3, 2), np.inf))\n",
        3,
        ["goals[0]: [inf, inf]; expected x, y in m, or NaN twice for none", "in mine"],
    ),
    "a goal as a cell": (
        "strategy",
        "def mine(observations):\n    found = Intents.twisting(np.zeros((3, 2)))\n"
        "    return replace(found, goals=np.full((3, 2), 4, np.int32))\n",
        3,
        ["goals: int32 of shape (3, 2); expected float64", "points in m, not cells", "in mine"],
    ),
    # Tasks
    "done as a text": (
        "task",
        function("(1.0, 'no')", "moment"),
        3,
        ["mine gave (1.0, 'no')", "True or False", "in mine: def mine(moment):"],
    ),
    "done as a number": ("task", function("(1.0, 2)", "moment"), 3, ["mine gave (1.0, 2); expected"]),
    "three things": ("task", function("(1.0, True, 3)", "moment"), 3, ["mine gave (1.0, True, 3); expected"]),
    "a table": (
        "task",
        function("{'gap': 1.0}", "moment"),
        3,
        ["mine gave {'gap': 1.0}; expected a number", "Measured", "in mine"],
    ),
    "a text": ("task", function("'1.0'", "moment"), 3, ["mine gave '1.0'; expected a number"]),
    "nothing at all": ("task", function("None", "moment"), 3, ["mine gave None; expected a number"]),
    "an array": (
        "task",
        function("np.zeros(3)", "moment"),
        3,
        ["mine gave an array of float64 and shape (3,); expected a number"],
    ),
    "what is masked": ("task", function("np.ma.masked", "moment"), 3, ["mine gave masked; expected a number"]),
    "a number that is too large": ("task", function("10**400", "moment"), 3, ["mine gave 1000", "expected a number"]),
    "a text among measures": (
        "task",
        function("Measured({'mine': 'x'})", "moment"),
        3,
        ["values['mine']: 'x'; expected a number", "in mine"],
    ),
    "masked measures of robots": (
        "task",
        function("Measured({'mine': 1.0}, {'far': np.ma.zeros(3)})", "moment"),
        3,
        ["robots['far']: a masked array", "in mine"],
    ),
    "progress beyond all": (
        "task",
        function("Measured({'mine': 1.0}, {}, 1.5)", "moment"),
        3,
        ["progress: 1.5; expected a number from 0 to 1"],
    ),
    "progress of no number": (
        "task",
        function("Measured({'mine': 1.0}, {}, np.nan)", "moment"),
        3,
        ["progress: nan; expected"],
    ),
    "finished as a text": (
        "task",
        function("Measured({'mine': 1.0}, {}, 0.0, 'no')", "moment"),
        3,
        ["finished: 'no'; expected True or False"],
    ),
    "not what its curve is about": (
        "task",
        function("Measured({'main': 1.0})", "moment"),
        3,
        ["values: ", "expected 'mine', which the task's curve"],
    ),
    "a measure whose name is taken": (
        "task",
        function("Measured({'mine': 1.0, 'alive': 2.0})", "moment"),
        3,
        ["measure: 'alive' names a table", "'own_alive'", "in mine"],
    ),
    "robots' measures whose name is taken": (
        "task",
        function("Measured({'mine': 1.0}, {'pose': np.zeros(3)})", "moment"),
        3,
        ["measure: 'pose' names a table", "'own_pose'"],
    ),
    "a measure that is a path": (
        "task",
        function("Measured({'mine': 1.0, 'a/b': 2.0})", "moment"),
        3,
        ["'a/b' cannot be the name of a table"],
    ),
    # Computations
    "a masked array to know": (
        "computation",
        function("np.ma.zeros(3)", "observations, value"),
        3,
        ["mine gave a masked array of", "in mine"],
    ),
    "a text to know": (
        "computation",
        function("'x'", "observations, value"),
        3,
        ["mine gave 'x'; expected an array of numbers", "in mine"],
    ),
    "one number for all": (
        "computation",
        function("1.0", "observations, value"),
        3,
        ["mine gave 1.0, of shape (); expected", "(3)"],
    ),
    "masked knowledge": (
        "computation",
        knowing("", given="np.ma.zeros(3)"),
        3,
        ["Known: a masked array", "in hear: def hear(self, senses, inbox):"],
    ),
    "a list as knowledge": (
        "computation",
        knowing("", given="[0.0, 0.0, 0.0]"),
        3,
        ["Known: [0.0, 0.0, 0.0]; expected a plain array"],
    ),
    "texts as knowledge": (
        "computation",
        knowing("", given="np.array(['a', 'b', 'c'])"),
        3,
        ["Known: an array of <U1; expected numbers"],
    ),
    "knowledge that grows": (
        "computation",
        knowing("", given="np.zeros((3, 1 + self.iteration))"),
        3,
        ["iteration 1: hear: 'energy' is float64 of shape (3, 2) after float64 of shape (3, 1)"],
    ),
    "records what is taken": (
        "computation",
        knowing("Record({'pose': np.full((3, 3), 99.0)})"),
        3,
        ["hear: 'pose' names a table", "'own_pose'", "in hear"],
    ),
    "records headings of another form": (
        "computation",
        knowing("Record({'heading': np.zeros((3, 2))})"),
        3,
        ["hear: 'heading' is float64 of shape (3, 2); expected float64 of (3,)"],
    ),
    "what the task gives as well": (
        "computation",
        knowing("", fields="nothing: np.ndarray"),
        2,
        ["measures 'nothing': 'nothing' is already recorded by the computation"],
    ),
    # Others
    "masked links": (
        "topology",
        function("np.ma.array([[0, 1]], dtype=np.int32)", "state"),
        3,
        ["links: MaskedArray; expected", "in mine"],
    ),
    "a list of links": (
        "topology",
        function("[(0, 1)]", "state"),
        3,
        ["links: list; expected an array, int32", "in mine: def mine(state):"],
    ),
    "masked tiles": (
        "sensor",
        wrapping("sense", SENSOR, "found.having({'tiles.values': np.ma.array(found.tiles.values)})"),
        3,
        [
            "sensor mine.py:Wrapped, iteration 0: tiles.values: MaskedArray; expected",
            "in sense: def sense(self, *given):",
        ],
    ),
    "other readings than declared": (
        "sensor",
        wrapping("sense", SENSOR, "type(found)()"),
        3,
        ["sense: gives nothing; expected what it declares, tiles", "in sense: def sense(self, *given):"],
    ),
    "tiles of no known value": (
        "sensor",
        wrapping("sense", SENSOR, "found.having({'tiles.values': found.tiles.values + np.uint8(7)})"),
        3,
        ["tiles.values: ", " at [0, 0, 0]; expected 0 to 2"],
    ),
    "two things instead of one": (
        "localisation",
        wrapping("locate", PERFECT, "(found, found)"),
        3,
        ["locate: tuple; expected an array, float64 of shape (3, 3)", "in locate"],
    ),
    "a masked field": (
        "field",
        FIELD,
        3,
        ["field mine.py:Mine, iteration 3: value: MaskedArray", "in value"],
    ),
    "leaves while it is read": (
        "mind",
        "sys.exit(0)\n" + mind(""),
        2,
        ["mine.py:Mine' cannot be imported", "SystemExit: 0", "in <module>: sys.exit(0)"],
    ),
    "fails while it is read": (
        "mind",
        "LIMIT = 1 / 0\n" + mind(""),
        2,
        ["cannot be imported", "ZeroDivisionError", "in <module>: LIMIT = 1 / 0"],
    ),
    "is misspelt": (
        "mind",
        mind("").replace("Mine", "Mien"),
        2,
        ["mine.py' has no 'Mine'; did you mean 'Mien'? Known: "],
    ),
}


def tried(tmp_path: Path, seam: str, code: str) -> tuple[int, str]:
    """The exit code and the message of a short run with a part of one's own."""
    (tmp_path / "mine.py").write_text(HEAD + code)
    room = (ROOT / "scenarios" / "room.toml").read_text().replace("../worlds", str(ROOT / "worlds"))
    (tmp_path / "room.toml").write_text(room)
    name = '"./mine.py:mine"' if re.search(r"def mine\(|\nmine =", code) else '"./mine.py:Mine"'
    sets = [word for key in KEYS[seam] for word in ("--set", key.format(use=name))]
    sets += ["--set", "stop.iterations=5"]
    done = called("run", tmp_path / "room.toml", *sets, "--allow-code", "--out", tmp_path / "out")
    return done.returncode, done.stderr


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_told_by_part_field_and_line(tmp_path: Path, mistake: str) -> None:
    seam, code, ends, words = MISTAKES[mistake]
    exit_code, told = tried(tmp_path, seam, code)
    for word in words:
        assert word in told, told
    assert exit_code == ends
    assert told.count("swarmsim: ") == 1
    assert "mine.py" in told
    for never in ("Traceback", "swarmsim_own_", str(ROOT / "swarmsim"), "<frozen", "not a whole recording"):
        assert never not in told
    for file, line in re.findall(r"\n  (\S+), line (\d+), in ", told):  # that is a line of the part's own file
        assert Path(file) == tmp_path / "mine.py"
        assert int(line) <= len((HEAD + code).splitlines())


TAKEN = sorted(name for name, table in layout.TABLES.items() if not table.by)


@pytest.mark.parametrize("name", [*TAKEN, "energy_end", "links_end"])
def test_names_of_the_recording_are_refused_before_anything_runs(tmp_path: Path, name: str) -> None:
    """Whatever the recording has: what minds show, what robots know, and what tasks measure cannot be called so."""
    other = name.removesuffix("_end") + "_last" if name.endswith("_end") else f"own_{name}"
    shown = mind(f"def __init__(self):\n    self.{name} = 0.5", f"recorded = ('{name}',)")
    for seam, code, where in (
        ("mind", shown, f"in recorded: recorded = ('{name}',)"),
        ("computation", knowing("", fields=f"{name}: np.ndarray"), f"in {name}: {name}: np.ndarray"),
        ("task", function("1.0", "moment").replace("mine", name), f"in {name}: def {name}(moment):"),
    ):
        folder = tmp_path / seam
        folder.mkdir()
        exit_code, told = tried(folder, seam, code + ("\n\nmine = " + name if seam == "task" else ""))
        assert exit_code == 2, told
        assert f"{name!r}" in told
        assert f"'{other}'" in told
        assert where in told
        assert not (folder / "out").exists()

"""What a robot is told before it starts: all that its mind is built from, and nothing of the world."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Annotated, Any, Final, Literal, Self

import msgspec
import numpy as np
from msgspec import UNSET, Meta, Struct
from numpy.typing import NDArray

from swarmsim.core.building import Building, Survey
from swarmsim.core.context import BuildContext
from swarmsim.core.errors import InputError
from swarmsim.core.kinematics import Drives, Floats, Wheels
from swarmsim.core.lattice import Lattice
from swarmsim.core.parts import Fault
from swarmsim.core.readings import Channel, Channels
from swarmsim.core.scenario.decoding import convert
from swarmsim.core.scenario.file import Mind, Scenario, table_of
from swarmsim.core.scenario.part import NONE, Part, plain
from swarmsim.core.scenario.robots import LONGEST, Robots
from swarmsim.core.streams import Streams

VERSION: Final = 1  #: of charges, and of the telegrams between a world and its robots
MOST: Final = 64 * 1024 * 1024  # bytes of a charge
#: The keys of a fault's timeline, which the world keeps: when, and whom.
TIMES: Final = frozenset(
    ("at", "every", "between", "progress", "rate", "life", "duration", "duty", "robots", "group", "count", "fraction",
     "target", "point", "region", "min_alive")
)  # fmt: skip
Pose = tuple[float, float, float]  # m, m, rad


class MindsFault(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A fault that a robot has in its mind while the world says so."""

    number: Annotated[int, Meta(ge=0, le=LONGEST)]  # its place in the scenario
    fault: Part[Fault]  # without its timeline

    @classmethod
    def all_of(cls, scenario: Scenario) -> tuple[Self, ...]:
        """Those of a scenario: what its parts declare to be `of_mind`."""
        return tuple(
            cls(number=number, fault=Part("fault", {"use": one.use, "at": 0, **_untimed(one)}))
            for number, one in enumerate(scenario.faults)
            if one.declares("of_mind", False)
        )


def _untimed(fault: Part[Fault]) -> dict[str, object]:
    """A fault's own keys, without those of when and whom."""
    given = {key: getattr(fault.parameters, key) for key in fault.parameters.__struct_fields__ if key not in TIMES}
    return {key: value for key, value in given.items() if value is not None}


class Charge(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One robot's charge: its number, body, lattice, period, seed and mind, and how it fits into its swarm."""

    version: Literal[1]
    robot: Annotated[int, Meta(ge=0, lt=LONGEST)]  # its number
    scenario: str  # digest of the whole scenario: only robots of one and the same go together
    title: str
    robots: Robots  # their number and bodies
    mind: Mind
    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    period: Annotated[float, Meta(ge=1e-4, le=1e5)]  # s, one iteration
    lattice: tuple[float, float, float, int, int]  # m, m, m, rows, columns: see `Lattice`
    bounds: tuple[float, float, float, float]  # m: left, lower, right, upper edge of the page
    starts: tuple[Pose, ...]  # of all robots, for placing what is heard
    channels: tuple[Channel, ...]  # of the swarm's sensors
    actuators: tuple[Channel, ...]
    sideways: tuple[bool, ...] | None = None  # which of all robots can move sideways; None: none
    faults: tuple[MindsFault, ...] = ()  # of its mind
    field: bool = False  # whether there is a field to measure
    broadcasts: bool = False  # whether a message is charged once, however many robots hear it

    def __post_init__(self) -> None:
        if self.robot >= self.robots.count or len(self.starts) != self.robots.count:
            raise ValueError(f"robot: {self.robot}, and {len(self.starts)} starts; the swarm has {self.robots.count}")
        if self.lattice[2] <= 0.0 or min(self.lattice[3:]) < 1 or self.lattice[3] * self.lattice[4] > LONGEST * 250:
            raise ValueError("lattice: no lattice of 25 000 000 cells or fewer")

    @classmethod
    def of(cls, robot: int, scenario: Scenario, context: BuildContext) -> Self:
        """The charge of one robot of a run, from the run's scenario and its context for all parts."""
        bare = {"sensor": NONE, "sensors": UNSET, "kinematics": UNSET}  # of the world's side
        groups = tuple(msgspec.structs.replace(group, **bare) for group in scenario.robots.groups)
        drives, lattice = context.kinematics, context.lattice
        sideways = drives is not None and drives.sideways.any()
        return cls(
            version=1, robot=robot, scenario=digest_of(scenario), title=scenario.title,
            robots=msgspec.structs.replace(scenario.robots, groups=groups), mind=scenario.mind, seed=scenario.seed,
            faults=MindsFault.all_of(scenario), period=context.period,
            lattice=(lattice.x0, lattice.y0, lattice.cell, lattice.rows, lattice.columns),
            bounds=context.building.bounds, starts=tuple((x, y, yaw) for x, y, yaw in context.starts.tolist()),
            channels=tuple(context.channels), actuators=tuple(context.actuators),
            sideways=tuple(drives.sideways.tolist()) if drives is not None and sideways else None,
            field=context.scalar_field is not None, broadcasts=context.broadcasts,
        )  # fmt: skip

    def packed(self) -> bytes:
        """As a file: MessagePack, which unlike JSON has infinite numbers."""
        return msgspec.msgpack.encode(self, enc_hook=_plain)

    @classmethod
    def read(cls, data: bytes, name: str) -> Self:
        """The charge in a file's bytes. Raises InputError, which names the file or sender `name` and the key."""
        try:
            if len(data) > MOST:
                raise InputError(f"{len(data)} bytes; expected {MOST} at most")
            table: Any = msgspec.msgpack.decode(data)
            if not isinstance(table, dict) or table.get("version") != VERSION:
                given = table.get("version") if isinstance(table, dict) else None
                raise InputError(f"version: {given!r}; expected {VERSION}, which `swarmsim robot charge` writes")
            lists = {key: table.pop(key, ()) for key in ("channels", "actuators")}  # which may hold infinite numbers
            found = convert({**table, "channels": (), "actuators": ()}, cls, lambda part: part)
            columns = {key: msgspec.convert(given, tuple[Channel, ...]) for key, given in lists.items()}
            return msgspec.structs.replace(found, **columns)
        except (msgspec.DecodeError, RecursionError, UnicodeDecodeError) as problem:
            raise InputError(
                f"{name}: is no charge of a robot ({problem}); expected what `swarmsim robot charge` writes"
            ) from problem
        except InputError as problem:
            raise InputError(f"{name}: {problem}") from problem

    @classmethod
    def open(cls, path: Path) -> Self:
        """The charge in a file. Raises InputError."""
        try:
            return cls.read(path.read_bytes(), str(path))
        except OSError as problem:
            raise InputError(f"{path}: cannot be read ({problem.strerror}); expected a charge") from problem

    def context(self, *others: int) -> BuildContext:
        """The context that this robot's mind is built in: one row, under its number, and a building without walls.

        With `others`, that of these robots instead.
        """
        ids, lattice = np.array(others or [self.robot]), Lattice(*self.lattice)
        nothing = np.zeros(lattice.shape, np.bool_)
        survey = Survey(np.empty((0, 4)), nothing, np.empty((0, 2)), lambda: nothing)
        return BuildContext(
            self.robots.crew(ids), ids, self.robots.count, lattice, self.period, Streams(self.seed),
            Building(survey, lambda boxes: survey, bounds=self.bounds, lattice=lattice),
            np.array(self.starts, np.float64).reshape(-1, 3), Unmeasured() if self.field else None,
            broadcasts=self.broadcasts, actuators=Channels(*self.actuators), channels=Channels(*self.channels),
            kinematics=None if self.sideways is None else _drives(self.sideways),
        )  # fmt: skip


def _plain(value: object) -> object:
    return value.item() if isinstance(value, np.generic) else plain(value)


def digest_of(scenario: Scenario) -> str:
    """A scenario's digest: robots with equal ones belong together."""
    world = msgspec.structs.replace(scenario.world, file=scenario.world.file.replace("\\", "/").rpartition("/")[2])
    table = table_of(msgspec.structs.replace(scenario, world=world))
    return hashlib.blake2b(msgspec.json.encode(table, order="deterministic"), digest_size=16).hexdigest()


class Unmeasured:
    """A field that a robot knows from its sensor alone."""

    def value(self, time: float, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Never known here. Raises InputError."""
        raise InputError("use: needs the true field, which no robot has; expected samples of its sensor")


class _Elsewhere:
    """Wheels that are not on this side of the wire."""

    columns: tuple[tuple[str, str], ...] = ()

    def command(self, twists: Floats) -> Floats:
        return twists

    def approach(self, aims: Floats) -> Floats:
        return aims

    def forces(self, moving: Floats, wheels: Floats, wanted: Floats, dt: float) -> tuple[Floats, Floats]:
        return wheels, moving


def _drives(sideways: tuple[bool, ...]) -> Drives:
    """What minds may know of the wheels of all robots."""
    kinds = [Wheels("", _Elsewhere(), slice(row, row + 1), able, 0.0) for row, able in enumerate(sideways)]
    return Drives(kinds)

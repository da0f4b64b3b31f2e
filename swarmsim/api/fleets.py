"""Fleets: a scenario whose robots are processes of their own."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, final

import msgspec

from swarmsim.api.overrides import Overrides
from swarmsim.api.recorded import Run
from swarmsim.api.runs import new_folder, record, scenario_of, summarise
from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError, unwritten
from swarmsim.core.parts import Observer
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.files import write_whole
from swarmsim.core.state import Knowledge, Moment
from swarmsim.engine.build import build
from swarmsim.fleet import merging, remembered, running
from swarmsim.fleet.control import EndAskedError, WorldControl
from swarmsim.fleet.running import Fleet, FleetNews, Up
from swarmsim.fleet.terms import Links

_STRIKE: Final = re.compile(r"(?P<robots>\d+(,\d+)*)@(?P<at>\d+)(:(?P<lasts>\d+))?")
Pace = float | Literal["lockstep"]


def assembled(
    scenario: Path,
    seed: int | None = None,
    overrides: Overrides | None = None,
    faults: Sequence[str] = (),
    pace: Pace = "lockstep",
    links: Links = "simulated",
    local: bool = True,
) -> Fleet:
    """A scenario's run, whose robots are elsewhere, or on this machine if `local`. Raises InputError."""
    times = None if pace == "lockstep" else float(pace)
    return running.assembled(scenario_of(scenario, seed, overrides, faults), str(scenario), times, links, local)


def flown(
    fleet: Fleet,
    folder: Path,
    transport: str,
    link: Sequence[str] = (),
    observers: Sequence[Observer] = (),
    at: str | None = None,
    control: str | None = None,
) -> Run:
    """Run a fleet to its end into a folder, whose processes log into `logs` there.

    Its robots are started on this machine or, with an address to meet `at`, come there by themselves. At an address for
    its `control` it is paused and stepped.

    `fleet.json` there names the processes and tells how it goes. Raises InputError for what cannot work and PartError
    for a robot that fails.
    """
    log = folder / "logs"
    joined = (
        running.up(fleet, transport, None, log, link) if at is None else running.served(fleet, transport, at, log, link)
    )
    with joined as there:
        status = Status(there, transport, folder / "fleet.json")
        try:
            with controlled(fleet, control) as asked:
                return record(fleet.run, folder, [status, *asked, *observers])
        except EndAskedError:
            return summarise(folder)
        finally:
            status.write()


@contextmanager
def controlled(fleet: Fleet, address: str | None) -> Iterator[Sequence[Observer]]:
    """The observer through which a fleet is controlled at an address, once it is asked to begin; none without one.

    Raises InputError.
    """
    if address is None:
        yield ()
        return
    if not fleet.terms.lockstep:
        raise InputError("--control: at a pace the clock says when iterations begin; expected --pace lockstep")
    run = fleet.run
    parts, page = run.simulation.parts, run.context.building.bounds
    with closing(WorldControl(address, parts.bodies, run.context.period, page)) as control:
        control.begin()
        yield (control,)


@final
class Status:
    """An observer that writes how a fleet goes into a file, about twice a second."""

    def __init__(self, there: Up, transport: str, file: Path) -> None:
        self._there, self._transport, self._file = there, transport, file
        self._iteration, self._due = 0, 0.0
        self.write()

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Note the iteration."""
        self._iteration = moment.state.iteration
        if time.monotonic() >= self._due:
            self.write()

    def write(self) -> None:
        """Write the file."""
        self._due = time.monotonic() + 0.5
        told = msgspec.json.encode(self._there.news(self._transport, self._iteration))
        write_whole(self._file, msgspec.json.format(told).decode() + "\n")


def fleet_up(
    scenario: str | Path,
    out: str | Path,
    *,
    pace: Pace = "lockstep",
    links: Links = "simulated",
    transport: str = "zenoh",
    link: Sequence[str] = (),
    kill: Sequence[str] = (),
    pause: Sequence[str] = (),
    late: Sequence[str] = (),
    seed: int | None = None,
    overrides: Overrides | None = None,
    faults: Sequence[str] = (),
    control: str | None = None,
    allow_code: bool = False,
) -> Run:
    """Simulate a scenario whose robots are processes of their own, on this machine: `swarmsim fleet up`.

    The recording goes into the new folder `out`. `transport` carries frames: udp, zenoh, or an installed part, with
    keys of its own in `link`: ["interface=eth0"]. At the `pace` lockstep every iteration waits for every robot; at a
    number, so many times real time, nobody waits, faults of bodies and frozen minds strike the processes, and with
    `links` real robots hear what arrives. `kill`, `pause` and `late` are such faults as in ["1,3@200", "2@400:80"]:
    robots, an iteration, and for how many. At an address for its `control`, HOST:PORT, the world begins paused and
    answers services of ROS 2's simulation_interfaces, over keys of zenoh. `seed`, `overrides`, `faults` and
    `allow_code` are those of `run`. Raises InputError for what cannot work and PartError for a robot that fails.
    """
    with registry.own_code(allow_code):
        struck = strikes(kill, pause, late)
        fleet = assembled(Path(scenario), seed, overrides, [*struck, *faults], pace, links)
        return flown(fleet, new_folder(Path(out)), transport, link, control=control)


def world_serve(
    scenario: str | Path,
    out: str | Path,
    *,
    at: str = "127.0.0.1:7447",
    pace: Pace = "lockstep",
    links: Links = "simulated",
    transport: str = "zenoh",
    link: Sequence[str] = (),
    faults: Sequence[str] = (),
    seed: int | None = None,
    overrides: Overrides | None = None,
    control: str | None = None,
    allow_code: bool = False,
) -> Run:
    """Simulate a world whose robots come to the address `at`, from any machine: `swarmsim world serve`.

    It waits until all have come. The other parameters are those of `fleet_up`; faults act in the simulated world, since
    the robots' processes are not its own. Raises InputError and PartError as `fleet_up` does.
    """
    with registry.own_code(allow_code):
        fleet = assembled(Path(scenario), seed, overrides, faults, pace, links, local=False)
        return flown(fleet, new_folder(Path(out)), transport, link, at=at, control=control)


@dataclass(frozen=True, slots=True)
class Merged:
    """A recording made of logs."""

    run: Run
    lacks: str  # what the logs lack of the whole run, in words; empty for nothing
    offsets: dict[int, float]  # s, by how much each robot's clock is ahead of the first one's


def fleet_merge(
    logs: str | Path,
    out: str | Path,
    *,
    scenario: str | Path | None = None,
    seed: int | None = None,
    overrides: Overrides | None = None,
    allow_code: bool = False,
) -> Merged:
    """Make one recording of a fleet's logs alone, in the new folder `out`: `swarmsim fleet merge`.

    With the world's log it is that of the run itself. With a `scenario`, and its `seed` and `overrides`, the robots'
    logs are enough: the poses are those that they believed, and the recording tells what is absent. `allow_code` is
    that of `run`. Raises InputError for what cannot work.
    """
    folder = Path(logs)
    with registry.own_code(allow_code):
        if scenario is None:
            if not (folder / running.WORLD_LOG).exists():
                raise InputError(
                    f"{folder}: holds no log of a world; expected --scenario, the file that robots were told"
                )
            made = merging.replayed(folder)
        else:
            made = remembered.remembered(folder, scenario_of(Path(scenario), seed, overrides), str(scenario))
        target = new_folder(Path(out))
        with made.fleet.run.recorder(
            target / "recording.h5", () if scenario is None else remembered.ABSENT
        ) as recorder:
            lacks = made.simulate([recorder])
    return Merged(summarise(target), lacks, remembered.offsets(made.logs))


def fleet_status(run: str | Path) -> FleetNews:
    """How a fleet goes: processes, iteration, late ones, and what was dropped, by reason: `swarmsim fleet status`.

    `run` is the folder of its recording. `alive` tells of each process whether it is there. Raises InputError for no
    fleet.
    """
    file = Path(run) / "fleet.json"
    try:
        told = msgspec.json.decode(file.read_bytes(), type=FleetNews)
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as problem:
        raise InputError(f"{file}: cannot be read ({problem}); expected the folder of a run by `fleet up`") from problem
    alive = {name: Path(f"/proc/{pid}").exists() for name, pid in told.processes.items()}
    return msgspec.structs.replace(told, alive=alive)


def robot_charge(
    scenario: str | Path,
    out: str | Path,
    *,
    id_: int = 0,
    seed: int | None = None,
    overrides: Overrides | None = None,
    allow_code: bool = False,
) -> Path:
    """Write all that the robot with the number `id` is told to the file `out`: `swarmsim robot charge`.

    `scenario`, `seed`, `overrides` and `allow_code` are those of `run`. Raises InputError, and StorageError for a full
    disk.
    """
    file = Path(out)
    with registry.own_code(allow_code):
        made = build(scenario_of(Path(scenario), seed, overrides), str(scenario))
        if not 0 <= id_ < made.context.swarm:
            last = made.context.swarm - 1
            raise InputError(f"--id {id_}: {scenario} has robots 0 to {last}; expected one of these")
        told = Charge.of(id_, made.scenario, made.context).packed()
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(told)
    except OSError as problem:
        raise unwritten(f"--out {file}", problem) from problem
    return file


def pace_of(text: str) -> Pace:
    """The pace in an option. Raises InputError."""
    if text == "lockstep":
        return "lockstep"
    try:
        times = float(text)
    except ValueError:
        times = -1.0
    if not 1e-3 <= times <= 1e4:
        raise InputError(f"--pace {text}: expected lockstep, or how many times real time, from 0.001 to 10000")
    return times


def strikes(kill: Sequence[str] = (), pause: Sequence[str] = (), late: Sequence[str] = ()) -> list[str]:
    """The faults, in words, that options stand for, as in `1,3@200` or `2@400:80`. Raises InputError."""
    kinds = (
        ("kill", kill, "crash min_alive=0 at={at} robots=[{robots}]"),
        ("pause", pause, "mind frozen min_alive=0 at={at} robots=[{robots}]"),
        ("late", late, "remove min_alive=0 between=[0,{at}] robots=[{robots}]"),
    )
    found = []
    for option, texts, words in kinds:
        for text in texts:
            matched = _STRIKE.fullmatch(text)
            if matched is None or (option == "late" and matched["lasts"]):
                lasts = "" if option == "late" else " or 1,3@200:80, so many iterations"
                raise InputError(f"--{option} {text}: expected robots and an iteration, as in 1,3@200{lasts}")
            found.append(words.format(**matched.groupdict()))
            if matched["lasts"]:
                found[-1] += f" duration={matched['lasts']}" + (" map=lost" if option == "kill" else "")
    return found

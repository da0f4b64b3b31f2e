"""The oracles catch what they are there for: each fault that is planted here is found among the first scenarios."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from generated.test_generated_scenarios import SCENARIOS
from generated.trials import tried_all

from swarmsim.core.bundle import Bundle, EnvelopeCodec
from swarmsim.core.messages import Broadcast, Delivery, Inbox, MessageBuffer
from swarmsim.core.state import FREE, UNKNOWN
from swarmsim.engine.exchange import Exchange
from swarmsim.jobs.facts.wire import FactCodec
from swarmsim.jobs.reports import AFAR, SHOW
from swarmsim.network.channel import PerfectChannel
from swarmsim.network.delays import LatentChannel
from swarmsim.network.losses import LossyChannel
from swarmsim.operations.mapping.grids import OccupancyGrids
from swarmsim.operations.mapping.measures.coverage import CoverageTask
from swarmsim.robots.bodies import RigidDiscs
from swarmsim.robots.sensors import IrRingSensor

Plant = Callable[[pytest.MonkeyPatch], None]


def wrapped(kind: type, name: str, changed: Callable[..., Any]) -> Plant:
    """A fault by which a method does what `changed` makes of it, which is given the method and its arguments."""
    whole = getattr(kind, name)
    return lambda patch: patch.setattr(kind, name, lambda *given: changed(whole, *given))


def without_a_wall(prepare: Any, part: Any) -> None:
    """Walls are put up but for the first one."""
    building = part._building
    found, building.found = building.found, replace(building.found, walls=building.walls[1:])
    prepare(part)
    building.found = found


def heard_after_its_loss(deliver: Any, *given: Any) -> Delivery:
    found = deliver(*given)
    lost = [letters for _, letters in found.lost if len(letters)]
    heard = np.concatenate([found.heard, *(letters[:1] for letters in lost)])
    return replace(found, heard=heard[np.lexsort((heard[:, 2], heard[:, 1], heard[:, 0]))])


def twice(letters: np.ndarray) -> np.ndarray:
    return np.concatenate([letters[:1], letters])


def lost_twice(deliver: Any, *given: Any) -> Delivery:
    found = deliver(*given)
    return replace(found, lost=tuple((reason, twice(letters)) for reason, letters in found.lost))


def heard_twice(deliver: Any, *given: Any) -> Delivery:
    found = deliver(*given)
    return replace(found, heard=twice(found.heard))


def swallowed(deliver: Any, *given: Any) -> Delivery:
    found = deliver(*given)
    return replace(found, heard=found.heard[1:])


def cell_that_nobody_saw(update: Any, grids: Any, alive: Any, tiles: Any, inbox: Any) -> Any:
    """One unknown cell of each tile becomes free when it is put on a map."""
    values = tiles.values.copy()
    for tile in values.reshape(len(values), -1):
        tile[np.flatnonzero(tile == UNKNOWN)[:1]] = FREE
    return update(grids, alive, replace(tiles, values=values), inbox)


def one_more(measure: Any, task: Any, moment: Any) -> Any:
    """One cell too many is counted."""
    measured = measure(task, moment)
    share = min(1.0, measured.values["coverage"] + 1.0 / np.count_nonzero(moment.building.explorable))
    return replace(measured, values={"coverage": share})


def blind_beam(sense: Any, *given: Any) -> Any:
    """A tile lacks a cell that beams have shown."""
    readings = sense(*given)
    for tile in readings.tiles.values.reshape(len(readings.tiles.values), -1):
        tile[np.flatnonzero(tile == FREE)[-1:]] = UNKNOWN
    return readings


def a_byte_more(say: Any, *given: Any) -> Broadcast:
    said = say(*given)
    return replace(said, sizes=said.sizes + (said.sizes > 0))


def dated_by_exchanges(made: Any, codec: Any, codecs: Any, rounds: int) -> None:
    """A computation's part of messages has the number of the exchange for that of the iteration."""
    made(codec, codecs, 1)


def minds_hear_nothing_late(rest: Any, exchange: Any, *given: Any) -> None:
    """What comes for minds in further exchanges is dropped."""
    rest(exchange, *given)
    exchange._late = []


def the_first_jobs_part(opened: Any, buffer: Any, iteration: int, delivery: Any, job: int | None = None) -> Inbox:
    """All jobs get the letters of the first one."""
    return opened(buffer, iteration, delivery, None if job is None else 0)


def counted_per_hearer(said: Any, bundle: Any, *given: Any) -> Broadcast:
    """A job's bytes are counted for every robot there is."""
    found = said(bundle, *given)
    bundle._sent = [len(found.ends) * sent for sent in bundle._sent]
    return found


def without_an_aim(pack: Any, codec: Any, fact: Any) -> bytes:
    """Values go to the first of their readers alone."""
    rest = max(fact.robot.bit_count() - 1, 0) if codec._compact and fact.kind == SHOW else 0
    return pack(codec, fact._replace(value=fact.value[:1] + bytes([AFAR] * rest) + fact.value[1 + rest :]))


#: By name: the scenario to begin with, the fault, and what is told of it.
PLANTED: dict[str, tuple[int, Plant, str]] = {
    "a wall that beams do not see": (13, wrapped(IrRingSensor, "_prepare", without_a_wall), r"beam|cells at"),
    "a wall that bodies do not meet": (
        637,
        wrapped(RigidDiscs, "_build_walls", without_a_wall),
        r"into walls|beyond a wall",
    ),
    "a cell that beams showed and a tile lacks": (
        3,
        wrapped(IrRingSensor, "sense", blind_beam),
        r"unknown, and beams showed it",
    ),
    "a letter heard after it was lost": (0, wrapped(LossyChannel, "deliver", heard_after_its_loss), r"ended before"),
    "a letter lost twice": (0, wrapped(LossyChannel, "deliver", lost_twice), r"ended before"),
    "a letter heard twice": (28, wrapped(LatentChannel, "deliver", heard_twice), r"ended before"),
    "a letter that is neither heard nor lost": (
        0,
        wrapped(PerfectChannel, "deliver", swallowed),
        r"nothing delays it|too early",
    ),
    "a byte that is charged for and not sent": (3, wrapped(Bundle, "say", a_byte_more), r"another length"),
    "a byte of a further exchange that is not sent": (3, wrapped(Bundle, "say_more", a_byte_more), r"another length"),
    "an envelope that dates a map by exchanges": (
        3,
        wrapped(EnvelopeCodec, "__init__", dated_by_exchanges),
        r"unpacks to something else",
    ),
    "a letter for minds that is lost in a further exchange": (
        13,
        wrapped(Exchange, "rest", minds_hear_nothing_late),
        r"more or less was heard",
    ),
    "a job that hears another one": (
        137,
        wrapped(MessageBuffer, "_opened", the_first_jobs_part),
        r"more or less was heard|changed on its way",
    ),
    "a job's bytes counted for each hearer": (
        3,
        wrapped(Bundle, "_with_jobs", counted_per_hearer),
        r"other bytes of a job than its letters have",
    ),
    "a value of a job that is sent to one of its readers": (
        16,
        wrapped(FactCodec, "_packed", without_an_aim),
        r"unpacks to something else",
    ),
    "a cell on a map that nobody saw": (
        0,
        wrapped(OccupancyGrids, "update", cell_that_nobody_saw),
        r"are covered, and",
    ),
    "a cell counted that nobody saw": (0, wrapped(CoverageTask, "measure", one_more), r"are covered, and"),
}


@pytest.mark.thorough
@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_caught(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, plant, told = PLANTED[name]
    plant(monkeypatch)
    with pytest.raises(AssertionError, match=told):
        tried_all((*range(first, max(SCENARIOS, first + 1)), *range(min(first, SCENARIOS))), tmp_path)

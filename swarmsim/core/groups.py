"""Minds of groups: robots of one network, each group with its own computation and strategy."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.errors import InputError, nearest
from swarmsim.core.kinds import FromKind, KindCodec, Roster, sorted_out, together
from swarmsim.core.messages import Broadcast, Codec, Inbox, MessageBatch
from swarmsim.core.parts import AnyComputation, AnyStrategy
from swarmsim.core.readings import Channels, Column, Readings
from swarmsim.core.reports import Report, adopt, combined, report
from swarmsim.core.state import Intents, Knowledge, Record, Senses

Held = Column | Mapping[str, Column] | None  # the type of a field of intents
T = TypeVar("T")


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """The robots of one mind, among robots served by several minds."""

    names: tuple[str, ...]  # of their groups
    rows: NDArray[np.int64]  # (r,): their rows among all
    kind: int  # of their messages
    channels: Channels  # of their sensors
    places: tuple[int, ...]  # each channel's column in all readings
    computation: AnyComputation
    strategy: AnyStrategy

    def sensed(self, senses: Senses) -> Senses:
        """Their rows of all robots' senses."""
        rows, columns = self.rows, senses.readings.columns
        decided = None if senses.decided is None else _each(senses.decided, lambda one: one[rows])
        return replace(
            senses, pose=senses.pose[rows], velocity=senses.velocity[rows], alive=senses.alive[rows], decided=decided,
            readings=Readings(self.channels, tuple([columns[place][rows] for place in self.places])),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class GroupKnowledge(Knowledge):
    """Knowledge of robots in groups with their own minds: each mind's knowledge, for its robots."""

    bands: tuple[Band, ...]
    known: tuple[Knowledge, ...]  # of each band, by the band's rows
    robots: int

    def of_group(self, name: str) -> Knowledge:
        """The knowledge of a group's mind, including other groups' robots with the same mind.

        Raises InputError, which lists the groups, for an unknown one.
        """
        found = {name: known for band, known in zip(self.bands, self.known, strict=True) for name in band.names}
        if name not in found:
            raise InputError(f"no group of robots is called {name!r}; {nearest(name, found)}")
        return found[name]

    def arrays(self) -> tuple[NDArray[np.generic], ...]:
        """The bands' columns, one band after another."""
        return tuple(array for known in self.known for array in known.arrays())

    def record(self) -> Record:
        """The tables of all bands, extended to a row per robot where a band's has one per own robot.

        Robots of bands without a table are NaN there, or 0. Bands that give a table in the same form share it; in
        different forms it becomes NAME.GROUP for each.
        """
        records = [known.record() for known in self.known]
        rows: dict[str, object] = {}
        for name, given in _by_name([record.rows for record in records]).items():
            rows |= self._rows(name, given)
        lists: dict[str, Column] = {}
        for name, tables in _by_name([record.lists for record in records]).items():
            lists |= self._lists(name, tables, all(name in records[number].of_robots for number in tables))
        return Record(rows, lists, tuple({name: None for one in records for name in one.of_robots}))

    def _rows(self, name: str, given: Mapping[int, object]) -> dict[str, object]:
        """One name's rows, by table name."""
        found = {number: np.asarray(row) for number, row in given.items()}
        of_robots = all(row.shape[:1] == self.bands[number].rows.shape for number, row in found.items())
        forms = {(row.dtype, row.shape[1:] if of_robots else row.shape) for row in found.values()}
        if of_robots and len(forms) == 1:
            return {name: self._spread(found)}
        if len(found) == 1:
            return {name: next(iter(given.values()))}
        return {
            f"{name}.{self.bands[number].names[0]}": self._spread({number: row}) if of_robots else row
            for number, row in found.items()
        }

    def _spread(self, found: Mapping[int, Column]) -> Column:
        """Rows of some bands (r, ...), of one form, expanded to all robots (n, ...)."""
        first = next(iter(found.values()))
        whole = np.full((self.robots, *first.shape[1:]), np.nan if first.dtype.kind == "f" else 0, first.dtype)
        for number, row in found.items():
            whole[self.bands[number].rows] = row
        return whole

    def _lists(self, name: str, given: Mapping[int, Column], of_robots: bool) -> dict[str, Column]:
        """One name's lists, by table name; robots are numbered by their row among all."""
        tables = dict(given)
        for number, table in given.items() if of_robots else ():
            tables[number] = table.copy()
            tables[number][:, 0] = self.bands[number].rows[table[:, 0]]
        if len(tables) == 1 or (of_robots and len({(one.dtype, one.shape[1:]) for one in tables.values()}) == 1):
            return {name: np.concatenate(list(tables.values()))}
        return {f"{name}.{self.bands[number].names[0]}": table for number, table in tables.items()}

    def of(self, robot: int) -> object:
        """One robot's knowledge, from its group's mind."""
        for band, known in zip(self.bands, self.known, strict=True):
            row = np.flatnonzero(band.rows == robot)
            if len(row):
                return known.of(int(row[0]))
        return None


def _by_name(tables: Sequence[Mapping[str, T]]) -> dict[str, dict[int, T]]:
    """Each band's value for each name, by band number."""
    names = dict.fromkeys(name for one in tables for name in one)
    return {name: {number: one[name] for number, one in enumerate(tables) if name in one} for name in names}


class Groups:
    """Robots with several minds, row by row."""

    def __init__(self, bands: Sequence[Band], roster: Roster, actuators: Channels) -> None:
        """The `roster` covers the whole swarm, whose other robots may be served elsewhere."""
        self.bands: Final = tuple(bands)
        self.roster: Final = roster
        self.actuators: Final = actuators
        #: The number of robots.
        self.robots = sum(len(band.rows) for band in bands)
        #: For each band, each robot's row in it (n,); -1 for robots of other bands.
        self.rows = [np.full(self.robots, -1, np.int64) for _ in bands]
        for row, band in zip(self.rows, bands, strict=True):
            row[band.rows] = np.arange(len(band.rows))

    def heard(self, inbox: Inbox[MessageBatch]) -> list[Inbox[MessageBatch]]:
        """Each band's inbox: messages of its own kind, and of others."""
        return [sorted_out(inbox, row, band.kind, self.roster) for row, band in zip(self.rows, self.bands, strict=True)]

    def of_band(self, number: int, robots: NDArray[np.int64]) -> NDArray[np.int64]:
        """The rows in a band (k,) of some robots (r,)."""
        found = self.rows[number][robots]
        return found[found >= 0]


class GroupComputation:
    """A computation that delegates to each group's mind."""

    knowledge_type: type[Knowledge] = GroupKnowledge

    def __init__(self, groups: Groups) -> None:
        self._groups = groups

    @property
    def codec(self) -> KindCodec | Codec[MessageBatch]:
        """Several kinds of messages get a byte for the kind; one kind stays as it is."""
        groups = self._groups
        codecs = {band.kind: band.computation.codec for band in groups.bands}
        return KindCodec(codecs, groups.roster.kind) if groups.roster.several else next(iter(codecs.values()))

    def say(self, senses: Senses) -> Broadcast[MessageBatch]:
        """All robots' messages."""
        groups = self._groups
        shares = [FromKind(band.rows, band.kind, band.computation.say(band.sensed(senses))) for band in groups.bands]
        return together(shares, groups.robots, groups.roster.several)

    def hear(self, senses: Senses, inbox: Inbox[MessageBatch]) -> GroupKnowledge:
        """All robots' knowledge."""
        groups = self._groups
        known = [
            band.computation.hear(band.sensed(senses), heard)
            for band, heard in zip(groups.bands, groups.heard(inbox), strict=True)
        ]
        return GroupKnowledge(groups.bands, tuple(known), groups.robots)

    def report(self, knowledge: GroupKnowledge) -> Report:
        """What the only robot has learned, by its group's mind."""
        return report(self._groups.bands[0].computation, knowledge.known[0])

    def combined(self, row: int, before: Report, came: Sequence[Report]) -> Report:
        """By its group's mind."""
        for band in self._groups.bands:
            if len(rows := np.flatnonzero(band.rows == row)):
                return combined(band.computation, int(rows[0]), before, came)
        raise IndexError(f"no robot in row {row}")

    def adopt(self, reports: Sequence[Report], inbox: Inbox[MessageBatch]) -> GroupKnowledge:
        """What all robots know, group by group. Raises FrameError."""
        groups = self._groups
        known = [
            adopt(band.computation, [reports[row] for row in band.rows], heard)
            for band, heard in zip(groups.bands, groups.heard(inbox), strict=True)
        ]
        return GroupKnowledge(groups.bands, tuple(known), groups.robots)

    def reset(self, robots: NDArray[np.int64]) -> None:
        """Erase what robots (r,) know."""
        for number, band in enumerate(self._groups.bands):
            if len(theirs := self._groups.of_band(number, robots)):
                band.computation.reset(theirs)

    def copy_from(self, robots: NDArray[np.int64], source: int) -> None:
        """Copy another robot's knowledge to robots (r,). Raises InputError if their minds differ."""
        for number, band in enumerate(self._groups.bands):
            theirs = self._groups.of_band(number, robots)
            known = self._groups.of_band(number, np.array([source]))
            if len(theirs) and not len(known):
                raise InputError(f"robots {robots.tolist()} cannot know what robot {source} does: their minds differ")
            if len(theirs):
                band.computation.copy_from(theirs, int(known[0]))


class GroupStrategy:
    """A strategy that delegates to each group's mind."""

    requires_knowledge: type[Knowledge] = GroupKnowledge

    def __init__(self, groups: Groups) -> None:
        self._groups = groups

    def step(self, senses: Senses, inbox: Inbox[MessageBatch], knowledge: GroupKnowledge) -> Intents:
        """All robots' intents."""
        groups = self._groups
        decided = [
            band.strategy.step(band.sensed(senses), heard, known)
            for band, heard, known in zip(groups.bands, groups.heard(inbox), knowledge.known, strict=True)
        ]
        rows = [band.rows for band in groups.bands]
        for number, one in enumerate(decided):  # actuators without commands rest
            everybody = np.ones(len(one.counts), np.bool_)
            commands = Readings.filled(groups.actuators, one.commands, everybody).named()
            decided[number] = replace(one, commands=commands)
        return _made(lambda name: _whole(rows, [getattr(each, name) for each in decided], groups.robots))


def _each(intents: Intents, change: Callable[[Column], Column]) -> Intents:
    """The same intents with all columns changed."""

    def changed(value: Held) -> Held:
        if isinstance(value, Mapping):
            return {name: change(one) for name, one in value.items()}
        return None if value is None else change(value)

    return _made(lambda name: changed(getattr(intents, name)))


def _made(give: Callable[[str], Held]) -> Intents:
    """Intents with each field from `give(name)`."""
    columns: dict[str, Any] = {one.name: give(one.name) for one in fields(Intents)}
    return Intents(**columns)


def merged(intents: Sequence[Intents]) -> Intents:
    """Intents of one robot each, as those of all."""
    rows, count = [np.array([row]) for row in range(len(intents))], len(intents)
    return _made(lambda name: _whole(rows, [getattr(each, name) for each in intents], count))


def _whole(rows: Sequence[NDArray[np.int64]], given: Sequence[Held], robots: int) -> Held:
    """Fields of several bands, merged into one of all robots."""
    tables = [one for one in given if isinstance(one, Mapping)]
    if not tables:
        return _column(rows, [None if isinstance(one, Mapping) else one for one in given], robots)
    names = dict.fromkeys(name for one in tables for name in one)
    columns = {
        name: _column(rows, [one.get(name) if isinstance(one, Mapping) else None for one in given], robots)
        for name in names
    }
    return {name: column for name, column in columns.items() if column is not None}


def _column(rows: Sequence[NDArray[np.int64]], given: Sequence[Column | None], robots: int) -> Column | None:
    """Columns of several bands merged into one of all robots; shorter rows end with zeros, missing ones are NaN."""
    there = [one for one in given if one is not None]
    if not there:
        return None
    tail = np.max([one.shape[1:] for one in there], axis=0).astype(int).tolist()
    whole = np.zeros((robots, *tail), there[0].dtype)
    for mine, one in zip(rows, given, strict=True):
        if one is not None:
            lacks = [(0, most - side) for most, side in zip(tail, one.shape[1:], strict=True)]
            whole[mine] = np.pad(one, [(0, 0), *lacks])
        elif whole.dtype.kind == "f":
            whole[mine] = np.nan
    return whole

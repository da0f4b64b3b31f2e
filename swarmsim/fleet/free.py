"""The world's end of a fleet at a free pace: an iteration ends when its time is over, and what is late is late."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, final

import msgspec

from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.readings import Channels
from swarmsim.core.robot import Deed, Sensed
from swarmsim.fleet import logbook, wire
from swarmsim.fleet.lines import RobotLines
from swarmsim.fleet.logbook import Came, Logbook
from swarmsim.fleet.terms import LATE, PATIENCE
from swarmsim.fleet.transport import LinkError
from swarmsim.fleet.watchdog import Watchdog
from swarmsim.fleet.wire import Ears, Telegram

_TALK: Final = 0.4  # of a period: until then robots have to say what they say, where the world tells who hears it
_SLACK: Final = 0.1  # of a period, that an iteration may begin late without being called late
_LOOK: Final = 0.2  # s between two looks at who is still there


@final
class FreeEnd:
    """The robots of a fleet, at the other end of a link, each at its own pace."""

    def __init__(
        self,
        lines: RobotLines,
        actuators: Channels,
        watchdog: Watchdog,
        lost: Callable[[], str] = lambda: "",
        log: Logbook | None = None,
    ) -> None:
        """`lost` says who has ended before the start, if anybody."""
        self._log, self._joined = log, list[int]()
        self._lines, self._actuators, self._dog, self._lost = lines, actuators, watchdog, lost
        self._now, self._due = -1, 0.0  # the iteration, and when it ends
        self._sensed: Sequence[Sensed] = ()
        self._said: dict[int, bytes] = {}  # in this iteration
        self._deeds: list[list[Deed]] = [[] for _ in lines.charges]  # that have come and are not taken yet
        self._told = [0] * len(lines.charges)  # how many of these are in the log
        self._newest = [-1] * len(lines.charges)  # the iteration of the newest of these and all before
        self._away: dict[int, int] = {}  # robots that have gone, and their processes
        #: The robots that are ready; what is told to others would be lost.
        self.ready: set[int] = set()
        #: Iterations, and those at whose end a robot had not decided.
        self.iterations, self.late = 0, 0
        #: Iterations that the world began more than _SLACK too late, and by how much in all (s).
        self.behind, self.slipped = 0, 0.0
        #: By robot, how often it had not decided when an iteration ended.
        self.missed = Counter[int]()

    @property
    def lines(self) -> RobotLines:
        """Its lines to the robots."""
        return self._lines

    def gather(self, expected: Sequence[int]) -> None:
        """Wait until these robots are ready. Raises LinkError if one ends before."""
        while not self.ready.issuperset(expected):
            if not self._listen(_LOOK) and (told := self._lost()):
                raise LinkError(told)

    def forget(self, robots: Sequence[int]) -> None:
        """These robots have gone; one that starts again begins anew."""
        for robot in robots:
            self.ready.discard(robot)
            self._away[robot] = self._lines.forget(robot)

    def regain(self, present: set[int]) -> None:
        """Robots that are present again without having started again are ready as they were."""
        for robot in present & self._away.keys():
            self._lines.pids[robot] = self._away.pop(robot)
            self.ready.add(robot)

    def is_silent(self, robot: int) -> bool:
        """Whether it has not decided for PATIENCE periods."""
        return self._now - self._newest[robot] > PATIENCE

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        """What each robot says in time, as a frame; empty for nothing."""
        now = self._now = sensed[0].iteration
        self._sensed, self._said = sensed, {}
        begins, period = self._begin(), self._lines.terms.period
        self._due = begins + period
        for robot in sorted(self.ready):
            self._lines.tell(wire.sensed_telegram(robot, sensed[robot], self._actuators))
        if self._lines.terms.links == "real":
            self._wait(self._due, lambda: all(self._newest[robot] == now for robot in self.ready))
        else:
            self._wait(begins + _TALK * period, lambda: self.ready <= self._said.keys())
        self._note()
        return [self._said.get(robot, b"") for robot in range(len(sensed))]

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        """What each robot does, once its time to hear and decide is over."""
        now = self._now
        if self._lines.terms.links == "simulated":
            for robot in sorted(self.ready):
                self._lines.tell(ears[robot].telegram(robot))
        self._wait(self._due, lambda: False)
        self._note()
        self._told = [0] * len(self._deeds)
        came, self._deeds = self._deeds, [[] for _ in self._deeds]
        poses = [one.pose for one in self._sensed]
        missed = [robot for robot in self.ready if self._newest[robot] < now]
        self.late += bool(missed)
        self.missed.update(missed)
        return self._dog.taken(now, poses, came)

    @property
    def heard(self) -> list[tuple[int, int, int]]:
        """Who heard whom, as the deeds tell that have come: receiver, sender, iteration sent; sorted."""
        return heard_by(self._deeds, self._now)

    def _note(self) -> None:
        """Log what has come, since it was last logged."""
        if self._log is None:
            return
        deeds = [
            (robot, deed.iteration) for robot, came in enumerate(self._deeds) for deed in came[self._told[robot] :]
        ]
        self._told = [len(came) for came in self._deeds]
        entry = Came(self._now, tuple(sorted(self._said)), tuple(self._joined), tuple(deeds))
        self._log.note(logbook.CAME, msgspec.msgpack.encode(entry))
        self._log.flush()
        self._joined.clear()

    def _begin(self) -> float:
        """When the iteration begins: as the last one was to end, or now if that is too long ago, which is counted."""
        self.iterations += 1
        now = time.monotonic()
        over = now - self._due if self.iterations > 1 else 0.0
        if over > _SLACK * self._lines.terms.period:
            self.behind += 1
            self.slipped += over
        elif self.iterations > 1:
            return self._due
        return now

    def _wait(self, until: float, done: Callable[[], bool]) -> None:
        """Listen until all is done, or time is up; what has come by then counts."""
        while not done() and (left := until - time.monotonic()) > 0.0:
            self._listen(left)
        self._listen(0.0)

    def _listen(self, seconds: float) -> bool:
        """Take in what has been told, after waiting for it at most so long; whether there was anything."""
        late = (robot for robot in sorted(self.ready) if self._newest[robot] < self._now)
        heard = self._lines.heard(seconds, next(late, 0))
        for telegram in heard:
            self._take(telegram)
        return bool(heard)

    def _take(self, telegram: Telegram) -> None:
        robot, counts = telegram.robot, self._lines.counts
        try:
            if telegram.kind == wire.JOIN:
                self._admit(telegram)
            elif telegram.kind == wire.READY:
                self._dog.forget(robot)
                self._away.pop(robot, None)
                self.ready.add(robot)
                self._joined.append(robot)
            elif telegram.kind == wire.SAID and telegram.iteration == self._now:
                self._said[robot] = next(iter(wire.frames_in(telegram)), b"")
            elif telegram.kind == wire.DEED and self._newest[robot] < telegram.iteration <= self._now:
                self._deeds[robot].append(wire.deed_of(telegram, self._actuators))
                self._newest[robot] = telegram.iteration
                counts["late deed"] += telegram.iteration < self._now
            else:
                counts["late frame" if telegram.kind == wire.SAID else "out of turn"] += 1
        except FrameError:
            counts["no telegram"] += 1

    def _admit(self, telegram: Telegram) -> None:
        """Let a robot join. Raises InputError for a second one of its number; during the run it is only counted."""
        try:
            self._lines.admit(telegram)
        except InputError:
            if not self.iterations:
                raise
            self._lines.counts["second of its number"] += 1


def heard_by(deeds: Sequence[Sequence[Deed]], now: int) -> list[tuple[int, int, int]]:
    """Who heard whom, as each robot's deeds tell: receiver, sender, iteration sent; sorted."""
    found = {
        (robot, sender, sent)
        for robot, came in enumerate(deeds)
        for deed in came
        for sender, sent in deed.heard.tolist()
    }
    return sorted(one for one in found if now - LATE <= one[2] <= now)

"""What one robot hears on the air, kept until it is taken in."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, final

from swarmsim.core.messages import FrameError
from swarmsim.core.robot import Letter, Robot
from swarmsim.fleet import logbook
from swarmsim.fleet.logbook import Logbook, NoLogbook
from swarmsim.fleet.terms import LATE, Terms
from swarmsim.fleet.transport import RobotLink

_LISTENS: Final = 0.4  # of a period, that it listens to a real link
_MOST: Final = 100_000  # frames that wait to be heard


@final
class Listener:
    """A robot's ear on a link's air; it logs the frames of its swarm."""

    def __init__(self, link: RobotLink, log: Logbook | NoLogbook, other: Callable[[bytes], bool]) -> None:
        """`other` takes frames that are no messages, and says whether it knows them."""
        self._link, self._log, self._other = link, log, other
        self._heard: dict[tuple[int, int], Letter] = {}  # by sender and iteration sent
        #: The latest iteration that a frame was of; -1 before the first.
        self.latest = -1
        #: What was dropped, by reason.
        self.counts = Counter[str]()

    def get(self, sender: int, sent: int) -> Letter | None:
        """A letter that has been heard."""
        return self._heard.get((sender, sent))

    def listen(self, robot: Robot, oldest: int) -> None:
        """Read the frames that have arrived; old ones are forgotten, and what no robot can have said is dropped."""
        for frame, _ in self._link.heard():
            try:
                letter = robot.read(frame)
            except FrameError:
                self.counts["no frame of this swarm"] += not self._other(frame)
                continue
            self._log.note(logbook.HEARD, frame)
            self._heard[letter.sender, letter.sent] = letter
            self.latest = max(self.latest, letter.sent)
        if len(self._heard) > _MOST or any(key[1] < oldest for key in self._heard):
            self._heard = {key: one for key, one in list(self._heard.items())[-_MOST:] if key[1] >= oldest}

    def arrived(self, robot: Robot, iteration: int, terms: Terms) -> Sequence[Letter]:
        """All that arrives on a real link in time for this iteration, or what the nearest say of it."""
        self.until(robot, time.monotonic() + _LISTENS * terms.period, iteration - LATE)
        keys = [key for key in self._heard if key[1] <= iteration]
        letters = [self._heard.pop(key) for key in keys]
        return robot.nearest(letters, terms.nearest) if terms.nearest else letters

    def until(self, robot: Robot, ends: float, oldest: int) -> None:
        """Listen until a moment of the monotonic clock."""
        while (left := ends - time.monotonic()) > 0.0:
            self._link.wait(left)
            self.listen(robot, oldest)

"""The world's end of a fleet in lockstep: an iteration goes on once every robot has answered."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from swarmsim.core.charge import Charge
from swarmsim.core.errors import InputError
from swarmsim.core.messages import FrameError
from swarmsim.core.readings import Channels
from swarmsim.core.robot import Deed, Sensed
from swarmsim.fleet import wire
from swarmsim.fleet.robot_process import FROM_ROBOTS, from_world
from swarmsim.fleet.transport import LinkError, RobotLink
from swarmsim.fleet.wire import Ears, Telegram

_LOOK: Final = 0.2  # s between two looks at who is still there


class WorldEnd:
    """The robots of a fleet, at the other end of a link."""

    def __init__(
        self,
        link: RobotLink,
        charges: Sequence[Charge],
        actuators: Channels,
        frame: Callable[[int, int], bytes],
        lost: Callable[[], str] = lambda: "",
    ) -> None:
        """`frame` gives one that is under way, by sender and iteration sent; `lost` says who has ended, if anybody."""
        self._charges, self._actuators, self._frame, self._lost = charges, actuators, frame, lost
        self._from_robots = link.channel(FROM_ROBOTS)
        self._to_robots = [link.channel(from_world(robot)) for robot in range(len(charges))]
        self._ears: Sequence[Ears] = ()
        #: The process of each robot, as it told.
        self.pids: dict[int, int] = {}
        #: What was dropped, by reason.
        self.counts = Counter[str]()

    def gather(self) -> None:
        """Wait until every robot has joined, is told its charge and is ready. Raises LinkError if one ends before."""
        self._answers(wire.READY, 0)

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        """What each robot says, as a frame, once it has sensed; empty for nothing."""
        for robot, one in enumerate(sensed):
            self._tell(wire.sensed_telegram(robot, one, self._actuators))
        said = self._answers(wire.SAID, sensed[0].iteration)
        return [next(iter(wire.frames_in(said[robot])), b"") for robot in range(len(self._charges))]

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        """What each robot does, once it has heard."""
        self._ears = ears
        for robot, one in enumerate(ears):
            self._tell(one.telegram(robot))
        done = self._answers(wire.DEED, ears[0].iteration)
        return [wire.deed_of(done[robot], self._actuators) for robot in range(len(self._charges))]

    def end(self) -> None:
        """Tell all robots that the run has ended."""
        for robot in range(len(self._charges)):
            self._tell(Telegram(wire.END, robot))

    def _tell(self, telegram: Telegram) -> None:
        self._to_robots[telegram.robot].say(telegram.packed())

    def _answers(self, kind: int, iteration: int) -> Mapping[int, Telegram]:
        """One telegram of this kind from every robot. Raises LinkError if one has ended."""
        found: dict[int, Telegram] = {}
        while len(found) < len(self._charges):
            if not self._from_robots.wait(_LOOK):
                if told := self._lost():
                    raise LinkError(told)
                continue
            for data, _ in self._from_robots.heard():
                telegram = self._read(data)
                if telegram is None:
                    continue
                if telegram.kind == kind and telegram.iteration == iteration:
                    found[telegram.robot] = telegram
                else:
                    self._answer(telegram)
        return found

    def _read(self, data: bytes) -> Telegram | None:
        try:
            telegram = Telegram.read(data)
            if telegram.robot >= len(self._charges):
                raise FrameError(f"a telegram of robot {telegram.robot}; expected 0 to {len(self._charges) - 1}")
        except FrameError:
            self.counts["no telegram"] += 1
            return None
        return telegram

    def _answer(self, telegram: Telegram) -> None:
        """Answer what a robot asks at any time. Raises InputError for a second robot of one number."""
        robot = telegram.robot
        if telegram.kind == wire.JOIN:
            if self.pids.setdefault(robot, telegram.iteration) != telegram.iteration:
                raise InputError(
                    f"two robots have joined as number {robot}, processes {self.pids[robot]} and {telegram.iteration}; "
                    "expected one of each number"
                )
            self._tell(Telegram(wire.CHARGE, robot, pieces=(self._charges[robot].packed(),)))
        elif telegram.kind == wire.LACKS and self._ears and telegram.iteration == self._ears[robot].iteration:
            ears = self._ears[robot]
            letters = zip(ears.letters.tolist(), ears.frames, strict=True)
            frames = tuple(frame or self._frame(sender, sent) for (sender, sent), frame in letters)
            self.counts["lost on the air"] += 1
            self._tell(Ears(ears.iteration, ears.awake, ears.oldest, ears.letters, frames).telegram(robot))
        else:
            self.counts["out of turn"] += 1

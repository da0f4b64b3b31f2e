"""The world's end of a fleet in lockstep: an iteration goes on once every robot has answered."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, final

from swarmsim.core.readings import Channels
from swarmsim.core.robot import Deed, Sensed
from swarmsim.fleet import wire
from swarmsim.fleet.lines import RobotLines
from swarmsim.fleet.transport import LinkError
from swarmsim.fleet.wire import Ears, Telegram

_LOOK: Final = 0.2  # s between two looks at who is still there


@final
class LockstepEnd:
    """The robots of a fleet, at the other end of a link, in step with the world."""

    def __init__(
        self,
        lines: RobotLines,
        actuators: Channels,
        frame: Callable[[int, int], bytes],
        lost: Callable[[], str] = lambda: "",
    ) -> None:
        """`frame` gives one that is under way, by sender and iteration sent; `lost` says who has ended, if anybody."""
        self._lines, self._actuators, self._frame, self._lost = lines, actuators, frame, lost
        self._ears: Sequence[Ears] = ()

    def gather(self) -> None:
        """Wait until every robot has joined, is told its charge and is ready. Raises LinkError if one ends before."""
        self._answers(wire.READY, 0)

    def sense(self, sensed: Sequence[Sensed]) -> list[bytes]:
        """What each robot says, as a frame, once it has sensed; empty for nothing."""
        for robot, one in enumerate(sensed):
            self._lines.tell(wire.sensed_telegram(robot, one, self._actuators))
        said = self._answers(wire.SAID, sensed[0].iteration)
        return [next(iter(wire.frames_in(said[robot])), b"") for robot in range(len(sensed))]

    def hear(self, ears: Sequence[Ears]) -> list[Deed]:
        """What each robot does, once it has heard."""
        self._ears = ears
        for robot, one in enumerate(ears):
            self._lines.tell(one.telegram(robot))
        done = self._answers(wire.DEED, ears[0].iteration)
        return [wire.deed_of(done[robot], self._actuators) for robot in range(len(ears))]

    def _answers(self, kind: int, iteration: int) -> Mapping[int, Telegram]:
        """One telegram of this kind from every robot. Raises LinkError if one has ended."""
        found: dict[int, Telegram] = {}
        while len(found) < len(self._lines.charges):
            first = next(robot for robot in range(len(self._lines.charges)) if robot not in found)
            heard = self._lines.heard(_LOOK, first)
            if not heard and (told := self._lost()):
                raise LinkError(told)
            for telegram in heard:
                if telegram.kind == kind and telegram.iteration == iteration:
                    found[telegram.robot] = telegram
                else:
                    self._answer(telegram)
        return found

    def _answer(self, telegram: Telegram) -> None:
        """Answer what a robot asks at any time. Raises InputError for a second robot of one number."""
        robot, counts = telegram.robot, self._lines.counts
        if telegram.kind == wire.JOIN:
            self._lines.admit(telegram)
        elif telegram.kind == wire.LACKS and self._ears and telegram.iteration == self._ears[robot].iteration:
            ears = self._ears[robot]
            letters = zip(ears.letters.tolist(), ears.frames, strict=True)
            frames = tuple(frame or self._frame(sender, sent) for (sender, sent), frame in letters)
            counts["lost on the air"] += 1
            self._lines.tell(Ears(ears.iteration, ears.awake, ears.oldest, ears.letters, frames).telegram(robot))
        else:
            counts["out of turn"] += 1

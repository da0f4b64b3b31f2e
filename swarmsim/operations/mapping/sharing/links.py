"""What a robot knows of the places of frames of reference: links between pairs of robots, each proved by their maps."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from swarmsim.operations.mapping.sharing.places import Transform

Pair = tuple[int, int]  # of robots, the smaller number first

OPEN: Final = 8.0  # cells: two ways from one frame to another that do not fit together; each link errs a little


@dataclass(frozen=True, slots=True)
class Link:
    """How the frame of a pair's second robot lies in that of its first, by what they have mapped and where they met.

    The pair is the identity of the evidence, however many robots pass the link on.
    """

    pair: Pair
    found: int  # the iteration in which their maps were compared
    excess: int  # contradicting cells of the next best place beyond those of this one; 0: the link is withdrawn
    place: Transform

    @property
    def holds(self) -> bool:
        """Whether it is not withdrawn."""
        return self.excess > 0

    def seen_from(self, robot: int) -> tuple[int, Transform]:
        """The pair's other robot, and how its frame lies in that of this one."""
        first, second = self.pair
        return (second, self.place) if robot == first else (first, self.place.inverse())

    def withdrawn(self, found: int) -> Link:
        """The news that it does not hold, as of an iteration."""
        return replace(self, found=found, excess=0)


@dataclass(slots=True)
class Links:
    """The newest link of every pair that one robot knows of, and the frames that follow from them."""

    robot: int
    #: How the frames of other robots lie in its own.
    frames: dict[int, Transform] = field(default_factory=dict)
    _newest: dict[Pair, Link] = field(default_factory=dict)
    _told: dict[Pair, int] = field(default_factory=dict)  # iterations; not in it: never
    _through: dict[int, Link] = field(default_factory=dict)  # the last link on the way to each frame

    def of(self, pair: Pair) -> Link | None:
        """The newest link of a pair, if any is known that holds."""
        link = self._newest.get(pair)
        return link if link is not None and link.holds else None

    def learn(self, link: Link) -> None:
        """Take in a link, unless it is old news.

        Where two ways around a circle of robots end in different places, one link is wrong: that with the least excess
        is withdrawn. All links of a circle rest on other evidence, since each is of another pair.
        """
        before = self._newest.get(link.pair)
        if before is not None and (link.found, link.excess == 0) <= (before.found, before.excess == 0):
            return
        self._set(link)
        while (wrong := self._weakest_of_open_circle()) is not None:
            self._set(wrong.withdrawn(wrong.found))

    def weakest_towards(self, other: int) -> Link:
        """The link with the least excess on the way to a known frame."""
        return min(self._way(other), key=_strength)

    def next_to_tell(self, now: int) -> Link | None:
        """The link told longest ago, news first."""
        if not self._newest:
            return None
        pair = min(self._newest, key=lambda one: (self._told.get(one, -1), one))
        self._told[pair] = now
        return self._newest[pair]

    def _set(self, link: Link) -> None:
        self._newest[link.pair] = link
        self._told.pop(link.pair, None)
        self._follow()

    def seen_from(self, robot: int) -> dict[int, Transform]:
        """How the frames of other robots lie in that of any one, as far as links lead."""
        return self._reached(robot)[0]

    def _follow(self) -> None:
        self.frames, self._through = self._reached(self.robot)

    def _reached(self, robot: int) -> tuple[dict[int, Transform], dict[int, Link]]:
        """All frames that links lead to, by the fewest links and, among these, the ones with most excess.

        With each frame comes the last link on the way to it.
        """
        frames, through, edge = {robot: Transform(0.0, 0.0, 0.0)}, dict[int, Link](), {robot}
        holding = sorted((link for link in self._newest.values() if link.holds), key=_strength, reverse=True)
        while edge:
            reached: set[int] = set()
            for link in holding:
                for near, far in (link.pair, link.pair[::-1]):
                    if near in edge and far not in frames:
                        frames[far] = frames[near].after(link.seen_from(near)[1])
                        through[far] = link
                        reached.add(far)
            edge = reached
        del frames[robot]
        return frames, through

    def _way(self, other: int) -> Iterator[Link]:
        """The links from a frame back to the robot's own."""
        while other != self.robot:
            yield self._through[other]
            other = self._through[other].seen_from(other)[0]

    def _weakest_of_open_circle(self) -> Link | None:
        """The link with the least excess of a circle of links that do not fit together."""
        here = Transform(0.0, 0.0, 0.0)
        for link in sorted((one for one in self._newest.values() if one.holds), key=lambda one: one.pair):
            if any(robot != self.robot and robot not in self.frames for robot in link.pair):
                continue
            first, second = (self.frames.get(robot, here) for robot in link.pair)
            if first.after(link.place).shift(second) > OPEN:
                there, back = (set(self._way(robot)) for robot in link.pair)
                return min((there ^ back) | {link}, key=_strength)
        return None


def _strength(link: Link) -> tuple[int, Pair]:
    return link.excess, link.pair

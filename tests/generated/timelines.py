"""Faults at random: any kind, any failure, and any valid keys that say when, to whom and for how long."""

from __future__ import annotations

from random import Random
from typing import Any

Table = dict[str, Any]

MAPS = {"byzantine"}  # kinds for robots that map alone


class Timelines:
    """Draws faults for one swarm."""

    def __init__(
        self, dice: Random, robots: int, width: float, height: float, *, maps: bool, tiles: bool, group: str = ""
    ) -> None:
        """`width` and `height` of the page in m; whether robots keep maps, and whether they sense tiles.

        `group` is the name of the one group that there is, if there is one.
        """
        self._group = group
        self._dice, self._robots, self._size, self._maps, self._tiles = dice, robots, (width, height), maps, tiles

    def some(self, kinds: list[str], bodies: bool) -> list[Table]:
        """One to three faults of these kinds; with `bodies` that can be pushed."""
        able = [kind for kind in kinds if self._fits(kind, bodies)]
        chosen = [self._dice.choice(able) for _ in range(self._dice.choice((1, 1, 2, 3)))]
        # Nobody may be dead before the latecomers are late, so they come first, and once.
        chosen = ["join"] * ("join" in chosen) + [kind for kind in chosen if kind != "join"]
        return [self.one(kind) for kind in chosen]

    def one(self, kind: str) -> Table:
        """A fault of this kind."""
        return {"use": kind, **getattr(self, f"_{kind}")()}

    def _fits(self, kind: str, bodies: bool) -> bool:
        return (
            hasattr(self, f"_{kind}")
            and kind != "processor"  # for jobs alone
            and (bodies or kind not in ("push", "people"))
            and (self._maps or kind not in MAPS)
            and (self._tiles or kind != "sensor")
            and (self._robots > 1 or kind not in ("join", "byzantine", "radio"))
        )

    # When, whom, where

    def _box(self, least: float = 0.15, most: float = 0.9) -> list[float]:
        """left, lower, right, upper in m, inside of the page."""
        found = []
        for size in self._size:
            side = self._dice.uniform(least, min(most, size - 0.4))
            low = self._dice.uniform(0.16, size - 0.16 - side)
            found.append((round(low, 2), round(low + side, 2)))
        return [found[0][0], found[1][0], found[0][1], found[1][1]]

    def _maybe(self, **keys: Any) -> Table:
        return {key: value for key, value in keys.items() if self._dice.random() < 0.4}

    def _when(self, life: bool = True) -> Table:
        dice = self._dice
        first, last = dice.randint(0, 8), dice.randint(1, 6)
        times: list[Table] = [
            {"at": first, **self._maybe(every=dice.randint(1, 5), duration=last)},
            {"between": [first, first + last]},
            {"progress": round(dice.uniform(0.05, 0.9), 2), **self._maybe(duration=last)},
            {"rate": dice.choice((0.05, 0.3, 1.0)), **self._maybe(duration=last)},
        ]
        if life:
            law = {"mean": dice.choice((2.0, 6.0)), **self._maybe(shape=dice.choice((0.5, 3.0)))}
            times.append({"life": law, **self._maybe(duration=last)})
        return {**dice.choice(times), **self._maybe(duty=[dice.randint(1, 3), dice.randint(1, 3)])}

    def _scheduled(self) -> Table:
        first: Table = self._dice.choice(({"at": self._dice.randint(0, 6)}, {"progress": 0.2}))
        lasts = self._dice.randint(1, 5)
        again: Table = {"every": lasts + self._dice.randint(1, 3), "duration": lasts}  # not before it ends
        return {**first, **self._dice.choice(({}, {"duration": lasts}, again))}

    def _whom(self) -> Table:
        dice, all_ = self._dice, range(self._robots)
        which: list[Table] = [
            {},
            {"robots": dice.sample(all_, dice.randint(1, self._robots))},
            {"region": self._box(0.5, 3.0)},
            {"target": "hub"},
            {"target": dice.choice(("nearest", "farthest")), "point": [1.0, 1.0]},
            *[{"group": self._group}] * (4 if self._group else 0),
        ]
        many: list[Table] = [
            {},
            {"count": dice.randint(1, self._robots)},
            {"fraction": round(dice.uniform(0.1, 1.0), 2)},
        ]
        return {**dice.choice(which), **dice.choice(many), **self._maybe(min_alive=dice.randint(0, self._robots - 1))}

    def _robots_at_times(self) -> Table:
        found = {**self._when(), **self._whom()}
        return found if found.get("min_alive", 1) < self._robots else {**found, "min_alive": 0}

    def _fails(self, ways: dict[str, Table]) -> Table:
        failure = self._dice.choice(sorted(ways))
        return {"failure": failure, **ways[failure], **self._robots_at_times()}

    # Kinds

    def _memory(self) -> Table:
        return self._maybe(map=self._dice.choice(("kept", "lost"))) if self._maps else {}

    def _remove(self) -> Table:
        return {**self._robots_at_times(), **self._memory()}

    def _crash(self) -> Table:
        return {**self._robots_at_times(), **self._memory()}

    def _push(self) -> Table:
        return {"velocity": [round(self._dice.uniform(-0.4, 0.4), 3) for _ in "xy"], **self._robots_at_times()}

    def _join(self) -> Table:
        late = self._dice.randint(1, self._robots - 1)
        times: Table = {"count": 1, "times": late, "every": 2} if self._dice.random() < 0.3 else {"count": late}
        memory = self._maybe(map=self._dice.choice(("empty", "copied"))) if self._maps else {}
        return {"at": self._dice.randint(1, 6), **times, **memory}

    def _motor(self) -> Table:
        wheel = self._maybe(wheel=self._dice.choice(("both", "left", "right")))
        return self._fails(
            {
                "off": wheel,
                "slow": {"factor": self._dice.choice((0.0, 0.3, 2.0)), **wheel},
                "stuck": {"speed": self._dice.choice((-0.01, 0.005)), **wheel},
            }
        )

    def _processor(self) -> Table:
        return self._fails({"slow": self._maybe(factor=self._dice.choice((0.1, 0.7))), "stopped": {}})

    def _sensor(self) -> Table:
        dice = self._dice
        return self._fails(
            {
                "off": {},
                "garbage": {},
                "stuck": {"value": dice.choice(("free", "occupied"))},
                "range": {"range": dice.choice((0.1, 0.3))},
                "offset": {"offset": [dice.randint(-9, 9), dice.randint(-9, 9)]},
                "beams": {"beams": dice.sample(range(6), dice.randint(1, 5))},
            }
        )

    def _mind(self) -> Table:
        ways: dict[str, Table] = {"frozen": {}, "reboot": {}}
        if self._maps:
            ways["random-walk"] = self._maybe(reach=self._dice.choice((0.3, 1.0)))
        return self._fails(ways)

    def _localisation(self) -> Table:
        dice = self._dice
        constant = {"dx": dice.choice((-0.3, 0.02, 0.15)), **self._maybe(dy=0.1, dyaw=-0.2)}
        return self._fails(
            {"bias": constant, "drift": {**constant, **self._maybe(sigma=0.1, sigma_yaw=0.1)}, "kidnap": {}}
        )

    def _byzantine(self) -> Table:
        dice = self._dice
        return self._fails(
            {
                "inverted": {},
                "free": {},
                "occupied": {},
                "origin": {"offset": [dice.randint(-9, 9), dice.randint(-9, 9)]},
                "replay": {"age": dice.randint(1, 5)},
                "spoof": self._maybe(id=dice.randrange(self._robots)),
            }
        )

    def _radio(self) -> Table:
        dice = self._dice
        if dice.random() < 0.35:
            order = dice.sample(range(self._robots), self._robots)
            lines: list[Table] = [{"x": 1.5}, {"y": 1.2}, {"groups": [order[: self._robots // 2]]}]
            where: list[Table] = [
                {"failure": "jam", "area": self._box(0.5, 2.0)}, {"failure": "partition", **dice.choice(lines)},
            ]  # fmt: skip
            return {**dice.choice(where), **self._when(life=False)}
        return self._fails(
            {
                "transmit": {},
                "receive": {},
                "off": {},
                "loss": {"loss": round(dice.uniform(0.05, 0.95), 2)},
                "delay": {"delay": dice.randint(1, 4)},
            }
        )

    def _battery(self) -> Table:
        dice = self._dice
        costs = {
            "per_metre": dice.choice((0.0, 4.0)),
            "per_byte": dice.choice((0.0, 0.01)),
            "idle": dice.choice((0.2, 1.0)),
        }
        more = self._maybe(spread=0.3, empty=dice.choice(("crash", "remove")), robots=[0])
        return {"capacity": dice.choice((2.0, 6.0)), **costs, **more}

    def _door(self) -> Table:
        return {"box": self._box(), **self._scheduled()}

    def _furniture(self) -> Table:
        return {"box": self._box(), **self._maybe(to=self._box()), **self._scheduled()}

    def _rubble(self) -> Table:
        width, height = self._size
        more = self._maybe(count=self._dice.randint(1, 3), size=[0.1, 0.3])
        return {"region": [0.2, 0.2, round(width - 0.2, 2), round(height - 0.2, 2)], **self._scheduled(), **more}

    def _people(self) -> Table:
        return self._maybe(
            count=self._dice.randint(1, 2), radius=0.12, speed=self._dice.choice((0.1, 0.6)), patience=2.0
        )

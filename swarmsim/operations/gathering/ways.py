"""How far others are over the network, by what has passed lately."""

from __future__ import annotations

AFAR = 254  #: hops to a robot that nothing has come from lately


class Ways:
    """Hops from one robot to others, by the newest thing that came from each."""

    def __init__(self, patience: int) -> None:
        """What is older than `patience` iterations is forgotten."""
        self._patience = patience
        self._found: dict[int, tuple[int, int]] = {}  # iteration and hops, by robot

    def note(self, robot: int, time: int, hops: int) -> bool:
        """Take in over how many hops something came that a robot said at a time (iterations); whether it is news."""
        known = self._found.get(robot)
        if known is not None and (time, -hops) <= (known[0], -known[1]):
            return False
        self._found[robot] = time, min(hops, AFAR)
        return True

    def hops(self, robot: int, now: int) -> int:
        """Hops to a robot; AFAR if nothing is known."""
        time, hops = self._found.get(robot, (now, AFAR))
        return hops if now - time <= self._patience else AFAR

"""What pieces have shown, by piece and step, kept for two levels; and copies of their states at levels' starts."""

from __future__ import annotations

from swarmsim.core.jobs import Values

KEPT = 2  #: levels of which a robot that has a copy keeps the states


class Log:
    """What one robot knows of what pieces show: of each piece and step the values that each reader reads."""

    def __init__(self) -> None:
        self._shown: dict[int, dict[int, dict[int, Values]]] = {}  # by piece, step and reader

    def put(self, piece: int, step: int, reader: int, values: Values) -> bool:
        """Keep values; whether they are new."""
        its = self._shown.setdefault(piece, {}).setdefault(step, {})
        if reader in its:
            return False
        its[reader] = values
        return True

    def sizes(self) -> dict[int, int]:
        """Bytes, by piece."""
        return {
            piece: sum(values.nbytes for its in steps.values() for values in its.values())
            for piece, steps in self._shown.items()
        }

    def merged(self, other: Log) -> Log:
        """All that either of two logs has."""
        found = Log()
        for one in (other, self):
            for piece, steps in one._shown.items():
                mine = found._shown.setdefault(piece, {})
                for step, its in steps.items():
                    mine[step] = {**mine.get(step, {}), **its}
        return found

    def get(self, piece: int, step: int, reader: int) -> Values | None:
        """What a reader reads of a piece in a step, if it is known."""
        return self._shown.get(piece, {}).get(step, {}).get(reader)

    def newest(self, piece: int, reader: int) -> int | None:
        """The last step to which it is known what a reader reads of a piece."""
        return max((step for step, its in self._shown.get(piece, {}).items() if reader in its), default=None)

    def forget(self, before: int) -> None:
        """Drop all that is older than a step."""
        for piece, steps in self._shown.items():
            if steps and min(steps) < before:
                self._shown[piece] = {step: its for step, its in steps.items() if step >= before}

    def only_newest(self) -> None:
        """Drop all but the newest values of each piece and reader."""
        for piece, steps in self._shown.items():
            newest = {reader: step for step, its in sorted(steps.items()) for reader in its}
            found: dict[int, dict[int, Values]] = {}
            for reader, step in newest.items():
                found.setdefault(step, {})[reader] = steps[step][reader]
            self._shown[piece] = found


class Copies:
    """The states that one robot keeps, by piece and step; of each piece the newest KEPT."""

    def __init__(self) -> None:
        self._states: dict[int, dict[int, Values]] = {}

    def put(self, piece: int, step: int, state: Values) -> None:
        """Keep a state."""
        of_piece = self._states.setdefault(piece, {})
        of_piece[step] = state
        if len(of_piece) > KEPT:
            del of_piece[min(of_piece)]

    def sizes(self) -> dict[int, int]:
        """Bytes, by piece."""
        return {piece: sum(one.nbytes for one in states.values()) for piece, states in self._states.items()}

    def merged(self, other: Copies) -> Copies:
        """The newest states of two robots."""
        found = Copies()
        for one in (self, other):
            for piece, states in one._states.items():
                for step, state in sorted(states.items()):
                    found.put(piece, step, state)
        return found

    def before(self, piece: int, step: int) -> tuple[int, Values] | None:
        """The newest state of a piece that is not later than a step, if there is one."""
        there = [one for one in self._states.get(piece, {}) if one <= step]
        return (max(there), self._states[piece][max(there)]) if there else None

    def newest(self, piece: int) -> int:
        """The step of the newest state of a piece; -1 without one."""
        return max(self._states.get(piece, {}), default=-1)

    def pieces(self) -> list[int]:
        """The pieces of which there is a state."""
        return sorted(piece for piece, states in self._states.items() if states)

    def count(self, piece: int) -> int:
        """How many states of a piece there are."""
        return len(self._states.get(piece, {}))

    def drop(self, piece: int) -> None:
        """Keep no state of a piece any more."""
        self._states.pop(piece, None)

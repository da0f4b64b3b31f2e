"""What pieces have shown, by piece and step, kept for two levels; and copies of their states at levels' starts."""

from __future__ import annotations

from swarmsim.core.jobs import Values

KEPT = 2  #: levels of which a robot that has a copy keeps the states


class Log:
    """What one robot knows of what pieces show."""

    def __init__(self) -> None:
        self._shown: dict[int, dict[int, Values]] = {}

    def put(self, piece: int, step: int, values: Values) -> bool:
        """Keep values; whether they are new."""
        of_piece = self._shown.setdefault(piece, {})
        if step in of_piece:
            return False
        of_piece[step] = values
        return True

    def sizes(self) -> dict[int, int]:
        """Bytes, by piece."""
        return {piece: sum(one.nbytes for one in of_piece.values()) for piece, of_piece in self._shown.items()}

    def merged(self, other: Log) -> Log:
        """All that either of two logs has."""
        found = Log()
        pieces = self._shown.keys() | other._shown.keys()
        found._shown = {piece: {**self._shown.get(piece, {}), **other._shown.get(piece, {})} for piece in pieces}
        return found

    def get(self, piece: int, step: int) -> Values | None:
        """What a piece shows to a step, if it is known."""
        return self._shown.get(piece, {}).get(step)

    def newest(self, piece: int) -> int | None:
        """The last step to which it is known what a piece shows."""
        return max(self._shown.get(piece, {}), default=None)

    def forget(self, before: int) -> None:
        """Drop all that is older than a step."""
        for piece, of_piece in self._shown.items():
            if of_piece and min(of_piece) < before:
                self._shown[piece] = {step: values for step, values in of_piece.items() if step >= before}

    def only_newest(self, piece: int) -> None:
        """Drop all but the newest of a piece."""
        newest = self.newest(piece)
        if newest is not None:
            self._shown[piece] = {newest: self._shown[piece][newest]}


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

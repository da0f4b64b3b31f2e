"""How deep bodies overlapped, where they may not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from swarmsim.kernels import discs

if TYPE_CHECKING:
    from swarmsim.core.state import Knowledge, Moment
    from swarmsim.engine.build import BuiltRun

DEEP: Final = 0.1  # of a radius: from here on a run's contacts are worth a notice


class Contacts:
    """An observer that keeps the deepest overlap of two robots' bodies at the end of an iteration."""

    def __init__(self, made: BuiltRun) -> None:
        self._bodies, self._name = made.simulation.parts.bodies, made.simulation.name
        self._radii = made.context.robots.each("radius")
        self._watching = made.scenario.physics.declares("walled", False)  # others let bodies overlap
        #: The depth as a share of the smaller radius, the two robots, and the iteration.
        self.deepest: tuple[float, int, int, int] = (0.0, -1, -1, -1)

    def sample(self, moment: Moment[Knowledge]) -> None:
        """Compare with this iteration's."""
        if self._watching:
            found = discs.deepest(moment.state.pose, self._radii, self._bodies.solid)
            self.deepest = max(self.deepest, (*found, moment.state.iteration))

    @property
    def notice(self) -> str | None:
        """What to say of deep overlaps, and what helps; None if there were none."""
        share, one, other, iteration = self.deepest
        if share <= DEEP:
            return None
        return (
            f"{self._name}: robots {one} and {other} overlapped by {share:.0%} of a radius in iteration {iteration}; "
            "a shorter physics.substep keeps bodies apart, and so does physics.parting = 0.2 in crowds that push"
        )

"""Robots and people: their places, and robots' faults."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from swarmsim.core.drawing import Circles, Ink, Inks, Lines, Mark, Polygons, Reals, Texts, Whole, ends_of
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.signs import Sign
from swarmsim.view.style import Style

PEOPLE, DEAD, BELIEFS, FAULTS, LIGHTS, ROBOTS = 90.0, 100.0, 101.0, 102.0, 102.8, 103.0  # z
NOSE: Final = np.array([(0.585, -0.545), (1.75, 0.0), (0.585, 0.545)])
CROSS: Final = 0.6 * np.array(
    [(0.8, 1), (0, 0.2), (-0.8, 1), (-1, 0.8), (-0.2, 0), (-1, -0.8), (-0.8, -1), (0, -0.2), (0.8, -1), (1, -0.8),
     (0.2, 0), (1, 0.8)]
)  # fmt: skip
LINE: Final = np.array([(0.0, -0.08), (4.0, -0.08), (4.0, 0.08), (0.0, 0.08)])


def forms(
    places: Reals, form: Reals, of: Whole, ink: Inks, z: float, name: str = "", yaw: Reals | None = None,
    edge: str | None = "edge", rides: bool = False,
) -> Polygons:  # fmt: skip
    """One form, in radii of robots as drawn, around each place (k, 2) in m, rotated by `yaw` (k,)."""
    points, ends = ends_of([form] * len(of))
    return Polygons(points, ends, ink, edge, at=places, yaw=yaw, unit="body", of=of, rides=rides, name=name, z=z)


def inks_of_robots(robots: Whole) -> list[str]:
    """The inks of these robots."""
    return [f"robot {robot}" for robot in robots.tolist()]


def bodies(pose: Reals, of: Whole, ink: Ink | None = None) -> list[Mark]:
    """Discs joined with noses; in the robots' own colours unless an ink is given."""
    inks: Inks = inks_of_robots(of) if ink is None else ink
    places, yaw = pose[:, :2], pose[:, 2]
    discs = Circles(places, 1.0, inks, unit="body", of=of, rides=True, name="robot", z=ROBOTS)
    nose = forms(places, NOSE, of, inks, ROBOTS, "nose", yaw, rides=True)
    return [nose, discs, replace(nose, edge=None)]


def rings(pose: Reals, of: Whole, ink: str, name: str) -> Circles:
    """Rings around robots."""
    return Circles(pose[:, :2], 2.1, ink, stroke=0.3, unit="body", of=of, rides=True, name=name, z=FAULTS)


class RobotLayer:
    """Live robots: discs with noses and ids, and their estimates of the way to go."""

    name = "robots"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Lines of headings, then bodies, then ids."""
        live = np.flatnonzero(shot.alive)
        pose, marks = shot.pose[live], []
        if shot.headings is not None:
            sure = np.isfinite(shot.headings[live])
            marks = [headings(pose[sure], live[sure], shot.headings[live[sure]])]
        ids = Texts(
            pose[:, :2], [str(robot) for robot in live.tolist()], 1.9, [f"on robot {robot}" for robot in live.tolist()],
            "body", live, True, "id", ROBOTS,
        )  # fmt: skip
        return [*marks, *bodies(pose, live), ids]

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A robot, and its heading."""
        pose, one = np.array([(0.0, 0.0, 0.5)]), np.zeros(1, np.int64)
        found = [Sign("robot", "robot", bodies(pose, one), 6.0)]
        if scene.has_headings:
            aside = pose - (6.0, 0.0, 0.0)
            line = headings(aside, one, np.array([0.5]))
            found.append(Sign("heading", "the heading it estimates", [line, *bodies(aside, one)]))
        return found


def headings(pose: Reals, of: Whole, yaw: Reals) -> Polygons:
    """Lines from robots' centres, under their discs, along these headings."""
    return forms(pose[:, :2], LINE, of, "curve", FAULTS + 0.5, "heading", yaw, rides=True)


class FaultLayer:
    """Rings around robots with a fault and latecomers; dead robots; places of removed ones."""

    name = "faults"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Dead robots below all others, rings below their robots."""
        marks = np.array(shot.marks)
        gone: NDArray[np.bool_] = ~shot.alive & (marks == "removed")
        dead = np.flatnonzero(~shot.alive & ~gone & (marks != "late"))
        found: list[Mark] = dead_marks(shot.pose[dead], dead) if len(dead) else []
        if gone.any():
            found.append(removed(shot.pose[gone], np.flatnonzero(gone)))
        for name, ink in (("fault", "mark"), ("joined", "joined")):
            these = np.flatnonzero(shot.alive & (marks == name))
            found += [rings(shot.pose[these], these, ink, name)] * (len(these) > 0)
        return found

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The marks that are ever drawn."""
        pose, one = np.array([(0.0, 0.0, 0.5)]), np.zeros(1, np.int64)
        every = [
            Sign("fault", "robot with a fault", [rings(pose, one, "mark", ""), *bodies(pose, one)]),
            Sign("joined", "robot that joined late", [rings(pose, one, "joined", ""), *bodies(pose, one)]),
            Sign("dead", "dead robot", dead_marks(pose, one), 6.0),
            Sign("removed", "where a robot was removed", [removed(pose, one)], 6.0),
        ]
        return [sign for sign in every if sign.kind in scene.signs]


def dead_marks(pose: Reals, of: Whole) -> list[Mark]:
    """Grey discs with crosses."""
    disc = Circles(pose[:, :2], 1.0, "dead", unit="body", of=of, rides=True, name="dead", z=DEAD)
    return [disc, forms(pose[:, :2], CROSS, of, "edge", DEAD, edge=None, rides=True)]


def removed(pose: Reals, of: Whole) -> Circles:
    """Grey rings."""
    return Circles(pose[:, :2], 1.0, "dead", stroke=0.45, unit="body", of=of, rides=True, name="removed", z=DEAD)


class LightLayer:
    """The colours of robots' lights."""

    name = "lights"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Discs of these colours, under the robots' smaller ones."""
        lit = np.empty(0, np.int64) if shot.lights is None else np.flatnonzero(shot.lights.any(axis=1) & shot.alive)
        if shot.lights is None or not len(lit):
            return []
        inks = ["#" + bytes(colour).hex() for colour in shot.lights[lit].tolist()]
        return [Circles(shot.pose[lit, :2], 1.6, inks, unit="body", of=lit, rides=True, name="light", z=LIGHTS)]

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """None: the strategy gives colours their meaning."""
        return []


class BeliefLayer:
    """Robots' estimated positions, if they may differ from the true ones."""

    name = "beliefs"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Rings, and lines to them from the robots."""
        live = np.flatnonzero(shot.alive)
        return [] if shot.believed is None else beliefs(shot.pose[live, :2], shot.believed[live], live)

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A robot with its ring."""
        ends, one = np.array([(-10.0, 0.0, 0.5), (10.0, 0.0, 0.0)]), np.zeros(1, np.int64)
        marks = [*bodies(ends[:1], one), *beliefs(ends[:1, :2], ends[1:, :2], one)]
        return [Sign("belief", "estimated position", marks)] * scene.has_beliefs


def beliefs(places: Reals, there: Reals, of: Whole) -> list[Mark]:
    """Rings at `there` (k, 2), and lines to them from the robots at `places` (k, 2), in m."""
    points = np.stack([places, there], axis=1).reshape(-1, 2)
    on = np.stack([of, np.full(len(of), -1)], axis=1).ravel()
    lines = Lines(points, 2 * np.arange(1, len(of) + 1), inks_of_robots(of), of=of, on=on, name="belief", z=BELIEFS)
    return [lines, Circles(there, 0.75, inks_of_robots(of), stroke=0.3, unit="body", of=of, name="belief", z=BELIEFS)]


class PeopleLayer:
    """People who walk about."""

    name = "people"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Discs with heads."""
        return people(shot.people) if len(shot.people) else []

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A person."""
        return [Sign("person", "person", people(np.array([(0.0, 0.0, 6.0)])))] * scene.has_people


def people(discs: Reals) -> list[Mark]:
    """Discs (p, 3), each x, y, radius in m, with heads."""
    body = Circles(discs[:, :2], discs[:, 2], "person", name="person", z=PEOPLE)
    return [body, Circles(discs[:, :2], 0.45 * discs[:, 2], "edge", None, name="head", z=PEOPLE)]

"""What robots sense, send and aim for: tiles, beams, links, ways and goals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from swarmsim.core.drawing import Dash, Ink, Lines, Mark, Polygons, Rays, Reals, Whole, ends_of
from swarmsim.view.layers.robots import forms, inks_of_robots
from swarmsim.view.scene import Frame, Pairs, Scene
from swarmsim.view.signs import Sign
from swarmsim.view.style import Style

TILES, BEAMS, WAYS, LINKS, GOALS = 40.0, 50.0, 60.0, 70.0, 80.0  # z
DIAMOND: Final = 0.6 * np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
ONE: Final = np.zeros(1, np.int64)


def shown(shot: Frame) -> Whole:
    """Live robots with tiles, ways and beams drawn."""
    return np.array([robot for robot in shot.chosen or range(len(shot.alive)) if shot.alive[robot]], np.int64)


class TileLayer:
    """The tile that each robot senses."""

    name = "tiles"

    def __init__(self, scene: Scene) -> None:
        self._size = scene.lattice.cell * np.array(scene.tile[::-1])

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Tinted rectangles."""
        robots = shown(shot)
        return [tiles(shot.origins[robots], self._size, robots)] if len(shot.origins) else []

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A tile."""
        tile = tiles(np.array([(-7.0, -6.0)]), np.array([14.0, 12.0]), ONE)
        return [Sign("tile", f"the {scene.tile[0]} x {scene.tile[1]} cells it senses", [tile])] * (scene.tile[0] > 0)


def tiles(corners: Reals, size: Reals, of: Whole) -> Polygons:
    """Rectangles of one size in m, by their lower left corners (k, 2)."""
    form, inks = size * np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]), inks_of_robots(of)
    points, ends = ends_of([form] * len(of))
    return Polygons(points, ends, inks, inks, 1.0, (0.13, 0.67), at=corners, of=of, name="tile", z=TILES)


class BeamLayer:
    """The beams of the chosen robots."""

    name = "beams"

    def __init__(self, scene: Scene) -> None:
        self._scene = scene

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Rays from robots to where their beams end."""
        found: list[Mark] = []
        for robot in shot.chosen:
            length = self._scene.beams(robot, shot) if shot.alive[robot] else np.empty(0)
            if len(length):
                pose, bearings = shot.pose[robot], np.array(self._scene.bearings[robot])
                found.append(
                    Rays(pose[None, :2], pose[2:], bearings, length[None], np.array([robot]), name="beams", z=BEAMS)
                )
        return found

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A fan."""
        fan = Rays(np.array([(-9.0, 0.0)]), np.zeros(1), np.array([-0.32, 0.0, 0.32]), np.full((1, 3), 18.0), ONE)
        return [Sign("beams", "its beams", [fan])] * bool(look.chosen)


class WayLayer:
    """The way ahead and the goal of each robot."""

    name = "ways"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Ways below links, goals over them."""
        robots = [robot for robot in shot.chosen or range(len(shot.ways)) if len(shot.ways[robot]) > 1]
        aims = np.flatnonzero(~np.isnan(shot.goals[:, 0]))
        aims = aims[np.isin(aims, shot.chosen)] if shot.chosen else aims
        return [ways([shot.ways[robot] for robot in robots], np.array(robots, np.int64)), goals(shot.goals[aims], aims)]

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """A way with its goal."""
        way = ways([np.array([(-10.0, -4.0), (-3.0, -4.0), (5.0, 0.0)])], ONE)
        return [Sign("aim", "its way ahead and goal", [way, goals(np.array([(6.0, 0.0)]), ONE)], 6.6)] * scene.walks


def ways(paths: Sequence[Reals], of: Whole) -> Lines:
    """Paths, each (w, 2) in m, from their robots on."""
    points, ends = ends_of(paths)
    on = np.full(len(points), -1)
    on[ends - np.diff(ends, prepend=0)] = of
    return Lines(points, ends, inks_of_robots(of), of=of, on=on, name="way", z=WAYS)


def goals(places: Reals, of: Whole) -> Polygons:
    """Diamonds."""
    return forms(places, DIAMOND, of, inks_of_robots(of), GOALS, "goal")


class LinkLayer:
    """Links: solid lines for heard messages, dashed for lost ones, dotted for those under way."""

    name = "links"

    def draw(self, shot: Frame) -> Sequence[Mark]:
        """Lines between robots; one-way links are arrows."""
        fates: tuple[tuple[str, Pairs, Ink, Dash], ...] = (
            ("waiting", shot.waiting, "link", "dotted"), ("lost", shot.lost, "lost", "dashed"),
            ("mutual", shot.mutual, "link", "whole"), ("one way", shot.one_way, "link", "whole"),
        )  # fmt: skip
        return [links(shot.pose, pairs, name, ink, dash) for name, pairs, ink, dash in fates if len(pairs)]

    def signs(self, scene: Scene, look: Style) -> list[Sign]:
        """The links that are ever drawn."""
        ends, pair = np.array([(10.0, 0.0), (-10.0, 0.0)]), np.array([(0, 1)])
        every: tuple[tuple[str, str, Ink, Dash], ...] = (
            ("mutual", "link: each hears the other", "link", "whole"),
            ("one way", "link: the arrow's end hears", "link", "whole"),
            ("lost", "message lost", "lost", "dashed"), ("waiting", "message under way", "link", "dotted"),
        )  # fmt: skip
        return [
            Sign(kind, text, [links(ends, pair, kind, ink, dash)], 0.0)
            for kind, text, ink, dash in every
            if kind in scene.signs
        ]


def links(pose: Reals, pairs: Pairs, name: str, ink: Ink, dash: Dash) -> Lines:
    """Lines from senders to receivers."""
    on = pairs[:, ::-1].ravel()
    ends = 2 * np.arange(1, len(pairs) + 1)
    return Lines(pose[on, :2], ends, ink, "halo", dash=dash, arrow=name != "mutual", on=on, name=name, z=LINKS)

"""All that moves in a building, drawn at one moment."""

from __future__ import annotations

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.view.camera import Camera
from swarmsim.view.lettering import Lettering
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.style import Style
from swarmsim.view.symbols import Pen
from swarmsim.view.theme import colour_of, ink_on

LEAST = 3.0  # pixels, the least radius of a robot's disc, which may then lie over another's
NAMED = 6.0  # pixels, the least radius of a disc that bears an id


class Foreground:
    """Robots and people, with what robots sense, say and want."""

    def __init__(
        self, scene: Scene, look: Style, camera: Camera, legible: float, line: int, letters: Lettering
    ) -> None:
        """Discs are drawn with a radius of at least `legible` pixels where they do not overlap."""
        self._scene, self._look, self._camera, self._line, self._letters = scene, look, camera, line, letters
        self._pen = Pen(look.colours)
        self._true = np.asarray(camera.scale * scene.radii, np.float64)
        self._wanted = np.maximum(self._true, legible)
        self.radius = float(self._wanted.max())  # pixels, of the largest robot with nobody near
        #: How many times robots are drawn too large, if they are.
        self.enlarged = float((self._wanted / self._true).max())
        self._ids: dict[tuple[int, int], pygame.Surface] = {}

    def radii(self, shot: Frame) -> NDArray[np.float64]:
        """The radii (n,) of discs in pixels: as large as legible or true, but smaller where they would overlap."""
        if self.enlarged <= 1.0:
            return self._true
        there = np.array([mark not in ("removed", "late") for mark in shot.marks]) | shot.alive
        places = self._camera.scale * np.where(there[:, None], shot.pose[:, :2], np.inf)
        with np.errstate(invalid="ignore"):
            apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        np.fill_diagonal(apart, np.inf)
        nearest = np.nan_to_num(apart, nan=np.inf, posinf=np.inf).min(axis=1)
        fitting: NDArray[np.float64] = np.minimum(self._wanted, 0.5 * nearest)
        return np.maximum(fitting, np.maximum(self._true, LEAST))

    def draw(self, surface: pygame.Surface, shot: Frame) -> None:
        """Paint everything: boxes, tiles, beams, ways, links, goals, people and robots, in this order."""
        layers, look, pen, line = self._look.layers, self._look, self._pen, self._line
        places: list[list[float]] = self._camera.pixels(shot.pose[:, :2]).tolist()
        radii: list[float] = self.radii(shot).tolist()
        live: list[int] = np.flatnonzero(shot.alive).tolist()
        for left, low, right, high in shot.boxes:
            corners = self._camera.pixels(np.array([(left, high), (right, low)]))
            (x1, y1), (x2, y2) = np.rint(corners).astype(int).tolist()
            pen.box(surface, pygame.Rect(x1, y1, max(x2 - x1, 3), max(y2 - y1, 3)), line)
        if "tiles" in layers:
            self._tiles(surface, shot, [robot for robot in live if look.shows(robot)])
        for robot in look.chosen if "beams" in layers else ():
            if shot.alive[robot]:
                ends = self._camera.pixels(self._scene.beams(robot, shot)).tolist()
                pen.beams(surface, (places[robot][0], places[robot][1]), ends, look.colours.mark)
        if "ways" in layers:
            for robot, points in enumerate(shot.ways):
                if len(points) > 1 and look.shows(robot):
                    pen.way(surface, self._camera.pixels(points).tolist(), colour_of(robot), line)
        if "links" in layers:
            self._links(surface, shot, places, radii)
        if "ways" in layers:
            for robot in np.flatnonzero(~np.isnan(shot.goals[:, 0])).tolist():
                if look.shows(robot):
                    x, y = self._camera.pixels(shot.goals[robot]).tolist()
                    pen.goal(surface, (x, y), 0.6 * radii[robot], colour_of(robot))
        if "people" in layers:
            for x, y, radius in shot.people.tolist():
                at = self._camera.pixels(np.array([x, y])).tolist()
                pen.person(surface, (at[0], at[1]), max(self._camera.scale * radius, 2.0 * line))
        self._robots(surface, shot, places, radii)

    def _tiles(self, surface: pygame.Surface, shot: Frame, robots: list[int]) -> None:
        rows, columns = (side * self._scene.lattice.cell * self._camera.scale for side in self._scene.tile)
        for robot in robots if len(shot.origins) else ():
            x, y = self._camera.pixels(shot.origins[robot])
            area = pygame.Rect(round(x), round(y - rows), round(columns), round(rows))
            self._pen.tile(surface, area, colour_of(robot))

    def _links(self, surface: pygame.Surface, shot: Frame, places: list[list[float]], radii: list[float]) -> None:
        def at(robot: int) -> tuple[float, float]:
            return places[robot][0], places[robot][1]

        for pairs, fate in ((shot.waiting, "under way"), (shot.lost, "lost")):
            for receiver, sender in pairs.tolist():
                self._pen.link(surface, at(sender), at(receiver), self._line, radii[receiver], fate)
        for one, other in shot.mutual.tolist():
            self._pen.link(surface, at(one), at(other), self._line)
        for receiver, sender in shot.one_way.tolist():
            self._pen.link(surface, at(sender), at(receiver), self._line, radii[receiver])

    def _robots(self, surface: pygame.Surface, shot: Frame, places: list[list[float]], radii: list[float]) -> None:
        pen, line = self._pen, self._line
        ats = [(x, y) for x, y in places]
        for robot in np.flatnonzero(~shot.alive).tolist():
            if shot.marks[robot] == "removed":
                pen.removed(surface, ats[robot], radii[robot])
            elif shot.marks[robot] != "late":
                pen.dead(surface, ats[robot], radii[robot])
        live = np.flatnonzero(shot.alive).tolist()
        believed = [] if shot.believed is None else self._camera.pixels(shot.believed).tolist()
        for robot in live if believed else ():
            there = (believed[robot][0], believed[robot][1])
            pen.belief(surface, ats[robot], there, radii[robot], colour_of(robot), line)
        for robot in live:
            if shot.marks[robot] == "fault":
                pen.fault(surface, ats[robot], radii[robot])
            elif shot.marks[robot] == "joined":
                pen.joined(surface, ats[robot], radii[robot])
            if shot.headings is not None and np.isfinite(shot.headings[robot]):
                pen.heading(surface, ats[robot], float(shot.headings[robot]), 4.0 * radii[robot], line)
            if shot.lights is not None and shot.lights[robot].any():
                pen.light(surface, ats[robot], radii[robot], tuple(shot.lights[robot].tolist()))
            yaw, label = float(shot.pose[robot, 2]), self._label(robot, radii[robot])
            pen.robot(surface, ats[robot], yaw, radii[robot], colour_of(robot), label)

    def _label(self, robot: int, radius: float) -> pygame.Surface | None:
        """A robot's id, as large as fits on a disc of this radius; none on a small one."""
        if radius < NAMED:
            return None
        key = (robot, round(radius))
        if key not in self._ids:
            widest = "0" * len(str(self._scene.robots - 1))
            size = self._letters.size(widest, max(10, round(1.9 * radius)), 10, int(1.7 * radius))
            self._ids[key] = self._letters.render(str(robot), size, ink_on(colour_of(robot)))
        return self._ids[key]

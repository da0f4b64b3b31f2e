"""A film of robots that find each other's frames: each map is turned like its robot's frame until they match."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Iterator
from typing import Final, TypeVar

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.core.drawing import Texts
from swarmsim.core.state import FREE, OCCUPIED, UNKNOWN, Moment
from swarmsim.operations.mapping.maps import Frames, Maps
from swarmsim.operations.mapping.sharing.places import Transform
from swarmsim.operations.mapping.sharing.policies import cells_of, mark_sensed
from swarmsim.view.camera import Camera
from swarmsim.view.layers.robots import bodies
from swarmsim.view.lettering import Lettering
from swarmsim.view.painter import Painter, opaque
from swarmsim.view.scene import Bounds, Scene
from swarmsim.view.theme import Colour, Theme, colour_of
from swarmsim.view.video import HOLD, Film

ROOM: Final = 0.1  # of the building's width and height, on each side
PANEL: Final = 0.24  # of the picture's width
SNAP: Final = 0.3  # share of its remaining way that a map moves in each frame of film
LINES: Final = 16  # robots that are listed by name

T = TypeVar("T")


class Gathering:
    """Draws robots' own maps, in the frames of reference that they share.

    It observes the run and draws from that alone. Robots that know how their frames relate have maps of one colour,
    placed as the first of these robots estimates. A frame not yet joined to robot 0's is turned about its first
    robot's start, so that this robot faced right.
    """

    def __init__(self, scene: Scene, start: NDArray[np.float64], film: Film) -> None:
        """`start` are the robots' initial poses (n, 3)."""
        width, height = film.size
        self._scene, self._film, self._start = scene, film, start
        self._theme: Theme = film.look.colours
        self._left = round(width * (1.0 - PANEL))
        margin = height // 30
        area = (margin, margin, self._left - 2 * margin, height - 2 * margin)
        self._camera, self._letters = Camera.fitting(_wider(scene.bounds), area), Lettering()
        self._painter = Painter(self._theme, self._camera, height / 720, self._letters)
        self._surface = opaque(film.size)
        self._ground = self._building(opaque(film.size))
        self._sensed = np.zeros((len(start), *scene.lattice.shape), np.bool_)
        self._roots = np.arange(len(start))
        self._place = self._cells(start[:, :2])  # where each robot's start is drawn, in cells ...
        self._turn = -start[:, 2]  # ... and how its map is turned, rad
        self._moment: Moment[Maps] | None = None

    def _building(self, surface: pygame.Surface) -> pygame.Surface:
        """The floor plan in faint lines, for viewers only."""
        surface.fill(self._theme.background)
        for layer in self._scene.layers.values():
            for part in layer.geoms:
                for ring in (part.exterior, *part.interiors):
                    corners = self._camera.pixels(np.array(ring.coords)[:, :2])
                    pygame.draw.aalines(surface, self._theme.solids["walls"], True, corners.tolist())
        return surface

    def _cells(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Places (p, 2) in m as row and column, in cells."""
        lattice = self._scene.lattice
        return np.asarray((points - (lattice.x0, lattice.y0))[:, ::-1] / lattice.cell)

    def sample(self, moment: Moment[Maps]) -> None:
        """Record one iteration."""
        tiles, frames = moment.readings.tiled, _frames(moment)
        self._moment = moment
        mark_sensed(self._sensed, moment.state.alive, tiles)
        for robot in range(len(self._roots)):
            first: NDArray[np.bool_] = frames.known[:, robot] & (self._roots == np.arange(len(self._roots)))
            self._roots[robot] = int(np.flatnonzero(first[: robot + 1] | (np.arange(robot + 1) == robot))[0])

    @property
    def frames(self) -> int:
        """How many frames of reference there are."""
        return len(np.unique(self._roots))

    def _drawn_at(self, robot: int, moment: Moment[Maps]) -> tuple[float, NDArray[np.float64]]:
        """The rotation of a robot's map, and where its start is drawn."""
        root = int(self._roots[robot])
        error = Transform(*_frames(moment).errors[root, robot])
        own = self._cells(self._start[[robot, root], :2])
        place = error.apply(own[:1])
        if root == 0:
            return error.turn, place[0]
        turn = -float(self._start[root, 2])
        return turn + error.turn, Transform(turn, 0.0, 0.0).apply(place - own[1])[0] + own[1]

    def draw(self) -> pygame.Surface:
        """The current picture; each call moves maps nearer to their places."""
        surface, moment = self._surface, self._moment
        surface.blit(self._ground, (0, 0))
        if moment is None:
            return surface
        cells = cells_of(moment.knowledge) * self._sensed
        pixels = pygame.surfarray.pixels3d(surface)
        order = sorted(range(len(cells)), key=lambda robot: (-int(self._roots[robot]), -robot))
        for robot in order:
            turn, place = self._drawn_at(robot, moment)
            away = (turn - self._turn[robot] + math.pi) % (2.0 * math.pi) - math.pi
            self._turn[robot] += SNAP * away
            self._place[robot] += SNAP * (place - self._place[robot])
            self._paint(pixels, cells[robot], robot)
        del pixels
        for robot in order:
            if moment.state.alive[robot]:
                self._draw_robot(robot, moment.state.pose[robot])
        self._tell(moment)
        return surface

    def _transform(self, robot: int) -> Transform:
        """The transform from the lattice to a robot's map as drawn."""
        turn = Transform(float(self._turn[robot]), 0.0, 0.0)
        ((row, column),) = self._place[robot] - turn.apply(self._cells(self._start[robot : robot + 1, :2]))
        return Transform(turn.turn, float(row), float(column))

    def _pixels(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        lattice = self._scene.lattice
        return self._camera.pixels(cells[:, ::-1] * lattice.cell + (lattice.x0, lattice.y0))

    def _paint(self, pixels: NDArray[np.uint8], cells: NDArray[np.uint8], robot: int) -> None:
        """One robot's map, pixel by pixel over the area that it covers."""
        rows, columns = (np.flatnonzero((cells != UNKNOWN).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return
        drawn, lattice = self._transform(robot), self._scene.lattice
        corners = np.array([(r, c) for r in (rows[0], rows[-1] + 1) for c in (columns[0], columns[-1] + 1)], float)
        box = self._pixels(drawn.apply(corners))
        (left, top), (right, low) = np.floor(box.min(axis=0)).astype(int), np.ceil(box.max(axis=0)).astype(int)
        left, top = max(left, 0), max(top, 0)
        right, low = min(right, self._left), min(low, pixels.shape[1])
        if right <= left or low <= top:
            return
        x, y = (at.reshape(-1) + 0.5 for at in np.meshgrid(np.arange(left, right), np.arange(top, low), indexing="ij"))
        metres = np.stack([(x - self._camera.left), (self._camera.low - y)], axis=1) / self._camera.scale
        there = (metres - (lattice.x0, lattice.y0))[:, ::-1] / lattice.cell
        places = np.floor(drawn.inverse().apply(there)).astype(np.int64)
        row, column = places[:, 0], places[:, 1]
        inside: NDArray[np.bool_] = (row >= 0) & (row < cells.shape[0]) & (column >= 0) & (column < cells.shape[1])
        found = np.where(inside, cells[np.where(inside, row, 0), np.where(inside, column, 0)], UNKNOWN)
        found = found.reshape(right - left, low - top)
        part = pixels[left:right, top:low]
        colour = colour_of(int(self._roots[robot]))
        part[found == FREE] = _mixed(colour, self._theme.background, 0.35)
        part[found == OCCUPIED] = colour

    def _draw_robot(self, robot: int, pose: NDArray[np.float64]) -> None:
        row, column = self._transform(robot).apply(self._cells(pose[None, :2]))[0].tolist()
        lattice, root, one = self._scene.lattice, int(self._roots[robot]), np.zeros(1, np.int64)
        placed = np.array(
            [(column * lattice.cell + lattice.x0, row * lattice.cell + lattice.y0, pose[2] + self._turn[robot])]
        )
        label = Texts(placed[:, :2], [str(robot)], 1.6, f"on robot {root}", "body", one)
        for mark in (*bodies(placed, one, f"robot {root}"), label):
            self._painter.paint(self._surface, mark, np.full(1, max(9.0, self._film.size[1] / 60)))

    def _tell(self, moment: Moment[Maps]) -> None:
        """The right column: an explanation, and each robot's frame."""
        theme, width, height = self._theme, self._film.size[0] - self._left, self._film.size[1]
        pygame.draw.rect(self._surface, theme.background, (self._left, 0, width, height))
        line, at = max(16, height // 32), height // 30

        def write(text: str, colour: Colour, size: float = 1.0, gap: float = 0.25) -> None:
            nonlocal at
            for row in textwrap.wrap(text, max(10, round(2.35 * width / (line * size)))) or [""]:
                drawn = self._letters.fitted(row, round(line * size), colour, width - line)
                self._surface.blit(drawn, (self._left, at))
                at += round(line * size)
            at += round(line * gap)

        count = self.frames
        write(self._scene.title, theme.text, 1.15, 0.8)
        write(f"iteration {moment.state.iteration + 1}", theme.text, gap=0.1)
        covered = math.floor(1000.0 * moment.measured.values["coverage"]) / 10.0  # 100 % is all of it
        write(f"coverage {covered:.1f} %", theme.text, gap=0.8)
        write(f"{count} frame{'s' * (count != 1)} of reference", theme.text, 1.3, 0.3)
        frames = _frames(moment)
        undecided = int(np.count_nonzero((frames.places > 0) & ~frames.known))
        write(f"undecided {undecided}, withdrawn {int(frames.withdrawn.sum())}", theme.text, gap=0.6)
        for robot, root in list(enumerate(self._roots.tolist()))[:LINES]:
            colour = colour_of(root)
            pygame.draw.circle(self._surface, colour, (self._left + line // 2, at + line // 2 - 2), line // 2 - 2)
            text = f"robot {robot}: {'its own' if robot == root else f'as robot {root} has it'}"
            drawn = self._letters.fitted(text, line, theme.text, width - 3 * line)
            self._surface.blit(drawn, (self._left + round(1.4 * line), at))
            at += round(1.25 * line)
        at += line
        write(
            "Each robot's own map, turned like its frame of reference until the frame's place in another's is known. "
            "Faint lines: the building, which no robot knows.",
            theme.muted, 0.9,
        )  # fmt: skip

    def pictures(
        self,
        tick: Callable[[], bool],
        progress: Callable[[int, int], None] | None,
        taken: Callable[[pygame.Surface], T],
    ) -> Iterator[T]:
        """All frames of the film, copied by `taken`; `tick` simulates an iteration, if any is left."""
        film, scene = self._film, self._scene
        step = film.speed / film.fps / scene.period  # iterations in a frame
        moving = math.ceil(scene.iterations / step - 1e-9)
        frames, done = moving + round(HOLD * film.fps), 0
        for k in range(frames):
            while done < min((k + 1) * step, scene.iterations) and tick():
                done += 1
            yield taken(self.draw())
            if progress is not None:
                progress(k + 1, frames)


def _wider(bounds: Bounds) -> Bounds:
    """These bounds with room for turned maps."""
    left, right, low, high = bounds
    aside, above = ROOM * (right - left), ROOM * (high - low)
    return left - aside, right + aside, low - above, high + above


def _mixed(one: Colour, other: Colour, share: float) -> Colour:
    red, green, blue = (round(share * a + (1.0 - share) * b) for a, b in zip(one, other, strict=True))
    return red, green, blue


def _frames(moment: Moment[Maps]) -> Frames:
    """What robots know of each other's frames of reference. Raises ValueError if all have the same."""
    frames = moment.knowledge.frames
    if frames is None:
        raise ValueError("these robots have one frame of reference; expected robots that find theirs")
    return frames

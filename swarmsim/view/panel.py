"""The side panel of a picture: numbers, the curve of the task and the legend."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.view import symbols
from swarmsim.view.scene import Scene, Shot
from swarmsim.view.symbols import Colour, Lettering

CROWDED = 11  # signs above which the legend is set closer


class Panel:
    """A column of the picture; what stands still in it is drawn once."""

    def __init__(self, scene: Scene, area: pygame.Rect, unit: float, letters: Lettering, enlarged: bool) -> None:
        """A column in `area` of the picture.

        `unit` is the size of things against those of a picture 720 pixels high; `enlarged` says that robots
        are drawn larger than they are.
        """
        self._scene, self._area, self._letters, self._unit = scene, area, letters, unit
        self._small = max(12, round(19 * unit))
        self._large = max(24, round(54 * unit))
        self._line = round(1.3 * self._small)
        self._still = pygame.Surface(area.size, 0, 32)
        self._still.fill(symbols.BACKGROUND)
        self._rows = self._headings()
        top = self._rows[-1][1] + self._line + round(16 * unit)
        signs = _legend(scene, enlarged)
        row = round((1.15 if len(signs) <= CROWDED else 1.0) * self._small)
        room = area.height - len(signs) * row - round(20 * unit)
        if room - top < 6 * self._line:  # too small a picture to explain itself
            room, signs = area.height, []
        self._plot(top, room)
        for place, (kind, text) in enumerate(signs):
            middle = room + round(10 * unit) + place * row + row // 2
            _sign(self._still, kind, (round(12 * unit) + 3, middle), unit)
            self._write(text, (round(32 * unit) + 4, middle), symbols.TEXT)

    def draw(self, surface: pygame.Surface, shot: Shot) -> None:
        """Paint the panel as it is at this moment."""
        origin, scene = self._area.topleft, self._scene
        surface.blit(self._still, origin)
        number = self._letters.render(self._worded(shot.value), self._large, symbols.CURVE)
        surface.blit(number, origin)
        values = (
            f"{shot.iteration} of {self._scene.iterations}",
            _clock(shot.time),
            f"{shot.alive.sum()} of {len(shot.alive)}",
            f"{shot.messages:,}".replace(",", " "),
        )
        for (x, y), value in zip(self._rows, values, strict=False):
            text = self._letters.render(value, self._small, symbols.TEXT)
            surface.blit(text, (origin[0] + x, origin[1] + y))
        done = round(self._plot_area.width * shot.iteration / self._scene.iterations)
        at = (origin[0] + self._plot_area.left, origin[1] + self._plot_area.top)
        surface.blit(self._done, at, (0, 0, done + 1, self._plot_area.height))
        height = round((1.0 - float(scene.height(np.array(shot.value)))) * (self._plot_area.height - 1))
        pygame.draw.aacircle(surface, symbols.BACKGROUND, (at[0] + done, at[1] + height), round(6 * self._unit) + 1)
        pygame.draw.aacircle(surface, symbols.CURVE, (at[0] + done, at[1] + height), max(3, round(5 * self._unit)))

    def _worded(self, value: float) -> str:
        """The value of the curve, in its unit."""
        curve = self._scene.curve
        scaled = curve.scale * value
        unit = curve.label.partition(", ")[2]
        if unit == "%":
            scaled = np.floor(10.0 * curve.scale * value) / 10.0  # 100 % is all of it
        return f"{scaled:{curve.format}} {unit}".rstrip()

    def _widest(self) -> str:
        """The longest text for a value of the curve."""
        ends = np.array(self._scene.limits) / self._scene.curve.scale
        values = self._scene.curves.union[:: max(1, self._scene.iterations // 200)]
        return max((self._worded(float(value)) for value in (*ends, *values)), key=len)

    def _write(self, text: str, at: tuple[int, int], colour: Colour, anchor: str = "midleft") -> None:
        width = self._area.width - at[0] if anchor == "midleft" else self._area.width
        drawn = self._letters.fitted(text, self._small, colour, width)
        place = drawn.get_rect()
        setattr(place, anchor, at)
        self._still.blit(drawn, place)

    def _headings(self) -> list[tuple[int, int]]:
        """Write what the numbers mean, and what never changes; gives the corner of each value's text."""
        scene, letters = self._scene, self._letters
        names = ("iteration", "simulated time", "robots alive", "messages heard", "topology", "seed")
        fixed = {"topology": scene.topology, "seed": str(scene.seed)}
        column = max(letters.render(name, self._small, symbols.MUTED).get_width() for name in names) + self._small
        wide = letters.render(self._widest(), self._large, symbols.CURVE).get_size()
        beside = (wide[0] + self._small // 2, wide[1] // 2 + self._small // 3)
        self._write(scene.curve.label.partition(",")[0], beside, symbols.MUTED)
        top = wide[1] + round(10 * self._unit)
        rows = [(column, top + place * self._line) for place in range(len(names))]
        half = letters.render("X", self._small, symbols.MUTED).get_height() // 2
        for name, (x, y) in zip(names, rows, strict=True):
            self._write(name, (0, y + half), symbols.MUTED)
            self._write(fixed.get(name, ""), (x, y + half), symbols.TEXT)
        return rows

    def _plot(self, top: int, bottom: int) -> None:
        """Draw axes and the whole curve, dim, and keep a bright one for the part that lies behind."""
        scene, line = self._scene, self._line
        (low, high), parts = scene.limits, (0.0, 0.25, 0.5, 0.75, 1.0)
        ticks = {part: f"{low + part * (high - low):.3g}" for part in parts}
        widths = [self._letters.render(tick, self._small, symbols.MUTED).get_width() for tick in ticks.values()]
        left = max(widths) + self._small // 2
        right = self._area.width - self._small
        area = pygame.Rect(left, top + line, right - left, bottom - top - round(3.3 * line))
        self._plot_area = area
        self._write(scene.curve.label, (0, top + line // 4), symbols.MUTED)
        self._write("iteration", (area.centerx, area.bottom + round(1.6 * line)), symbols.MUTED, "center")
        for part in parts[::2] if area.height < 5 * line else parts:
            y = area.bottom - 1 - round(part * (area.height - 1))
            pygame.draw.line(self._still, symbols.RULE, (area.left, y), (area.right, y))
            self._write(ticks[part], (area.left - self._small // 3, y), symbols.MUTED, "midright")
        for iteration in _ticks(scene.iterations, max(2, area.width // (3 * self._small))):
            x = area.left + round(area.width * iteration / scene.iterations)
            pygame.draw.line(self._still, symbols.RULE, (x, area.bottom), (x, area.bottom + line // 4))
            self._write(str(iteration), (x, area.bottom + round(0.75 * line)), symbols.MUTED, "center")
        self._name_marks(area)
        self._done = self._curve(area.size, 1.0)
        self._still.blit(self._curve(area.size, 0.35), area)

    def _name_marks(self, area: pygame.Rect) -> None:
        """Write upwards beside each mark what begins there, where nothing else is in the way."""
        lines = [area.left + round(at * (area.width - 1) / self._scene.iterations) for at in self._scene.marks]
        taken = [area.left - 1, *lines, area.right]
        for iteration, name in sorted(self._scene.names.items()):
            line = area.left + round(iteration * (area.width - 1) / self._scene.iterations)
            drawn = self._letters.fitted(name, round(0.85 * self._small), symbols.MUTED, area.height - 4)
            upright = pygame.transform.rotate(drawn, 90)
            width = upright.get_width()
            for left in (line + 2, line - 2 - width):
                if not any(left - 1 < x < left + width + 1 for x in taken):
                    self._still.blit(upright, (left, area.top + 2))
                    taken.append(left + width // 2)
                    break

    def _curve(self, size: tuple[int, int], strength: float) -> pygame.Surface:
        """Band, curve and marks on a transparent ground, in colours this strong (0 to 1)."""
        surface = pygame.Surface(size, pygame.SRCALPHA, 32)
        scene, curves = self._scene, self._scene.curves
        band, curve, mark = (
            pygame.Color(symbols.BACKGROUND).lerp(colour, strength)
            for colour in (symbols.BAND, symbols.CURVE, symbols.MARK)
        )
        rows = np.unique(np.linspace(0, scene.iterations - 1, 2 * size[0]).astype(int))
        x = rows * (size[0] - 1) / scene.iterations

        def line(share: NDArray[np.float64]) -> list[tuple[float, float]]:
            return list(zip(x.tolist(), ((1.0 - scene.height(share[rows])) * (size[1] - 1)).tolist(), strict=True))

        if len(rows) > 1 and curves.most is not None and curves.least is not None:
            symbols.polygon(surface, band, line(curves.most) + line(curves.least)[::-1])
        for iteration in scene.marks:
            at = round(iteration * (size[0] - 1) / scene.iterations)
            pygame.draw.line(surface, mark, (at, 0), (at, size[1]), max(1, round(1.5 * self._unit)))
        union = line(curves.union)
        for start, end in pairwise(union):
            pygame.draw.aaline(surface, curve, start, end, max(2, round(2.5 * self._unit)))
        return surface


def _legend(scene: Scene, enlarged: bool) -> list[tuple[str, str]]:
    """Every sign in the pictures of a scene, with what it means."""
    rows, columns = scene.tile
    signs = [
        ("robot", "robot, its id and heading" + (" (enlarged)" if enlarged else "")),
        ("tile", f"its tile: the {rows} x {columns} cells it senses"),
        ("aim", "its way ahead and goal"),
        ("mutual", "link: each hears the other"),
        ("one way", "link: the one at the arrow hears"),
        ("heading", "the heading it estimates"),
        ("belief", "where a robot believes to be"),
        ("fault", "robot with a fault"),
        ("dead", "dead robot"),
        ("removed", "where a robot was removed"),
        ("box", "box that was not there, or is moved"),
        ("field", "the field, as robots estimate it"),
        ("free", "free, in the map of any robot"),
        ("seen", "occupied, in the map of any robot"),
        ("unexplored", "floor in no map yet"),
        (
            "curves",
            "curve: all together; band: single robots" if scene.curves.most is not None else "curve: swarm",
        ),
        ("mark", "event"),
    ]
    rare = {kind: kind in scene.signs for kind in ("fault", "dead", "removed", "box")}
    rare |= {"mark": bool(scene.marks), "tile": rows > 0, "aim": scene.walks, "heading": scene.has_headings}
    rare["field"], rare["belief"] = scene.has_field, scene.has_beliefs
    rare |= dict.fromkeys(("free", "seen", "unexplored"), scene.has_maps)
    return [(kind, text) for kind, text in signs if rare.get(kind, True)]


def _sign(surface: pygame.Surface, kind: str, at: tuple[int, int], unit: float) -> None:
    """Draw one sign of the legend around a place, `unit` times its usual size."""
    (x, y), colour = at, symbols.colour_of(0)

    def box(left: float, top: float, width: float, height: float) -> pygame.Rect:
        return pygame.Rect(*(round(side) for side in (x + left * unit, y + top * unit, width * unit, height * unit)))

    ends, broad = ((x - 10 * unit, y), (x + 10 * unit, y)), max(1, round(2 * unit))
    match kind:
        case "robot":
            symbols.robot(surface, at, 0.5, 6 * unit, colour, pygame.Surface((0, 0)))
        case "tile":
            symbols.tile(surface, box(-7, -6, 14, 12), colour)
        case "aim":
            bend = (x - 3 * unit, y + 4 * unit)
            symbols.way(surface, [(x - 10 * unit, y + 4 * unit), bend, (x + 5 * unit, y)], colour, broad)
            symbols.goal(surface, (x + 6 * unit, y), 4 * unit, colour)
        case "mutual":
            symbols.link(surface, *ends, broad)
        case "one way":
            symbols.link(surface, *ends, broad, 0.0)
        case "heading":
            symbols.heading(surface, (x - 6 * unit, y), 0.5, 16 * unit, broad)
            symbols.robot(surface, (x - 6 * unit, y), 0.5, 3.5 * unit, colour, pygame.Surface((0, 0)))
        case "fault":
            symbols.fault(surface, at, 3.5 * unit)
            symbols.robot(surface, at, 0.5, 3.5 * unit, colour, pygame.Surface((0, 0)))
        case "belief":
            symbols.robot(surface, ends[0], 0.5, 3.5 * unit, colour, pygame.Surface((0, 0)))
            symbols.belief(surface, ends[0], ends[1], 5 * unit, colour, broad)
        case "removed":
            symbols.removed(surface, at, 6 * unit)
        case "box":
            symbols.box(surface, box(-7, -5, 14, 10), broad)
        case "dead":
            symbols.dead(surface, at, 6 * unit)
        case "curves":
            surface.fill(symbols.BAND, box(-9, 0, 18, 6))
            surface.fill(symbols.CURVE, box(-9, -4, 18, 2))
        case "field":
            for step in range(7):
                shade = symbols.heat(np.array(step / 6.0)).tolist()
                surface.fill(shade, box(-10 + 20 * step / 7, -5, 20 / 7 + 1, 10))
        case "mark":
            surface.fill(symbols.MARK, box(-1, -7, 2, 14))
        case _:
            surface.fill(
                {"free": symbols.FREE, "seen": symbols.SEEN}.get(kind, symbols.UNEXPLORED), box(-7, -5, 14, 10)
            )
            pygame.draw.rect(surface, symbols.RULE, box(-7, -5, 14, 10), 1)


def _clock(seconds: float) -> str:
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {rest:02d} s" if hours else f"{minutes} min {rest:02d} s"


def _ticks(last: int, most: int) -> list[int]:
    """At most about `most` round numbers from 0 to `last`."""
    step = 1
    while last / step > most:
        step = step * 5 // 2 if str(step)[0] == "2" else step * 2
    return list(range(0, last + 1, step))

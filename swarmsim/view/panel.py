"""The side panel of a picture: numbers, curves over time and the legend."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pygame
from numpy.typing import NDArray

from swarmsim.view.legend import draw_sign, signs
from swarmsim.view.lettering import Lettering
from swarmsim.view.painter import opaque, polygon
from swarmsim.view.scene import Frame, Scene
from swarmsim.view.style import Style
from swarmsim.view.theme import Colour, colour_of
from swarmsim.view.wording import worded_value

Reals = NDArray[np.float64]
STRIPS = 240  # points of the small curves


@dataclass(frozen=True)
class Strip:
    """A small curve over the whole run."""

    label: str
    at: Reals  # (s,): iterations
    lines: list[tuple[Reals, Colour]]  # (s,) values and their colours
    top: float  # the upper end of its axis


class Panel:
    """A part of the picture; its static parts are drawn once."""

    def __init__(
        self, scene: Scene, look: Style, area: pygame.Rect, unit: float, letters: Lettering, enlarged: float,
        columns: int = 1,
    ) -> None:  # fmt: skip
        """A panel of one or two columns in `area` of the picture.

        `unit` scales everything; it is 1 in a picture 720 pixels high. Robots are drawn `enlarged` times their size.
        """
        self._scene, self._look, self._area, self._letters, self._unit = scene, look, area, letters, unit
        self._theme = look.colours
        self._small, self._large = max(12, round(18 * unit)), max(24, round(50 * unit))
        self._line = round(1.25 * self._small)
        self._still = opaque(area.size)
        self._still.fill(self._theme.background)
        width = (area.width - (columns - 1) * round(24 * unit)) // columns
        first, second = pygame.Rect(0, 0, width, area.height), pygame.Rect(area.width - width, 0, width, area.height)
        top = self._headings(first)
        kinds = signs(scene, look, enlarged)
        row = round((1.2 if len(kinds) <= 11 else 1.05) * self._small)
        strip = round(3.2 * self._line)
        strips = self._strips()
        if columns == 1:
            room = area.height - len(kinds) * row - round(14 * unit)
            if room - top < 6 * self._line + len(strips) * strip:  # too small a picture for all of it
                strips = []
            if room - top < 6 * self._line:  # some signs of the legend are better than none
                fit = max(0, (area.height - top - 6 * self._line - round(14 * unit)) // row)
                kinds = kinds[:fit]
                room = area.height - len(kinds) * row - round(14 * unit) * bool(kinds)
            self._plot(pygame.Rect(0, top, width, room - top - len(strips) * strip))
            legend = (0, room + round(8 * unit))
            below = pygame.Rect(0, room - len(strips) * strip, width, strip)
        else:
            self._plot(pygame.Rect(0, top, width, area.height - top))
            fit = max(0, (area.height - len(strips) * strip) // row)
            kinds = kinds[:fit]
            below = pygame.Rect(second.left, 0, width, strip)
            legend = (second.left, len(strips) * strip + row // 2)
        self._done_strips = [self._strip(one, below.move(0, place * strip)) for place, one in enumerate(strips)]
        for place, sign in enumerate(kinds):
            middle = legend[1] + place * row + row // 2
            draw_sign(self._still, self._theme, letters, sign, (legend[0] + round(12 * unit) + 3, middle), unit)
            self._write(
                sign.means, (legend[0] + round(32 * unit) + 4, middle), self._theme.text, width - round(32 * unit) - 4
            )

    def draw(self, surface: pygame.Surface, shot: Frame) -> None:
        """Paint the panel for this moment."""
        (left, top), scene, unit = self._area.topleft, self._scene, self._unit
        surface.blit(self._still, (left, top))
        surface.blit(self._letters.render(self._worded(shot.value), self._large, self._theme.curve), (left, top))
        values = (
            f"{shot.iteration} of {scene.iterations}", clock(shot.time), f"{shot.alive.sum()} of {len(shot.alive)}",
            self._told(shot), self._faulty(shot),
        )  # fmt: skip
        for (x, y), value in zip(self._rows, values, strict=False):
            room = self._first.width - x
            text = self._letters.fitted(value, self._small, self._theme.text, room)
            surface.blit(text, (left + x, top + y))
        share = shot.iteration / max(scene.iterations, 1)
        for area, done in ((self._plot_area, self._done), *self._done_strips):
            across = round(area.width * share)
            surface.blit(done, (left + area.left, top + area.top), (0, 0, across + 1, area.height))
        height = round((1.0 - float(scene.height(np.array(shot.value)))) * (self._plot_area.height - 1))
        at = (left + self._plot_area.left + round(self._plot_area.width * share), top + self._plot_area.top + height)
        pygame.draw.aacircle(surface, self._theme.background, at, round(6 * unit) + 1)
        pygame.draw.aacircle(surface, self._theme.curve, at, max(3, round(5 * unit)))

    def _told(self, shot: Frame) -> str:
        """The groups and the messages so far; without room for both, the messages alone."""
        messages = f"{shot.messages:,} messages"
        return f"{shot.groups} group{'s' * (shot.groups != 1)}, {messages}" if self._grouped else messages

    def _faulty(self, shot: Frame) -> str:
        robots = [str(robot) for robot, mark in enumerate(shot.marks) if mark == "fault" and shot.alive[robot]]
        return f"robot{'s' * (len(robots) > 1)} {', '.join(robots)}" if robots else "none"

    def _worded(self, value: float) -> str:
        """The value of the curve, in its unit."""
        return "none" if np.isnan(value) else worded_value(self._scene.curve, value)

    def _widest(self) -> str:
        """The longest text for a value of the curve."""
        ends = np.array(self._scene.limits) / self._scene.curve.scale
        values = self._scene.curves.union[:: max(1, self._scene.iterations // 200)]
        return max((self._worded(float(value)) for value in (*ends, *values)), key=len)

    def _write(
        self, text: str, at: tuple[int, int], colour: Colour, width: int | None = None, anchor: str = "midleft"
    ) -> None:
        room = self._area.width if width is None else width
        drawn = self._letters.fitted(text, self._small, colour, room)
        place = drawn.get_rect()
        setattr(place, anchor, at)
        self._still.blit(drawn, place)

    def _headings(self, area: pygame.Rect) -> int:
        """Write the labels and the constant values; gives where they end."""
        scene, letters, theme = self._scene, self._letters, self._theme
        self._first = area
        faults = any(mark in scene.signs for mark in ("fault",))
        names = ["iteration", "simulated", "alive", "network", *(["faulty"] if faults else []), "topology", "seed"]
        fixed = {"topology": scene.topology, "seed": str(scene.seed)}
        column = max(letters.width(name, self._small) for name in names) + self._small // 2
        wide = letters.render(self._widest(), self._large, theme.curve).get_size()
        at = (wide[0] + self._small // 2, wide[1] // 2 + self._small // 3)
        of = "" if self._look.focus is None else ", all robots"
        label, room = scene.curve.label.partition(",")[0] + of, area.width - at[0]
        size = letters.size(label, self._small, round(0.75 * self._small), room)
        drawn = letters.fitted(label, size, theme.muted, room)
        self._still.blit(drawn, drawn.get_rect(midleft=at))
        top = wide[1] + round(8 * self._unit)
        longest = f"{scene.robots} groups, {scene.at(scene.iterations).messages:,} messages"
        self._grouped = letters.width(longest, self._small) <= area.width - column
        rows = [(column, top + place * self._line) for place in range(len(names))]
        half = letters.render("X", self._small, theme.muted).get_height() // 2
        for name, (x, y) in zip(names, rows, strict=True):
            self._write(name, (0, y + half), theme.muted)
            self._write(fixed.get(name, ""), (x, y + half), theme.text, area.width - x)
        self._rows = rows[: len(names) - 2]
        return rows[-1][1] + self._line + round(8 * self._unit)

    def _plot(self, room: pygame.Rect) -> None:
        """Draw axes and the whole curve, dim, and keep a bright one for the elapsed part."""
        scene, line, theme = self._scene, self._line, self._theme
        (low, high), parts = scene.limits, (0.0, 0.25, 0.5, 0.75, 1.0)
        ticks = {part: f"{low + part * (high - low):.3g}" for part in parts}
        widths = [self._letters.width(tick, self._small) for tick in ticks.values()]
        left = room.left + max(widths) + self._small // 2
        right = room.right - self._small
        area = pygame.Rect(left, room.top + line, right - left, max(line, room.height - round(2.4 * line)))
        self._plot_area = area
        self._key((room.left, room.top + line // 3), room.width)
        apart = 1 if area.height >= 5 * line else 2 if area.height >= 2.5 * line else 4
        for part in parts[::apart]:
            y = area.bottom - 1 - round(part * (area.height - 1))
            pygame.draw.line(self._still, theme.rule, (area.left, y), (area.right, y))
            self._write(ticks[part], (area.left - self._small // 3, y), theme.muted, anchor="midright")
        iterations = ticks_of(scene.iterations, max(2, area.width // (4 * self._small)))
        for iteration in iterations:
            x = area.left + round(area.width * iteration / scene.iterations)
            pygame.draw.line(self._still, theme.rule, (x, area.bottom), (x, area.bottom + line // 4))
            self._write(str(iteration), (x, area.bottom + round(0.75 * line)), theme.muted, anchor="center")
        self._name_marks(area)
        self._done = self._curve(area.size, 1.0)
        self._still.blit(self._curve(area.size, 0.35), area)

    def _lines(self) -> list[tuple[str, Reals, Colour, float]]:
        """The plot's lines: name, values, colour and width."""
        curves, theme, focus = self._scene.curves, self._theme, self._look.focus
        lines: list[tuple[str, Reals, Colour, float]] = []
        if curves.mean is not None and curves.worst is not None:
            lines = [("worst robot", curves.worst, theme.worst, 1.5), ("mean", curves.mean, theme.mean, 1.5)]
            lines = [line for line in lines if not np.allclose(line[1], curves.union)]
        if focus is not None and self._scene.robot_curve(focus) is not None:
            own = self._scene.robot_curve(focus)
            lines.append((f"robot {focus}", np.asarray(own), colour_of(focus), 2.0))
        name = self._scene.curve.label.partition(",")[0]
        return [*lines, ("all together" if lines else name, curves.union, theme.curve, 2.5)]

    def _key(self, at: tuple[int, int], width: int) -> None:
        """Write the lines' names in their colours."""
        x, unit = at[0], self._scene.curve.label.partition(", ")[2]
        for name, _, colour, _ in reversed(self._lines()):
            text = self._letters.render(name, self._small, colour)
            if x + text.get_width() <= at[0] + width:
                self._still.blit(text, text.get_rect(midleft=(x, at[1])))
                x += text.get_width() + round(0.6 * self._small)
        if unit:
            text = self._letters.render(unit, self._small, self._theme.muted)
            if x + text.get_width() <= at[0] + width:
                self._still.blit(text, text.get_rect(midleft=(x, at[1])))

    def _name_marks(self, area: pygame.Rect) -> None:
        """Label each mark vertically where there is room."""
        lines = [area.left + round(at * (area.width - 1) / self._scene.iterations) for at in self._scene.marks]
        taken = [area.left - 1, *lines, area.right]
        for iteration, name in sorted(self._scene.names.items()):
            line = area.left + round(iteration * (area.width - 1) / self._scene.iterations)
            drawn = self._letters.render(name, round(0.85 * self._small), self._theme.muted)
            if drawn.get_width() > area.height - 4:
                continue  # half a name says nothing; captions give it in full
            upright = pygame.transform.rotate(drawn, 90)
            upright = upright.subsurface(upright.get_bounding_rect())
            width = upright.get_width()
            for left in (line + 2, line - 2 - width):
                if left > area.left and not any(left - 1 < x < left + width + 1 for x in taken):
                    self._still.blit(upright, (left, area.top + 2))
                    taken.append(left + width // 2)
                    break

    def _curve(self, size: tuple[int, int], strength: float) -> pygame.Surface:
        """Curves and marks on a transparent ground, at this opacity (0 to 1)."""
        surface, scene, theme = pygame.Surface(size, pygame.SRCALPHA, 32), self._scene, self._theme
        rows = np.unique(np.linspace(0, scene.iterations - 1, 2 * size[0]).astype(int))
        x = rows * (size[0] - 1) / scene.iterations
        for iteration in scene.marks:
            at = round(iteration * (size[0] - 1) / scene.iterations)
            mark = pygame.Color(theme.background).lerp(theme.mark, strength)
            pygame.draw.line(surface, mark, (at, 0), (at, size[1]), max(1, round(1.5 * self._unit)))
        for _, values, colour, width in self._lines():
            drawn = pygame.Color(theme.background).lerp(colour, strength)
            y = (1.0 - scene.height(values[rows])) * (size[1] - 1)
            for start, end in pairwise(zip(x.tolist(), y.tolist(), strict=True)):
                pygame.draw.aaline(surface, drawn, start, end, max(1, round(width * self._unit)))
        return surface

    def _strips(self) -> list[Strip]:
        """The small curves: groups of the network, messages."""
        scene, theme = self._scene, self._theme
        at = np.unique(np.linspace(0, scene.iterations - 1, STRIPS).astype(int))
        counts = np.array([scene.messages(row) for row in at.tolist()], np.float64).reshape(-1, 2)
        if not counts.any():
            return []
        groups = np.array([scene.groups(row) for row in at.tolist()], np.float64)
        most = f"{groups.max():.0f}"
        strips = [Strip(f"groups that hear each other, up to {most}", at, [(groups, theme.mean)], groups.max())]
        lines = [(counts[:, 0], theme.mean), *([(counts[:, 1], theme.lost)] if counts[:, 1].any() else [])]
        top = float(counts.max())
        named = "heard and lost" if len(lines) > 1 else "heard"
        return [*strips, Strip(f"messages {named}, up to {top:.0f}", at, lines, top)]

    def _strip(self, strip: Strip, room: pygame.Rect) -> tuple[pygame.Rect, pygame.Surface]:
        """Draw a small curve, dim; gives its place, and a bright one."""
        self._write(strip.label, (room.left, room.top + self._line // 2), self._theme.muted, room.width)
        area = pygame.Rect(
            self._plot_area.left, room.top + self._line, self._plot_area.width, room.height - round(1.4 * self._line)
        )
        if room.left > self._plot_area.right:  # of another column
            area.left, area.width = room.left, room.width - self._small
        sheets = []
        for strength in (0.35, 1.0):
            sheet = pygame.Surface(area.size, pygame.SRCALPHA, 32)
            for values, colour in strip.lines:
                drawn = pygame.Color(self._theme.background).lerp(colour, strength)
                x = strip.at * (area.width - 1) / max(self._scene.iterations, 1)
                y = (1.0 - values / max(strip.top, 1.0)) * (area.height - 2)
                filled = list(zip(x.tolist(), y.tolist(), strict=True))
                if len(filled) > 1:
                    base = [(filled[-1][0], area.height), (filled[0][0], area.height)]
                    polygon(sheet, pygame.Color(self._theme.background).lerp(colour, 0.3 * strength), filled + base)
                    pygame.draw.aalines(sheet, drawn, False, filled)
            sheets.append(sheet)
        pygame.draw.line(self._still, self._theme.rule, area.bottomleft, area.bottomright)
        self._still.blit(sheets[0], area)
        return area, sheets[1]


def clock(seconds: float) -> str:
    """A duration in words."""
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min {rest:02d} s" if hours else f"{minutes} min {rest:02d} s"


def ticks_of(last: int, most: int) -> list[int]:
    """At most about `most` round numbers from 0 to `last`."""
    step = 1
    while last / step > most:
        step = step * 5 // 2 if str(step)[0] == "2" else step * 2
    return list(range(0, last + 1, step))

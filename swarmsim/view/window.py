"""A window on a run: view any place and time, and inject faults while it goes on."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final, Protocol

import numpy as np
import pygame

from swarmsim.core.errors import InputError
from swarmsim.recording.reader import Recording
from swarmsim.view.camera import Camera
from swarmsim.view.canvas import Canvas
from swarmsim.view.lettering import Lettering
from swarmsim.view.scene import Scene
from swarmsim.view.style import LAYERS, Style
from swarmsim.view.video import SMALLEST, Film, write_film

BAR: Final = 64  # pixels below the picture: the time line and a line of words
FRAMES: Final = 60  # a second
BUDGET: Final = 0.03  # s: the most simulating for one frame
LONGEST: Final = 0.25  # s: the most that time advances in one frame, so that repeating a run causes no leap
RENEWED: Final = 0.5  # s between drawings of the panel while a run goes on
SPEEDS: Final = (1, 2, 5, 10, 20, 50, 100, 200, 500)  # iterations a second
PUSH: Final = 0.5  # m/s
#: Faults for the picked robot, by key: a name and the fault's table.
STRIKES: Final[dict[int, tuple[str, dict[str, object]]]] = {
    pygame.K_k: ("killed", {"use": "crash"}),
    pygame.K_r: ("removed", {"use": "remove"}),
    pygame.K_b: ("blinded", {"use": "sensor", "failure": "off"}),
    pygame.K_m: ("muted", {"use": "radio", "failure": "transmit"}),
}
LAYER_KEYS: Final = dict(
    zip((pygame.K_1, pygame.K_2, pygame.K_3, pygame.K_4, pygame.K_5, pygame.K_6), LAYERS, strict=False)
)
#: Keys and what they do, by what they are about, in two columns.
HELP: Final[tuple[dict[str, dict[str, str]], ...]] = (
    {
        "time": {"space": "run, pause", "left, right": "one iteration", "+ -": "speed"},
        "view": {"wheel, drag": "zoom, move", "0": "all of the building", "t": "light or dark"},
        "layers": {str(number): name for number, name in enumerate(LAYER_KEYS.values(), 1)},
    },
    {
        "robots": {"click": "pick one", "escape": "pick none", "o": "its own map"},
        "harm the picked robot": {"k": "kill", "b": "blind", "m": "mute", "r": "remove", "p": "push to the pointer"},
        "building": {"right drag": "close a door, place a box", "backspace": "take that back"},
        "window": {"f": "save a film", "h": "this help", "q": "close"},
    },
)


class Show(Protocol):
    """A run to show, going on or over."""

    recording: Recording

    @property
    def live(self) -> bool:
        """Whether faults can be injected."""
        ...

    @property
    def over(self) -> bool:
        """Whether no iteration is left."""
        ...

    def advance(self) -> None:
        """Do one more iteration."""
        ...

    def strike(self, fault: dict[str, object], iteration: int) -> None:
        """Inject a fault at an iteration. Raises InputError."""
        ...

    def undo(self) -> None:
        """Undo the latest fault."""
        ...


class Window:
    """The window; `handle` takes one event of pygame's, `frame` draws one picture."""

    def __init__(
        self,
        show: Show,
        folder: Path,
        size: tuple[int, int] = (1280, 784),
        look: Style | None = None,
        speed: int = 20,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Films are saved into `folder`; `clock` gives seconds; it affects how much is simulated per frame, not what.

        Raises InputError without a display.
        """
        try:
            pygame.display.init()
            self._screen = pygame.display.set_mode(size, pygame.RESIZABLE)
        except pygame.error as problem:
            raise InputError(
                f"no window can be opened ({problem}); without a display use swarmsim video or swarmsim report"
            ) from problem
        pygame.display.set_caption("swarmsim")
        self._show, self._folder, self._look = show, folder, look or Style()
        self._clock = clock
        self._speed = min(range(len(SPEEDS)), key=lambda place: abs(SPEEDS[place] - speed))
        self._letters = Lettering()
        self.time = 0.0  # iterations
        self.playing = True
        self.open = True
        self.picked: int | None = None
        self.words = "h for help"
        self._helps = False
        self._camera: Camera | None = None
        self._dragged: tuple[int, int] | None = None  # where the left button went down
        self._moved = False
        self._box: tuple[int, int] | None = None  # where the right button went down
        self._films = 0
        self._renewed = 0.0
        self._scene = Scene(show.recording)
        self._canvas = self._drawn()

    def run(self) -> None:
        """Show the run until the window is closed."""
        clock = pygame.time.Clock()
        while self.open:
            seconds = min(clock.tick(FRAMES) / 1000.0, LONGEST)
            for event in pygame.event.get():
                self.handle(event)
            self.frame(seconds)
        pygame.display.quit()

    def frame(self, seconds: float) -> None:
        """Advance time by this many seconds, and draw."""
        if self.playing:
            self._play(seconds)
        self._renew()
        self._screen.fill(self._look.colours.background)
        self._screen.blit(self._canvas.draw(self.time), (0, 0))
        self._draw_picked()
        self._draw_bar()
        if self._helps:
            self._draw_help()
        pygame.display.flip()

    def handle(self, event: pygame.event.Event) -> None:
        """Handle one event."""
        if event.type == pygame.QUIT:
            self.open = False
        elif event.type == pygame.VIDEORESIZE:
            self._camera = None
            self._canvas = self._drawn()
        elif event.type == pygame.KEYDOWN:
            self._key(event.key)
        elif event.type == pygame.MOUSEWHEEL:
            self._camera = self._canvas.camera.zoomed(1.25**event.y, *pygame.mouse.get_pos())
            self._canvas = self._drawn()
        elif event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP, pygame.MOUSEMOTION):
            self._mouse(event)

    def _key(self, key: int) -> None:
        if key == pygame.K_q:
            self.open = False
        elif key == pygame.K_SPACE:
            self.playing = not self.playing
        elif key in (pygame.K_RIGHT, pygame.K_LEFT):
            self.playing = False
            self._go_to(float(int(self.time) + (1 if key == pygame.K_RIGHT else -1)))
        elif key in (pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS, pygame.K_MINUS, pygame.K_KP_MINUS):
            faster = key not in (pygame.K_MINUS, pygame.K_KP_MINUS)
            self._speed = min(max(self._speed + (1 if faster else -1), 0), len(SPEEDS) - 1)
            self.words = f"{SPEEDS[self._speed]} iterations a second"
        elif key in STRIKES:
            word, fault = STRIKES[key]
            self._strike(word, fault)
        elif key == pygame.K_p:
            self._push()
        elif key == pygame.K_BACKSPACE:
            self._show.undo()
            self._changed("taken back")
        elif key in LAYER_KEYS:
            self._wear(replace(self._look, layers=self._look.layers ^ {LAYER_KEYS[key]}))
            self.words = f"{LAYER_KEYS[key]} {'shown' if LAYER_KEYS[key] in self._look.layers else 'hidden'}"
        elif key == pygame.K_t:
            self._wear(replace(self._look, theme="light" if self._look.theme == "dark" else "dark"))
        elif key == pygame.K_o:
            self._wear(replace(self._look, focus=None if self._look.focus is not None else self.picked))
        elif key == pygame.K_ESCAPE:
            self.picked = None
            self._wear(replace(self._look, focus=None))
        elif key == pygame.K_0:
            self._camera = None
            self._canvas = self._drawn()
        elif key == pygame.K_f:
            self._film()
        elif key == pygame.K_h:
            self._helps = not self._helps

    def _mouse(self, event: pygame.event.Event) -> None:
        left, right = (
            getattr(event, "button", 0) == pygame.BUTTON_LEFT,
            getattr(event, "button", 0) == pygame.BUTTON_RIGHT,
        )
        if event.type == pygame.MOUSEMOTION:
            if self._dragged is not None and event.buttons[0]:
                self._drag(event, self._dragged)
        elif event.type == pygame.MOUSEBUTTONDOWN and left:
            self._dragged, self._moved = event.pos, False
            if event.pos[1] >= self._screen.get_height() - BAR:
                self._scrub(event.pos[0])
        elif event.type == pygame.MOUSEBUTTONUP and left:
            if not self._moved and event.pos[1] < self._screen.get_height() - BAR:
                self._pick(event.pos)
            self._dragged = None
        elif event.type == pygame.MOUSEBUTTONDOWN and right:
            self._box = event.pos
        elif event.type == pygame.MOUSEBUTTONUP and right and self._box is not None:
            self._close_off(self._box, event.pos)
            self._box = None

    def _drag(self, event: pygame.event.Event, start: tuple[int, int]) -> None:
        if start[1] >= self._screen.get_height() - BAR:
            self._scrub(event.pos[0])
        elif self._moved or np.hypot(event.pos[0] - start[0], event.pos[1] - start[1]) > 4.0:
            self._camera = self._canvas.camera.moved(*event.rel)
            self._canvas = self._drawn()
            self._moved = True

    def _scrub(self, x: int) -> None:
        share = (x - 12) / (self._screen.get_width() - 24)
        self.playing = False
        self._go_to(min(max(share, 0.0), 1.0) * self._scene.iterations)

    def _play(self, seconds: float) -> None:
        """Advance time, and simulate up to it: at least one iteration, but no longer than a frame may take. Time waits
        for the simulation.
        """
        show, moment = self._show, self.time + seconds * SPEEDS[self._speed]
        until = self._clock() + BUDGET
        while moment > show.recording.iterations and not show.over:
            show.advance()
            if self._clock() > until:
                break
        self._look_at(moment)

    def _go_to(self, moment: float) -> None:
        """Move time, and simulate up to it."""
        while moment > self._show.recording.iterations and not self._show.over:
            self._show.advance()
        self._look_at(moment)

    def _look_at(self, moment: float) -> None:
        """Move time within the simulated part."""
        recording = self._show.recording
        self.time = min(max(moment, 0.0), float(recording.iterations))
        if recording.iterations > self._scene.iterations:
            self._scene.refresh()
        if self._show.over and self.time >= recording.iterations:
            self.playing = False

    def _renew(self) -> None:
        """Redraw the panel of a run that goes on, now and then."""
        now = self._clock()
        if self._canvas.outdated and now - self._renewed > RENEWED:
            self._canvas.renew()
            self._renewed = now

    def _strike(self, word: str, fault: dict[str, object]) -> None:
        """Inject a fault into the picked robot, from the next iteration on."""
        if self.picked is None:
            self.words = "pick a robot first: click on it"
            return
        keep = {} if "box" in fault else {"robots": [self.picked], "min_alive": 0}
        self._try({**fault, **keep}, f"robot {self.picked} {word}")

    def _push(self) -> None:
        if self.picked is None:
            self.words = "pick a robot first: click on it"
            return
        x, y = self._canvas.camera.metres(*pygame.mouse.get_pos())
        here = self._scene.at(self.time).pose[self.picked, :2]
        way = np.array([x, y]) - here
        velocity = (PUSH * way / max(float(np.hypot(*way)), 1e-9)).round(3).tolist()
        self._try(
            {"use": "push", "velocity": velocity, "robots": [self.picked], "min_alive": 0},
            f"robot {self.picked} pushed",
        )

    def _close_off(self, one: tuple[int, int], other: tuple[int, int]) -> None:
        """Put a box between two corners of the picture."""
        (x1, y1), (x2, y2) = (self._canvas.camera.metres(*corner) for corner in (one, other))
        box = [round(edge, 2) for edge in (min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))]
        self._try({"use": "door", "box": box}, "door closed")

    def _try(self, fault: dict[str, object], word: str) -> None:
        iteration = int(self.time) + 1  # after the one shown, however far the run has come
        try:
            self._show.strike(fault, iteration)
        except InputError as problem:
            self.words = str(problem)
            return
        self._changed(f"iteration {iteration}: {word}")

    def _changed(self, word: str) -> None:
        """Show the new recording."""
        self._scene = Scene(self._show.recording)
        self.time = min(self.time, float(self._scene.iterations))
        self._canvas = self._drawn()
        self.words = word

    def _pick(self, pos: tuple[int, int]) -> None:
        """Pick the robot at a place of the picture, if any."""
        places = self._canvas.pixels(self._scene.at(self.time).pose[:, :2])
        apart = np.hypot(*(places - np.array(pos)).T)
        nearest = int(apart.argmin())
        self.picked = nearest if apart[nearest] <= max(2.0 * self._canvas.radius, 12.0) else None
        focus = self.picked if self._look.focus is not None else None
        if focus != self._look.focus:
            self._wear(replace(self._look, focus=focus))
        self.words = "no robot picked" if self.picked is None else f"robot {self.picked} picked"

    def _wear(self, look: Style) -> None:
        if look != self._look:
            self._look = look
            self._canvas = self._drawn()

    def _drawn(self) -> Canvas:
        width, height = self._screen.get_size()
        size = (max(width, SMALLEST[0]), max(height - BAR, SMALLEST[1]))
        self._renewed = self._clock()
        return Canvas(self._scene, size, self._look, self._camera, finest=size[0])

    def _film(self) -> None:
        self._films += 1
        out = self._folder / f"film-{self._films}.mp4"

        def told(done: int, of: int) -> None:
            if done % 20 == 0:
                self.words = f"film: frame {done} of {of}"
                self._draw_bar()
                pygame.display.flip()
                pygame.event.pump()

        write_film(self._show.recording, out, Film(look=self._look), None, told)
        self.words = f"film: {out}"

    def _draw_picked(self) -> None:
        if self.picked is not None:
            x, y = self._canvas.pixels(self._scene.at(self.time).pose[self.picked, :2]).tolist()
            if self._canvas.area.collidepoint(x, y):
                pygame.draw.aacircle(self._screen, self._look.colours.text, (x, y), 2.2 * self._canvas.radius, 2)
        if self._box is not None:
            (x1, y1), (x2, y2) = self._box, pygame.mouse.get_pos()
            area = pygame.Rect(min(x1, x2), min(y1, y2), abs(x2 - x1), abs(y2 - y1))
            pygame.draw.rect(self._screen, self._look.colours.mark, area, 2)

    def _draw_bar(self) -> None:
        """The time line, and the latest action."""
        theme, (width, height) = self._look.colours, self._screen.get_size()
        self._screen.fill(theme.background, (0, height - BAR, width, BAR))
        line = pygame.Rect(12, height - BAR + 8, width - 24, 10)
        pygame.draw.rect(self._screen, theme.rule, line, border_radius=5)
        done = self.time / max(self._scene.iterations, 1)
        pygame.draw.rect(
            self._screen, theme.curve, (*line.topleft, round(line.width * done), line.height), border_radius=5
        )
        for mark in self._scene.marks:
            x = line.left + round(line.width * mark / max(self._scene.iterations, 1))
            pygame.draw.line(self._screen, theme.mark, (x, line.top - 2), (x, line.bottom + 2), 2)
        state = "running" if self.playing else "over" if self._show.over and done >= 1.0 else "paused"
        told = f"{state}, {SPEEDS[self._speed]} iterations a second    {self.words}"
        size = self._letters.size(told, 20, 15, width - 24)
        text = self._letters.fitted(told, size, theme.text, width - 24)
        self._screen.blit(text, (12, height - BAR + 30))

    def _draw_help(self) -> None:
        theme, letters = self._look.colours, self._letters
        columns = [[line for about, keys in column.items() for line in ((about, ""), *keys.items())] for column in HELP]
        rows = max(map(len, columns))
        whole, high = self._screen.get_width(), self._screen.get_height() - BAR
        row = min(30, (high - 40) // rows)
        size, width = round(0.72 * row), min(whole - 60, 28 * row)
        area = pygame.Rect(0, 0, width, row * rows + 30)
        area.center = (whole // 2, high // 2)
        pygame.draw.rect(self._screen, theme.background, area, border_radius=8)
        pygame.draw.rect(self._screen, theme.rule, area, 2, border_radius=8)
        for left, lines in zip((area.left + 20, area.centerx + 10), columns, strict=True):
            for place, (key, does) in enumerate(lines):
                top = area.top + 15 + row * place
                heading = letters.fitted(key, size, theme.text if does else theme.muted, width // 2 - 30)
                self._screen.blit(heading, (left if not does else left + row // 2, top))
                if does:
                    self._screen.blit(
                        letters.fitted(does, size, theme.text, width // 2 - 6 * row), (left + 5 * row, top)
                    )


def driver() -> str:
    """The name of the display driver. Raises InputError if there is none."""
    try:
        pygame.display.init()
        found = pygame.display.get_driver()
        pygame.display.quit()
    except pygame.error as problem:
        raise InputError(str(problem)) from problem
    if found in ("dummy", "offscreen"):
        raise InputError(f"no display, pygame draws {found!r}")
    return found

"""Films and stills of a recorded run: H.264, an animated GIF or numbered pictures, drawn frame by frame."""

from __future__ import annotations

import math
import os
import subprocess
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TypeVar

import imageio_ffmpeg
import numpy as np
import pygame
from numpy.typing import NDArray
from PIL import Image

from swarmsim.core.errors import OF_THE_MACHINE, InputError, StorageError, unwritten
from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.lettering import Lettering
from swarmsim.view.painter import opaque
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.title_cards import draw_card, first_lines, last_lines

HOLD = 2.0  # s of film that the end and each card stay
SMALLEST = (480, 270)  # pixels; below this nothing is legible
LARGEST = (7680, 4320)  # pixels
FASTEST = {".mp4": 120, ".gif": 50, ".png": 120}  # frames per second; players slow down faster GIFs
#: No visible loss; a fixed number of threads, because x264's bytes depend on it; index at the front.
ENCODER = ["-crf", "19", "-preset", "veryfast", "-threads", "4", "-movflags", "+faststart", "-fflags", "+bitexact"]
AHEAD = 8  # frames that may wait for the encoder
SAMPLES = 5  # frames whose colours make a GIF's palette

T = TypeVar("T")
Pixels = NDArray[np.uint8]  # (height, width, 3): red, green, blue


@dataclass(frozen=True)
class Film:
    """Options of a film. Raises InputError for invalid ones."""

    fps: int = 30  # frames per second of film
    speed: float = 20.0  # simulated seconds per second of film
    size: tuple[int, int] = (1280, 720)  # width and height in pixels
    look: Style = field(default_factory=Style)
    cards: bool = True  # whether it begins with the scenario and ends with the result, two seconds each

    def __post_init__(self) -> None:
        if not (math.isfinite(self.speed) and self.speed > 0.0):
            raise InputError(f"--speed {self.speed:g}: expected more than 0 simulated seconds per second of film")
        _check_size(self.size)


def frame(
    recording: Recording, iteration: float, size: tuple[int, int] = (1280, 720), look: Style | None = None
) -> Pixels:
    """The picture (height, width, 3) after this many iterations, from 0 to the recording's `iterations`.

    Raises InputError if the moment lies outside the run or the size is too small or too large.
    """
    _check_size(size)
    if not 0.0 <= iteration <= recording.iterations:
        raise InputError(f"iteration {iteration:g}: the recording goes from 0 to {recording.iterations}")
    return _pixels(Canvas(Scene(recording), size, look).draw(iteration))


def write_film(
    recording: Recording,
    out: Path,
    film: Film | None = None,
    beside: Recording | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the film of a run to `out`. Its suffix sets the format: .mp4 for H.264, .gif for an endless GIF, .png for
    pictures OUT-00000.png and so on.

    The end is held for two seconds. `beside` shows a second run, side by side and in step. `progress` is called after
    every frame with the frames done and their total. Files appear whole or not at all, and replace older ones. Raises
    InputError for invalid options.
    """
    film = film or Film()
    check_film(out, film)
    stage = Stage([recording, *([] if beside is None else [beside])], film)
    suffix = out.suffix.lower()
    with _whole(out) as part:
        if suffix == ".mp4":
            _write_mp4(part, stage.pictures(progress, _memory), film.size, film.fps)
        elif suffix == ".gif":
            samples = [stage.at(time) for time in np.linspace(0.0, stage.duration, SAMPLES).tolist()]
            _write_gif(part, stage.pictures(progress, _pixels), film.fps, samples)
        else:
            for number, picture in enumerate(stage.pictures(progress, _pixels, held=False)):
                Image.fromarray(picture).save(part.with_name(f"{part.stem}-{number:05d}.png"))


class Stage:
    """One run, or two side by side, drawn at any time."""

    def __init__(self, recordings: list[Recording], film: Film) -> None:
        self._film, self._recordings = film, recordings
        width, height = film.size
        self._scenes = [Scene(recording) for recording in recordings]
        self._canvases = [Canvas(scene, (width // len(recordings), height), film.look) for scene in self._scenes]
        self._surface = opaque(film.size)
        self._surface.fill(film.look.colours.rule)
        self._letters = Lettering()
        #: s, simulated: the length of the longest run.
        self.duration = max(scene.iterations * scene.period for scene in self._scenes)

    def pictures(
        self,
        progress: Callable[[int, int], None] | None,
        taken: Callable[[pygame.Surface], T],
        held: bool = True,
    ) -> Iterator[T]:
        """All frames of the film in order, copied by `taken`; `held`: with cards and an end that stays."""
        film = self._film
        step = film.speed / film.fps
        moving = math.ceil(self.duration / step - 1e-9)
        hold = round(HOLD * film.fps)
        cards = held and film.cards
        frames = moving + (hold if held else 1) + 2 * hold * cards
        done = 0

        def shown(picture: T, times: int = 1) -> Iterator[T]:
            nonlocal done
            for _ in range(times):
                yield picture
                done += 1
                if progress is not None:
                    progress(done, frames)

        if cards:
            yield from shown(taken(self._card(0.0, first_lines)), hold)
        for k in range(moving):
            yield from shown(taken(self._draw(k * step)))
        yield from shown(taken(self._draw(self.duration)), hold if held else 1)
        if cards:
            yield from shown(taken(self._card(self.duration, last_lines)), hold)

    def at(self, time: float) -> Pixels:
        """The picture (height, width, 3) at a simulated time in s; a run that is over keeps its last picture."""
        return _pixels(self._draw(time))

    def _draw(self, time: float) -> pygame.Surface:
        for place, (scene, canvas) in enumerate(zip(self._scenes, self._canvases, strict=True)):
            drawn = canvas.draw(min(time / scene.period, float(scene.iterations)))
            if len(self._canvases) == 1:
                return drawn
            gap = 2 * place  # a line between the two
            self._surface.blit(drawn, (place * (self._film.size[0] // 2) + gap, 0), (gap, 0, *drawn.get_size()))
        return self._surface

    def _card(self, time: float, lines: Callable[[Recording, Scene], list[str]]) -> pygame.Surface:
        surface = self._draw(time).copy()
        width = surface.get_width() // len(self._scenes)
        for place, (recording, scene) in enumerate(zip(self._recordings, self._scenes, strict=True)):
            part = surface.subsurface((place * width, 0, width, surface.get_height()))
            draw_card(part, lines(recording, scene), self._film.look.colours, self._letters)
        return surface


def write_pictures(
    out: Path, film: Film, pictures: Callable[[Callable[[pygame.Surface], bytes]], Iterator[bytes]]
) -> None:
    """Write any pictures as an H.264 film. It appears whole or not at all."""
    check_film(out, film)
    if out.suffix.lower() != ".mp4":
        raise InputError(f"{out}: this kind of film ends in .mp4")
    with _whole(out) as part:
        _write_mp4(part, pictures(_memory), film.size, film.fps)


def _write_mp4(part: Path, pictures: Iterable[bytes], size: tuple[int, int], fps: int) -> None:
    """H.264 with half the colour resolution, which every player supports."""
    with _encoder(part, size, fps) as film, ThreadPoolExecutor(1) as writer:
        writing: deque[Future[int]] = deque()
        for picture in pictures:  # drawn while earlier ones are encoded
            writing.append(writer.submit(film.write, picture))
            if len(writing) > AHEAD:
                writing.popleft().result()
        for written in writing:
            written.result()


@contextmanager
def _encoder(part: Path, size: tuple[int, int], fps: int) -> Iterator[IO[bytes]]:
    """A sink for pictures from `_memory`. Raises OSError if the encoder did not write a whole film.

    It is started here because imageio_ffmpeg does not check the encoder's exit code.
    """
    command = [
        imageio_ffmpeg.get_ffmpeg_exe(), "-f", "rawvideo", "-s", f"{size[0]}x{size[1]}", "-pix_fmt", "bgr0",
        "-r", str(fps), "-i", "-", "-an", "-vcodec", "libx264", "-pix_fmt", "yuv420p", "-v", "error", "-xerror",
        *ENCODER, str(part),
    ]  # fmt: skip
    with subprocess.Popen(  # it reports a file size limit as an error, not by a signal; Ctrl-C is for us
        command, stdin=subprocess.PIPE, stderr=subprocess.PIPE, restore_signals=False, process_group=0
    ) as encoder:
        assert encoder.stdin is not None
        assert encoder.stderr is not None
        try:
            yield encoder.stdin
        except BrokenPipeError:  # it reports why it ended
            pass
        except BaseException:
            encoder.kill()
            raise
        finally:
            with suppress(BrokenPipeError):
                encoder.stdin.close()
        told = encoder.stderr.read().decode(errors="replace").strip()
    if encoder.returncode:
        reasons = (os.strerror(number) for number in OF_THE_MACHINE)
        last = told.rpartition("\n")[2] or f"exit code {encoder.returncode}"
        raise OSError(next((reason for reason in reasons if reason in told), f"the encoder: {last}"))


def _write_gif(part: Path, pictures: Iterable[Pixels], fps: int, samples: list[Pixels]) -> None:
    """An endless GIF. Its frames share one palette and hold only changes; nothing is dithered."""
    palette = Image.fromarray(np.vstack(samples)).quantize(255, dither=Image.Dither.NONE)
    frames = [Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    frames[0].save(
        part, "GIF", save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0, optimize=True
    )


def _memory(surface: pygame.Surface) -> bytes:
    """A copy of an `opaque` surface's pixels, as the encoder takes them."""
    return surface.get_view("0").raw


def _pixels(surface: pygame.Surface) -> Pixels:
    width, height = surface.get_size()
    return np.frombuffer(pygame.image.tobytes(surface, "RGB"), np.uint8).reshape(height, width, 3)


def check_film(out: Path, film: Film | None = None) -> None:
    """Raise InputError if `write_film` would refuse to write there, to be known before a long run."""
    film, suffix = film or Film(), out.suffix.lower()
    if suffix not in FASTEST:
        raise InputError(f"{out}: films end in .mp4 or .gif, or in .png for numbered pictures, not in {suffix!r}")
    there = next(folder for folder in out.absolute().parents if folder.exists())
    if not there.is_dir():
        raise InputError(f"{out}: {there} is not a folder; expected a place for a file")
    if out.is_dir():
        raise InputError(f"{out}: this is a folder; expected the name of a file")
    if not 1 <= film.fps <= FASTEST[suffix]:
        raise InputError(f"--fps {film.fps}: expected 1 to {FASTEST[suffix]} frames per second for {suffix}")
    size = film.size
    if suffix == ".mp4" and (size[0] % 2 or size[1] % 2):
        even = f"{size[0] + size[0] % 2}x{size[1] + size[1] % 2}"
        raise InputError(f"--size {size[0]}x{size[1]}: H.264 needs even numbers; expected for example {even}")


def _check_size(size: tuple[int, int]) -> None:
    if not all(least <= side <= most for least, side, most in zip(SMALLEST, size, LARGEST, strict=True)):
        raise InputError(
            f"--size {size[0]}x{size[1]}: expected {SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]} pixels"
        )


@contextmanager
def _whole(out: Path) -> Iterator[Path]:
    """A file in a temporary folder beside `out`. Its files move beside `out` at the end, or vanish on an exception."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent, ignore_cleanup_errors=True)
    except OSError as problem:
        raise unwritten(out, problem) from problem
    with folder as name:
        try:
            yield Path(name) / out.name
            for made in sorted(Path(name).iterdir()):
                made.replace(out.parent / made.name)
        except OSError as problem:
            told = problem.strerror or str(problem).strip().partition("\n")[0]
            raise StorageError(f"{out}: cannot be written ({told}); no film was kept") from problem

"""Films and stills of a recorded run: H.264 or an animated GIF, encoded frame by frame."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pygame
from numpy.typing import NDArray
from PIL import Image

from swarmsim.core.errors import InputError
from swarmsim.recording.reader import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.scene import Scene

HOLD = 2.0  # s of film, how long the end stays
SMALLEST = (480, 270)  # pixels, below which nothing can be read
LARGEST = (7680, 4320)  # pixels
FASTEST = {".mp4": 120, ".gif": 50}  # frames per second; players slow faster GIFs down
#: No loss that the eye sees; a fixed number of threads, because x264's bytes depend on it; index at the front.
ENCODER = ["-crf", "19", "-preset", "veryfast", "-threads", "4", "-movflags", "+faststart", "-fflags", "+bitexact"]
SAMPLES = 5  # frames whose colours make a GIF's palette

Pixels = NDArray[np.uint8]  # (height, width, 3): red, green, blue


def frame(recording: Recording, iteration: float, size: tuple[int, int] = (1280, 720)) -> Pixels:
    """The picture (height, width, 3) after so many iterations, from 0 to the recording's `iterations`.

    Raises InputError if the moment lies outside of the run or the size is too small or too large.
    """
    _check_size(size)
    if not 0.0 <= iteration <= recording.iterations:
        raise InputError(f"iteration {iteration:g}: the recording goes from 0 to {recording.iterations}")
    return _pixels(Canvas(Scene(recording), size).draw(iteration))


def write_film(
    recording: Recording,
    out: Path,
    fps: int = 30,
    speed: float = 20.0,
    size: tuple[int, int] = (1280, 720),
    progress: Callable[[int, int], None] | None = None,
) -> None:
    """Write the film of a run to `out`, whose suffix says how: .mp4 for H.264, .gif for an endless GIF.

    `speed` is simulated seconds per second of film, `size` the width and height in pixels; the end is held
    for two seconds. `progress` is called after every frame with the frames done and all frames. The file
    appears whole or not at all, in place of an older one. Raises InputError for options that cannot work.
    """
    check_film(out, fps, speed, size)
    canvas = Canvas(Scene(recording), size)
    pictures = _pictures(canvas, _moments(recording, fps, speed), progress)
    with _whole(out) as part:
        if out.suffix.lower() == ".mp4":
            _write_mp4(part, pictures, fps)
        else:
            samples = np.linspace(0.0, recording.iterations, SAMPLES)
            _write_gif(part, pictures, fps, [_pixels(canvas.draw(moment)) for moment in samples])


def _pictures(canvas: Canvas, moments: list[float], progress: Callable[[int, int], None] | None) -> Iterator[Pixels]:
    for done, moment in enumerate(moments):
        if done == 0 or moment != moments[done - 1]:
            picture = _pixels(canvas.draw(moment))
        yield picture
        if progress is not None:
            progress(done + 1, len(moments))


def _write_mp4(part: Path, pictures: Iterable[Pixels], fps: int) -> None:
    """H.264 with half the colour resolution, as every player knows it."""
    film = imageio.get_writer(
        part, "FFMPEG", fps=fps, codec="libx264", pixelformat="yuv420p", quality=None, macro_block_size=2,
        ffmpeg_log_level="error", output_params=ENCODER,
    )  # fmt: skip
    with closing(film):  # as a context of its own it would leave ffmpeg running after an exception
        for picture in pictures:
            film.append_data(picture)


def _write_gif(part: Path, pictures: Iterable[Pixels], fps: int, samples: list[Pixels]) -> None:
    """An endless GIF whose frames share one palette and hold only what changed; nothing is dithered."""
    palette = Image.fromarray(np.vstack(samples)).quantize(255, dither=Image.Dither.NONE)
    frames = [Image.fromarray(picture).quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    frames[0].save(
        part, "GIF", save_all=True, append_images=frames[1:], duration=round(1000 / fps), loop=0, optimize=True
    )


def _moments(recording: Recording, fps: int, speed: float) -> list[float]:
    """The moment of every frame, in iterations."""
    step = speed / (fps * recording.scenario.period)
    moving = math.ceil(recording.iterations / step - 1e-9)
    return [k * step for k in range(moving)] + [float(recording.iterations)] * round(HOLD * fps)


def _pixels(surface: pygame.Surface) -> Pixels:
    width, height = surface.get_size()
    return np.frombuffer(pygame.image.tobytes(surface, "RGB"), np.uint8).reshape(height, width, 3)


def check_film(out: Path, fps: int = 30, speed: float = 20.0, size: tuple[int, int] = (1280, 720)) -> None:
    """Raise InputError if `write_film` would refuse these options: to be known before a long run."""
    suffix = out.suffix.lower()
    if suffix not in FASTEST:
        raise InputError(f"{out}: films end in .mp4 or .gif, not in {out.suffix or 'nothing'!r}")
    there = next(folder for folder in out.absolute().parents if folder.exists())
    if not there.is_dir():
        raise InputError(f"{out}: {there} is not a folder; expected a place for a file")
    if out.is_dir():
        raise InputError(f"{out}: this is a folder; expected the name of a file")
    if not 1 <= fps <= FASTEST[suffix]:
        raise InputError(f"--fps {fps}: expected 1 to {FASTEST[suffix]} frames per second for {suffix}")
    if not (math.isfinite(speed) and speed > 0.0):
        raise InputError(f"--speed {speed:g}: expected more than 0 simulated seconds per second of film")
    _check_size(size)
    if suffix == ".mp4" and (size[0] % 2 or size[1] % 2):
        even = f"{size[0] + size[0] % 2}x{size[1] + size[1] % 2}"
        raise InputError(f"--size {size[0]}x{size[1]}: H.264 wants even numbers; expected for instance {even}")


def _check_size(size: tuple[int, int]) -> None:
    if not all(least <= side <= most for least, side, most in zip(SMALLEST, size, LARGEST, strict=True)):
        raise InputError(
            f"--size {size[0]}x{size[1]}: expected {SMALLEST[0]}x{SMALLEST[1]} to {LARGEST[0]}x{LARGEST[1]} pixels"
        )


@contextmanager
def _whole(out: Path) -> Iterator[Path]:
    """A file in a folder of its own beside `out`, which becomes `out` at the end and vanishes upon any exception."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        folder = tempfile.TemporaryDirectory(prefix=f".{out.name}.", dir=out.parent, ignore_cleanup_errors=True)
    except OSError as problem:
        raise InputError(f"{out}: cannot be written ({problem.strerror})") from problem
    with folder as name:
        part = Path(name) / out.name
        yield part
        part.replace(out)

"""Films and stills of a recorded run: H.264 or an animated GIF, encoded frame by frame."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any, Final

import av
import numpy as np
import pygame
from av.container import OutputContainer
from av.video.reformatter import ColorRange, Colorspace
from av.video.stream import VideoStream
from numpy.typing import NDArray
from PIL import Image

from swarmsim.core.errors import InputError
from swarmsim.recording import Recording
from swarmsim.view.canvas import Canvas
from swarmsim.view.scene import Scene

HOLD = 2.0  # s of film, how long the end stays
SMALLEST = (480, 270)  # pixels, below which nothing can be read
LARGEST = (7680, 4320)  # pixels
FASTEST = {".mp4": 120, ".gif": 50}  # frames per second; players slow faster GIFs down
CONTAINER: Final = {".mp4": {"movflags": "+faststart"}, ".gif": {"loop": "0"}}  # index at the front; endless
QUALITY = "19"  # x264's constant rate factor: no loss that the eye sees
THREADS = 4  # fixed, because x264's bytes depend on it
SAMPLES = 5  # frames whose colours make a GIF's palette
COMMON = 96  # colours of theirs that a GIF keeps exactly

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
    moments = _moments(recording, fps, speed)
    convert: Callable[[Pixels], av.VideoFrame] = _yuv
    suffix = out.suffix.lower()
    if suffix == ".gif":
        samples = np.linspace(0.0, recording.iterations, SAMPLES).tolist()
        convert = Palette([_pixels(canvas.draw(moment)) for moment in samples]).picture
    with _whole(out) as part, av.open(str(part), "w", format=suffix[1:], options=CONTAINER[suffix]) as file:
        stream = (_gif if suffix == ".gif" else _h264)(file, fps, size)
        shown = -1.0
        for done, moment in enumerate(moments):
            if moment != shown:
                shown, picture = moment, convert(_pixels(canvas.draw(moment)))
            picture.pts, picture.time_base = done, Fraction(1, fps)
            file.mux(stream.encode(picture))
            if progress is not None:
                progress(done + 1, len(moments))
        file.mux(stream.encode(None))


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
    if not out.parent.is_dir():
        raise InputError(f"{out}: there is no folder {out.parent}; expected one that exists")
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
    """A name beside `out` to write to, which becomes `out` at the end and vanishes upon any exception."""
    part = out.with_name(f".{out.name}.{os.getpid()}.part")
    try:
        try:
            part.touch()
        except OSError as problem:
            raise InputError(f"{out}: cannot be written ({problem.strerror})") from problem
        yield part
        part.replace(out)
    finally:
        part.unlink(missing_ok=True)


def _h264(file: OutputContainer, fps: int, size: tuple[int, int]) -> VideoStream:
    """H.264 as every player knows it: yuv420p, Rec. 709."""
    stream = file.add_stream("libx264", rate=fps, options={"crf": QUALITY, "preset": "veryfast"})
    stream.width, stream.height = size
    stream.pix_fmt = "yuv420p"
    context = stream.codec_context
    context.thread_count = THREADS
    context.color_range, context.colorspace = ColorRange.MPEG, Colorspace.ITU709
    context.color_primaries = context.color_trc = 1  # Rec. 709
    return stream


def _yuv(pixels: Pixels) -> av.VideoFrame:
    return av.VideoFrame.from_ndarray(pixels, "rgb24").reformat(
        format="yuv420p", dst_colorspace=Colorspace.ITU709, dst_color_range=ColorRange.MPEG
    )


def _gif(file: OutputContainer, fps: int, size: tuple[int, int]) -> VideoStream:
    """GIF, in which a frame holds only what changed since the one before."""
    stream = file.add_stream("gif", rate=fps)
    stream.width, stream.height = size
    stream.pix_fmt = "pal8"
    return stream


class Palette:
    """The 255 colours of a GIF, and which of them stands for any other; nothing is dithered."""

    def __init__(self, samples: list[Pixels]) -> None:
        """The most frequent colours of the samples stay as they are; the rest share what is left."""
        pixels = np.concatenate([sample.reshape(-1, 3) for sample in samples]).astype(np.int64)
        colours, counts = np.unique(pixels @ (1 << 16, 1 << 8, 1), return_counts=True)
        common = colours[np.argsort(-counts, kind="stable")[:COMMON]]
        exact = np.stack([common >> 16, common >> 8 & 255, common & 255], axis=1)
        sheet = Image.fromarray(np.vstack(samples)).quantize(255 - COMMON, dither=Image.Dither.NONE)
        others = np.array(sheet.getpalette("RGB")).reshape(-1, 3)[: 255 - COMMON]
        chosen = np.concatenate([exact, others])
        self._colours = np.zeros((256, 4), np.uint8)  # alpha, red, green, blue; the last is clear, for what stays
        self._colours[: len(chosen)] = np.insert(chosen, 0, 255, axis=1)
        levels = np.arange(32) * 8 + 4  # of a channel cut to five bits
        wanted = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 1, 3)
        self._nearest = ((wanted - chosen) ** 2).sum(axis=-1).argmin(axis=1).astype(np.uint8)
        # A frequent colour is met exactly; among those that five bits cannot tell apart, the commonest.
        self._nearest[_five_bits(exact[::-1])] = np.arange(len(exact))[::-1]

    def picture(self, pixels: Pixels) -> av.VideoFrame:
        """A frame of indices into the palette."""
        indices = self._nearest[_five_bits(pixels)]
        # PyAV's hints forget that pal8 takes a pair.
        return av.VideoFrame.from_ndarray((indices, self._colours), "pal8")  # type: ignore[arg-type]


def _five_bits(colours: NDArray[np.integer[Any]]) -> NDArray[np.uint16]:
    """Colours (..., 3) as one number (...) each, of five bits a channel, red first."""
    red, green, blue = np.moveaxis((colours >> 3).astype(np.uint16), -1, 0)
    packed: NDArray[np.uint16] = red << 10 | green << 5 | blue
    return packed

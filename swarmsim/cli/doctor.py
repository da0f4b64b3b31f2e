"""The verb that looks whether everything works here, and says what to do where it does not."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import typer

from swarmsim.cli.progress import compiling, progress_bar

BROKEN = 1  # exit code

Check = tuple[str, Callable[[], str]]


def doctor() -> None:
    """Check the installation: versions, simulation, film, letters, compiled code, folders, display.

    Exit code 0: all that is needed works; 1: something does not, and what to do is told.

    Example: swarmsim doctor
    """
    from swarmsim.cli.tables import print_table

    rows, broken = [], False
    with progress_bar(quiet=False) as progress, compiling(progress):
        for name, check in CHECKS:
            try:
                rows.append((name, "works", check()))
            except Exception as problem:  # whatever it is, it is to be told
                optional = name in OPTIONAL
                broken |= not optional
                rows.append((name, "no" if optional else "BROKEN", f"{problem}; {ADVICE[name]}"))
    print_table("swarmsim doctor", ("what", "state", "found, or what to do"), rows)
    raise typer.Exit(BROKEN if broken else 0)


def _python() -> str:
    return f"Python {sys.version.split()[0]}, {os.cpu_count()} cores"


def _versions() -> str:
    from swarmsim.recording.digests import versions

    return ", ".join(f"{name} {version}" for name, version in versions().items() if name not in ("python", "platform"))


def _simulation() -> str:
    from swarmsim.core.scenario import shipped
    from swarmsim.core.scenario.file import load
    from swarmsim.engine.build import build

    path = shipped.example("room")
    simulation = build(load(path, ["stop.iterations=20"]), str(path)).simulation
    simulation.run()
    return f"3 robots, {simulation.state.iteration} iterations"


def _film() -> str:
    import tempfile

    import imageio_ffmpeg

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        film = imageio_ffmpeg.write_frames(str(path), (64, 64), codec="libx264", ffmpeg_log_level="error")
        film.send(None)
        for _ in range(3):
            film.send(bytes(64 * 64 * 3))
        film.close()
        if path.stat().st_size < 500:
            raise RuntimeError("the encoder wrote nothing")
    return f"H.264 by ffmpeg {imageio_ffmpeg.get_ffmpeg_version()}"


def _letters() -> str:
    from swarmsim.view.lettering import FONT, Lettering

    width = Lettering().render("swarmsim", 24, (255, 255, 255)).get_width()
    if width < 20:
        raise RuntimeError("letters have no width")
    return FONT.stem


def _compiled() -> str:
    from swarmsim.kernels import occupancy
    from swarmsim.kernels.compiling import makeshift

    folder = Path(occupancy.recount.stats.cache_path)
    folder.mkdir(parents=True, exist_ok=True)
    if not os.access(folder, os.W_OK):
        raise RuntimeError(f"{folder} cannot be written")
    lasting = "" if makeshift() is None else ", which is temporary: NUMBA_CACHE_DIR names a lasting one"
    return f"{len(list(folder.glob('*.nbi')))} compiled kernels are kept in {folder}{lasting}"


def _folder() -> str:
    if not os.access(Path.cwd(), os.W_OK):
        raise RuntimeError(f"{Path.cwd()} cannot be written")
    return f"runs go to {Path('runs').absolute()}"


def _display() -> str:
    from swarmsim.view.window import driver

    return driver()


CHECKS: tuple[Check, ...] = (
    ("python", _python), ("versions", _versions), ("simulation", _simulation), ("film", _film), ("letters", _letters),
    ("compiled code", _compiled), ("folder", _folder), ("display", _display),
)  # fmt: skip
OPTIONAL = ("display",)
ADVICE = {
    "python": "install Python again",
    "versions": "install again with: pip install --force-reinstall swarmsim-lab",
    "simulation": "install again with: pip install --force-reinstall swarmsim-lab",
    "film": "install an encoder with: pip install --force-reinstall imageio-ffmpeg",
    "letters": "install pygame again with: pip install --force-reinstall pygame-ce",
    "compiled code": "every run compiles anew; name a folder that can be written in NUMBA_CACHE_DIR",
    "folder": "go to a folder of your own, or name one with --out",
    "display": "only swarmsim view needs one; films and pages do not",
}

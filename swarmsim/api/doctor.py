"""Checks whether everything works here, and tells how to fix it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

ROBOT: Final = "swarmsim-robot"  # the distribution of the robot's half, which is in this one


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check."""

    what: str
    works: bool
    needed: bool  # by most commands
    found: str  # or the problem and its fix


def doctor() -> list[Finding]:
    """Check versions, name, simulation, film, letters, compiled code, folders and display: `swarmsim doctor`.

    Returns one finding for each, whatever goes wrong.
    """
    return [_finding(what, check) for what, check in CHECKS.items()]


def _finding(what: str, check: Callable[[], str]) -> Finding:
    needed = what not in OPTIONAL
    try:
        return Finding(what, True, needed, check())
    except Exception as problem:  # any problem is reported
        return Finding(what, False, needed, f"{problem}; {ADVICE[what]}")


def _python() -> str:
    return f"Python {sys.version.split()[0]}, {os.cpu_count()} cores"


def _versions() -> str:
    from importlib.metadata import distributions

    from swarmsim.recording.digests import versions

    if any(one.name == ROBOT for one in distributions()):
        raise RuntimeError(f"{ROBOT} is installed too, whose files are in the place of this package's")
    return ", ".join(f"{name} {version}" for name, version in versions().items() if name not in ("python", "platform"))


def _name() -> str:
    from importlib import metadata

    try:
        version = metadata.version(OTHER)
    except metadata.PackageNotFoundError:
        return "swarmsim-lab, alone"
    raise RuntimeError(f"the package {OTHER} {version} is another simulator, whose files take the same places")


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


CHECKS: Final[dict[str, Callable[[], str]]] = {
    "python": _python, "versions": _versions, "name": _name, "simulation": _simulation, "film": _film,
    "letters": _letters, "compiled code": _compiled, "folder": _folder, "display": _display,
}  # fmt: skip
OTHER: Final = "swarmsim"  # a distribution of this name has nothing to do with this one, `swarmsim-lab`
AGAIN: Final = "install swarmsim again, from its wheel or checkout"
OPTIONAL: Final = ("display",)
ADVICE: Final = {
    "python": "install Python again",
    "versions": f"pip uninstall {ROBOT}, and {AGAIN}",
    "name": f"remove both with: pip uninstall {OTHER} swarmsim-lab; then {AGAIN}",
    "simulation": AGAIN,
    "film": "install an encoder with: pip install --force-reinstall imageio-ffmpeg",
    "letters": "install pygame again with: pip install --force-reinstall pygame-ce",
    "compiled code": "every run compiles anew; name a folder that can be written in NUMBA_CACHE_DIR",
    "folder": "change to your own folder, or name one with --out",
    "display": "only swarmsim view needs one; films and pages do not",
}

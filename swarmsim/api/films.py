"""Films of recorded runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import minds_of
from swarmsim.engine.build import build
from swarmsim.recording.reader import Recording
from swarmsim.view.frames_film import Gathering
from swarmsim.view.scene import Scene
from swarmsim.view.style import Style
from swarmsim.view.video import Film, check_film, write_film, write_pictures


def filmed(
    recording: Recording,
    name: str,
    out: Path,
    film: Film,
    beside: Recording | None,
    frames: bool,
    progress: Callable[[int, int], None],
) -> Path:
    """Write a film, or one of how robots find each other's frames of reference, and return its path.

    `name` is the run's in messages. Raises InputError.
    """
    check_film(out, film)
    if frames:
        if beside is not None or film.look != Style(film.look.theme):
            raise InputError("--frames: such films have their own look; expected --fps, --speed, --size or --theme")
        _of_frames(recording, name, out, film, progress)
    else:
        write_film(recording, out, film, beside, progress)
    return out


def _of_frames(recording: Recording, name: str, out: Path, film: Film, progress: Callable[[int, int], None]) -> None:
    minds = minds_of(recording.scenario)
    if len(minds) > 1 or not minds[0].mind.computation.declares("merges", False):
        raise InputError(
            f"--frames: the robots of {name} have one frame of reference; expected mind.computation.sharing.use = merge"
        )
    made = build(recording.scenario, name, recording.world)
    gathering = Gathering(Scene(recording), made.context.start, film)

    def tick() -> bool:
        if not made.simulation.over:
            made.simulation.tick([gathering])
        return not made.simulation.over

    write_pictures(out, film, lambda taken: gathering.pictures(tick, progress, taken))

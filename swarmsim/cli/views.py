"""The verb that opens a window."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Annotated

import typer

from swarmsim.cli.options import AllowCode, Faults, Overrides, Seed


def view(
    what: Annotated[Path, typer.Argument(metavar="SCENARIO.toml|RUN", help="A scenario to run, or a recorded run.")],
    seed: Seed = None,
    set_: Overrides = None,
    faults: Faults = None,
    out: Annotated[Path | None, typer.Option(help="Folder for the recording; it must not exist yet.")] = None,
    theme: Annotated[str, typer.Option(help="Colours: dark or light.")] = "dark",
    speed: Annotated[int, typer.Option(help="Iterations a second at the start.", min=1)] = 20,
    allow_code: AllowCode = False,
) -> None:
    """Open a window on a run: watch it, go back in time, kill, blind, mute or push robots, close doors.

    Your actions are recorded as faults of the scenario, so that `swarmsim verify` repeats them. Press h for the keys.

    Example: swarmsim view basilica

    A recorded run: swarmsim view runs/basilica-1
    """
    from swarmsim.api.runs import new_folder, scenario_of, summarise
    from swarmsim.core.errors import InputError
    from swarmsim.core.scenario import shipped
    from swarmsim.live.session import Replay, Session
    from swarmsim.recording.reader import Recording
    from swarmsim.view.style import Style
    from swarmsim.view.window import Window

    look, what = Style(theme), shipped.found(what)
    if what.suffix != ".toml":
        recording = Recording(what)
        Window(Replay(recording), recording.path.parent, look=look, speed=speed).run()
        return
    scenario = scenario_of(what, seed, set_, faults or ())
    folder = new_folder(out, what.stem)
    try:
        session = Session(scenario, str(what), folder)
        window = Window(session, folder, look=look, speed=speed)
    except InputError:
        shutil.rmtree(folder)
        raise
    try:
        window.run()
    finally:
        session.close()
    print(f"{folder}: {summarise(folder).iterations} iterations; repeat them with: swarmsim verify {folder}")

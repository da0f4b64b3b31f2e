"""One scenario tried: it is read or refused in a sentence, and runs, twice alike, as oracles want it."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

from conftest import called
from generated.mutants import Mutant
from generated.oracles import Witness
from generated.scenarios import Scenario, scenario

from swarmsim.api.verification import verified
from swarmsim.core.errors import InputError, PartError
from swarmsim.core.scenario import registry
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import BuiltRun, build
from swarmsim.recording.reader import Recording

FINISHED, NOT_FINISHED, REFUSED = "finished", "not finished", "refused"
TYPED = 10  # every so many scenarios, the command line runs and verifies one too
WHILE = 3  # iterations of a scenario that was damaged and can be read all the same


def tried(scenario: Scenario, folder: Path) -> str:
    """How a scenario ends; raises whatever is wrong with that, with a note by which anybody sees it again."""
    return _noted(lambda: _tried(scenario, folder), str(scenario))


def tried_all(numbers: Sequence[int], folder: Path) -> Counter[str]:
    """How the scenarios of these numbers end; at most one in ten may be refused."""
    ends: Counter[str] = Counter()
    for number in numbers:
        place = folder / str(number)
        place.mkdir()
        ends[tried(scenario(number), place)] += 1
        shutil.rmtree(place)
    assert ends[REFUSED] <= 0.1 * len(numbers), ends
    return ends


def survives(mutant: Mutant, scenario: Scenario, folder: Path) -> str:
    """The sentence in which a damaged scenario is refused, or nothing if it can be read and runs."""
    return _noted(lambda: _survives(mutant, scenario, folder), f"{scenario}\n\n{mutant.what}:\n\n{mutant.text}")


def _noted(work: Callable[[], str], note: str) -> str:
    try:
        return work()
    except Exception as problem:
        problem.add_note(note)
        raise


def _tried(scenario: Scenario, folder: Path) -> str:
    path = scenario.written(folder)
    try:
        run = build(load(path), str(path))
    except InputError as refused:
        _is_one_sentence(refused, path)
        return REFUSED
    witness = Witness(scenario, run)
    first = folder / "first"
    first.mkdir()
    try:
        with run.recorder(first / "recording.h5") as recorder:
            finished = run.simulate([witness, recorder])
    except (InputError, PartError) as stopped:
        _is_one_sentence(stopped, path)
        return REFUSED
    recording = Recording(first)
    _is_told(run, witness, recording)
    again = verified(recording, str(first), lambda done, all_: None)
    assert again.equal, again.difference
    if scenario.number % TYPED == 0:
        typed = called("run", path, "--out", folder / "typed", "--quiet")
        assert typed.returncode == (0 if finished else 1), typed.stderr
        assert Recording(folder / "typed").digest() == recording.digest()
        typed = called("verify", first)
        assert typed.returncode == 0, typed.stdout + typed.stderr
    return FINISHED if finished else NOT_FINISHED


def _is_told(run: BuiltRun, witness: Witness, recording: Recording) -> None:
    """The summary tells what happened."""
    told, total = recording.summary(), witness.ledger.total
    assert told["status"] == (FINISHED if run.simulation.finished else NOT_FINISHED)
    assert told["iterations"] == run.simulation.state.iteration
    assert told["messages"] == total["heard"]
    assert told["bytes"] == total["bytes"]
    assert sum(told["lost"].values()) == total["lost"]


def _survives(mutant: Mutant, scenario: Scenario, folder: Path) -> str:
    path = scenario.written(folder)
    path.write_text(mutant.text)
    try:
        simulation = build(load(path), str(path)).simulation
        while not simulation.over and simulation.state.iteration < WHILE:
            simulation.tick()
    except (InputError, PartError) as refused:
        message = _is_one_sentence(refused, path)
        of_world = message.startswith((str(folder), *registry.known("generator")))  # names a place in the building
        named = mutant.key in message or (mutant.table and message.startswith(mutant.table)) or of_world
        assert named, f"{mutant.key!r} is not named: {message}"
        return message
    return ""


def _is_one_sentence(problem: Exception, path: Path) -> str:
    """What an error says of a file, in one line that begins with its name."""
    message = str(problem)
    assert message.startswith(f"{path}: "), f"the file is not named first: {message}"
    assert "\n" not in message, f"several lines: {message}"
    assert "Traceback" not in message
    return message.removeprefix(f"{path}: ")

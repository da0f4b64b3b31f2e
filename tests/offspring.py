"""Commands in forks of one process that has its imports and kernels: each runs as usual, but starts sooner."""

from __future__ import annotations

import json
import os
import resource
import runpy
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from threading import Thread
from types import TracebackType
from typing import BinaryIO

#: Imports of most commands, without libraries that start threads.
IMPORTED = ("swarmsim.cli", "swarmsim.engine.build", "swarmsim.view.video", "swarmsim.view.plots", "swarmsim.api.runs")


class Offspring:
    """Runs commands one by one: the command line's words, or a script and its arguments."""

    def __enter__(self) -> Offspring:
        self._parent = subprocess.Popen(
            [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, problem: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._parent.stdin.close()
        self._parent.wait()
        self._parent.stdout.close()

    def ended(
        self, words: Sequence[object], folder: Path, limit: int | None = None, out: Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        """The result of a command in a folder, with a limit on the bytes of its files, and the file it prints to."""
        self._parent.stdin.write(json.dumps([list(map(str, words)), str(folder), limit, out and str(out)]) + "\n")
        self._parent.stdin.flush()
        code, out, err = json.loads(self._parent.stdout.readline())
        return subprocess.CompletedProcess(words, code, out, err)


def _told(lines: BinaryIO, into: dict[str, str], name: str) -> None:
    with lines:
        into[name] = lines.read().decode(errors="replace")


def _become(words: list[str], folder: str, limit: int | None, out: int, err: int) -> None:
    """Run the command; this process ends with it."""
    nothing = os.open(os.devnull, os.O_RDONLY)
    for given, place in ((nothing, 0), (out, 1), (err, 2)):
        os.dup2(given, place)
        os.close(given)
    os.chdir(folder)
    if limit is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    if words[0].endswith(".py"):
        sys.argv = words
        runpy.run_path(words[0], run_name="__main__")
    else:
        from swarmsim.cli import main

        sys.argv = ["swarmsim", *words]
        main()


def _run_once() -> None:
    """Let numba load the kernels of most runs."""
    from swarmsim.core.scenario.file import load
    from swarmsim.engine.build import build

    room = Path(__file__).parents[1] / "scenarios" / "room.toml"
    build(load(room, ["stop.iterations=3"]), str(room)).simulation.run()


def _serve() -> None:
    for name in IMPORTED:
        __import__(name)
    _run_once()
    for line in sys.stdin:
        words, folder, limit, file = json.loads(line)
        (out, out_end), (err, err_end) = os.pipe(), os.pipe()
        child = os.fork()
        if child == 0:
            os.close(out)
            os.close(err)
            if file is not None:
                os.close(out_end)
                out_end = os.open(file, os.O_WRONLY)
            _become(words, folder, limit, out_end, err_end)
            return
        os.close(out_end)
        os.close(err_end)
        told: dict[str, str] = {}
        readers = [
            Thread(target=_told, args=(os.fdopen(end, "rb"), told, name)) for name, end in (("out", out), ("err", err))
        ]
        for reader in readers:
            reader.start()
        _, status = os.waitpid(child, 0)
        for reader in readers:
            reader.join()
        print(json.dumps([os.waitstatus_to_exitcode(status), told["out"], told["err"]]), flush=True)


if __name__ == "__main__":
    _serve()

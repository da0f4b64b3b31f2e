"""The processes of a fleet's robots on this machine: started, killed, paused, and never left behind."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, final

_GRACE: Final = 3.0  # s that processes have to end by themselves


@final
class Processes:
    """The robots' processes, by number."""

    def __init__(self, words: Sequence[str], log: Path | None = None) -> None:
        """`words` are those that all are started with besides their number; each logs into the folder `log`."""
        self._words, self._log = words, log
        self._running: dict[int, subprocess.Popen[bytes]] = {}
        self._ended: list[subprocess.Popen[bytes]] = []

    @property
    def pids(self) -> Mapping[int, int]:
        """The running ones, by robot."""
        return {robot: one.pid for robot, one in self._running.items()}

    def start(self, robots: Iterable[int], recalls: bool = False) -> None:
        """Start the robots' processes; one that `recalls` begins with what its log says that it knew."""
        for robot in robots:
            words = [sys.executable, "-m", "swarmsim.fleet.robot_process", *self._words, "--id", str(robot)]
            words += [] if self._log is None else ["--log", str(self._log / f"robot-{robot}.log")]
            words += ["--recall"] if recalls else []
            # A session of its own keeps Ctrl-C from it; it ends when this process, the other end of its input, does.
            self._running[robot] = subprocess.Popen(words, stdin=subprocess.PIPE, start_new_session=True)

    def kill(self, robots: Iterable[int]) -> None:
        """Kill them, as `kill -9` does."""
        for robot in robots:
            if (one := self._running.get(robot)) is not None:
                one.kill()
                one.wait()

    def pause(self, robots: Iterable[int], paused: bool = True) -> None:
        """Stop them where they are, or let them go on."""
        for robot in robots:
            if (one := self._running.get(robot)) is not None and one.poll() is None:
                one.send_signal(signal.SIGSTOP if paused else signal.SIGCONT)

    def is_gone(self, robot: int) -> bool:
        """Whether it does not run: not yet, or no more."""
        return robot not in self._running or self._running[robot].poll() is not None

    def is_paused(self, robot: int) -> bool:
        """Whether it is stopped where it is."""
        one = self._running.get(robot)
        try:
            text = "" if one is None else Path(f"/proc/{one.pid}/stat").read_text()
        except OSError:
            return False
        return text.rpartition(")")[2].split()[:1] == ["T"]

    def lost(self) -> str:
        """Who has ended, in words; empty for nobody."""
        for robot, one in self._running.items():
            if (code := one.poll()) is not None:
                how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
                return f"the process of robot {robot} has ended {how}"
        return ""

    def end(self) -> None:
        """Let all end; kill those that do not."""
        for robot, one in self._running.items():
            self.pause([robot], False)
            if one.stdin is not None:
                one.stdin.close()
        for one in self._running.values():
            try:
                one.wait(_GRACE)
            except subprocess.TimeoutExpired:
                one.kill()
                one.wait()

"""Where the memory of a robot's process goes, without a compiler: `python benchmarks/robot_memory.py`.

Each row is a process of its own, which goes one step further than the row before; sessions of zenoh meet on loopback.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

from swarmsim.core.charge import Charge
from swarmsim.core.scenario.file import load
from swarmsim.engine.build import build

STEPS = {
    "Python": "",
    "numpy and msgspec": "import numpy, msgspec",
    "the robot's half of the package": "import swarmsim.fleet.robot_process, swarmsim.fleet.lines",
    "its mind, after two iterations": (
        "from swarmsim.core.charge import Charge\nfrom swarmsim.core.robot import warm\n"
        "warm(Charge.open(Path(sys.argv[1])))"
    ),
    "zenoh imported": "import zenoh",
    "a link of zenoh's": "from swarmsim.fleet.opening import opened\nlink = opened('zenoh', sys.argv[2], 0)",
    "two channels": "channels = [link.channel(name) for name in ('robots/0', 'world/0')]",
    "10 000 frames said, and as many telegrams": (
        "[(link.say(bytes(21)), channels[0].say(bytes(400))) for _ in range(10_000)]; __import__('time').sleep(1.0)"
    ),
}
HEAD = """
import sys
sys.modules.update(dict.fromkeys(("numba", "scipy")))
from pathlib import Path
def told():
    lines = Path("/proc/self/status").read_text().splitlines()
    held = {one.split(":")[0]: one.split()[1] for one in lines if one.startswith(("VmRSS", "VmHWM", "Threads"))}
    print(held["VmRSS"], held["VmHWM"], held["Threads"], flush=True)
"""


def main() -> None:
    """Print a table."""
    made = build(load("scenarios/basilica.toml"), "scenarios/basilica.toml")
    charge, place = Path(tempfile.mkdtemp()) / "0.charge", f"127.0.0.1:{20_000 + os.getpid() % 10_000}"
    charge.write_bytes(Charge.of(0, made.scenario, made.context).packed())
    listening = HEAD + "from swarmsim.fleet.opening import opened\nlink = opened('zenoh', sys.argv[1], -1)\ntold()\n"
    listening += "link.channel('robots/0')\nwhile link.wait(60.0):\n    link.heard()\n"
    world = subprocess.Popen([sys.executable, "-c", listening, place], stdout=subprocess.PIPE, text=True)
    assert world.stdout is not None
    world.stdout.readline()
    sys.stdout.write("after | MB | at its peak | threads\n")
    done = HEAD
    for name, step in STEPS.items():
        done += f"{step}\n"
        words = [sys.executable, "-c", f"{done}told()\nimport os\nos._exit(0)  # links are open", charge, place]
        now, peak, threads = subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()
        sys.stdout.write(f"{name} | {int(now) / 1024:.1f} | {int(peak) / 1024:.1f} | {threads}\n")
    world.kill()
    world.communicate()


if __name__ == "__main__":
    main()

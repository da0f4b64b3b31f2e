"""W(N) in IR-SIM: kinematic discs, its laser scanners, its contacts. Prints robot-steps per second of CPU time."""

import sys
import tempfile
import time
from pathlib import Path

import irsim
import numpy as np
import yaml

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[1])]
import workload as w
from avoidance import twists

robots, steps, mode = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
side, squares = w.pillars(robots)
grid = int(np.ceil(np.sqrt(robots)))
random = np.random.default_rng(1)
free = [
    (x, y)
    for x, y in random.uniform(0.1, side - 0.1, (100 * robots, 2)).tolist()
    if not any(a - 0.1 < x < c + 0.1 and b - 0.1 < y < d + 0.1 for a, b, c, d in squares)
]
taken: list[tuple[float, float]] = []
for place in free:
    if len(taken) < robots and all((place[0] - x) ** 2 + (place[1] - y) ** 2 > 0.0144 for x, y in taken):
        taken.append(place)
scanner = {"type": "lidar2d", "range_min": 0.0, "range_max": w.REACH, "angle_range": 2 * np.pi, "number": w.BEAMS}
robot = [
    {
        "kinematics": {"name": "diff"}, "shape": {"name": "circle", "radius": w.RADIUS},
        "state": [x, y, float(random.uniform(-np.pi, np.pi))], "goal": [1e6, 1e6, 0.0], "vel_max": [w.SPEED, 40.0],
        "sensors": [scanner],
    }
    for x, y in taken
]  # fmt: skip
obstacle = [
    {
        "shape": {"name": "rectangle", "length": c - a, "width": d - b},
        "state": [(a + c) / 2, (b + d) / 2, 0.0],
    }
    for a, b, c, d in squares
]
corners = [[0.0, 0.0], [side, 0.0], [side, side], [0.0, side], [0.0, 0.0]]
obstacle.append({"shape": {"name": "linestring", "vertices": corners}, "state": [0.0, 0.0, 0.0]})
world = {"height": side, "width": side, "step_time": w.PERIOD, "sample_time": w.PERIOD, "collision_mode": mode}
with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
    yaml.safe_dump({"world": world, "robot": robot, "obstacle": obstacle}, file)
    file.flush()
    env = irsim.make(file.name, display=False, log_level="ERROR")
assert len(env.robot_list) == robots
scan = env.get_lidar_scan(0)
bearings = np.linspace(scan["angle_min"], scan["angle_max"], w.BEAMS)


def tick() -> None:
    ranges = np.array([env.get_lidar_scan(i)["ranges"] for i in range(robots)])
    env.step(list(twists(bearings, ranges, 0.2, w.SPEED * 2 / 3, w.PERIOD)[:, :, None]))


tick()
begin = np.array([one.state[:2, 0] for one in env.robot_list])
begun = time.process_time()
for _ in range(steps):
    tick()
seconds = time.process_time() - begun
moved = np.hypot(*(np.array([one.state[:2, 0] for one in env.robot_list]) - begin).T)
assert moved.mean() > 0.2 * steps * w.PERIOD * w.SPEED * 2 / 3, moved.mean()
print(robots * steps / seconds)

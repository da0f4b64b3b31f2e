"""W(N) in VMAS: forces between discs and boxes, its lidars; many arenas at once. Prints robot-steps per CPU second."""

import math
import sys
import time
from pathlib import Path

import torch
from vmas import make_env
from vmas.simulator.core import Agent, Box, Landmark, Line, Sphere, World
from vmas.simulator.dynamics.diff_drive import DiffDrive
from vmas.simulator.scenario import BaseScenario
from vmas.simulator.sensors import Lidar

sys.path.insert(0, str(Path(__file__).parents[1]))
import workload as w

torch.set_num_threads(1)
torch.manual_seed(1)
robots, steps, arenas = (int(word) for word in sys.argv[1:4])
side, squares = w.pillars(robots)


class Arena(BaseScenario):
    def make_world(self, batch_dim, device, **kwargs):
        world = World(batch_dim, device, dt=w.PERIOD, substeps=2)
        for i in range(robots):
            scanner = Lidar(world, n_rays=w.BEAMS, max_range=w.REACH)
            world.add_agent(
                Agent(
                    name=f"robot {i}", shape=Sphere(w.RADIUS), sensors=[scanner], dynamics=DiffDrive(world),
                    u_range=[w.SPEED, 40.0], mass=0.25,
                )
            )  # fmt: skip
        for i, (left, low, right, high) in enumerate(squares):
            world.add_landmark(Landmark(f"pillar {i}", shape=Box(right - left, high - low), collide=True))
        for i in range(4):
            world.add_landmark(Landmark(f"wall {i}", shape=Line(side), collide=True))
        return world

    def reset_world_at(self, env_index=None):
        count = self.world.batch_dim
        places = torch.rand(count, robots, 2) * (side - 0.2) + 0.1
        for i, agent in enumerate(self.world.agents):
            agent.set_pos(places[:, i], batch_index=env_index)
            agent.set_rot(torch.rand(count, 1) * 2 * math.pi, batch_index=env_index)
        for landmark, (left, low, right, high) in zip(self.world.landmarks, squares, strict=False):
            landmark.set_pos(torch.tensor([(left + right) / 2, (low + high) / 2]), batch_index=env_index)
        middles = [
            (side / 2, 0.0, 0.0),
            (side / 2, side, 0.0),
            (0.0, side / 2, math.pi / 2),
            (side, side / 2, math.pi / 2),
        ]
        for wall, (x, y, turn) in zip(self.world.landmarks[len(squares) :], middles, strict=True):
            wall.set_pos(torch.tensor([x, y]), batch_index=env_index)
            wall.set_rot(torch.tensor([turn]), batch_index=env_index)

    def observation(self, agent):
        return agent.sensors[0].measure()

    def reward(self, agent):
        return torch.zeros(self.world.batch_dim)


env = make_env(Arena(), num_envs=arenas, device="cpu", continuous_actions=True)
bearings = torch.arange(w.BEAMS) * (2 * math.pi / w.BEAMS)
seen = env.reset()


def twist(ranges):
    push = torch.where(ranges < 0.2, 0.2 / ranges.clamp(min=1e-3) - 1.0, 0.0) * 4.0 / w.BEAMS
    turn = torch.atan2(-(push @ torch.sin(bearings)), 1.0 - push @ torch.cos(bearings))
    return torch.stack([w.SPEED * 2 / 3 * torch.cos(turn).clamp(min=0.0), turn / w.PERIOD], dim=1)


begin = torch.stack([agent.state.pos for agent in env.agents])
begun = time.process_time()
for _ in range(steps):
    seen = env.step([twist(ranges) for ranges in seen])[0]
seconds = time.process_time() - begun
moved = (torch.stack([agent.state.pos for agent in env.agents]) - begin).norm(dim=-1).mean().item()
assert moved > 0.2 * steps * w.PERIOD * w.SPEED * 2 / 3, moved
print(arenas * robots * steps / seconds)

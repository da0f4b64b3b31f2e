"""W(N) as a first attempt: pymunk's attributes robot by robot, and a query of the space for every beam."""

from __future__ import annotations

import math
import time

import numpy as np
import pymunk
import workload as w

SUBSTEPS = 2
CLEARANCE, MASS = 0.2, 0.25  # m, kg


class Swarm:
    """Robots that wander among the pillars."""

    def __init__(self, robots: int) -> None:
        self.space = pymunk.Space()
        for x1, y1, x2, y2 in w.segments(robots).tolist():
            self.space.add(pymunk.Segment(self.space.static_body, (x1, y1), (x2, y2), 0.0))
        side, _ = w.pillars(robots)
        random = np.random.default_rng(1)
        self.bodies: list[pymunk.Body] = []
        self.own: list[pymunk.ShapeFilter] = []
        while len(self.bodies) < robots:
            place = tuple(random.uniform(w.RADIUS, side - w.RADIUS, 2).tolist())
            if self.space.point_query(place, 1.1 * w.RADIUS, pymunk.ShapeFilter()):
                continue
            body = pymunk.Body(MASS, pymunk.moment_for_circle(MASS, 0.0, w.RADIUS))
            body.position, body.angle = place, float(random.uniform(-math.pi, math.pi))
            disc = pymunk.Circle(body, w.RADIUS)
            disc.filter = pymunk.ShapeFilter(group=len(self.bodies) + 1)
            self.space.add(body, disc)
            self.bodies.append(body)
            self.own.append(disc.filter)

    def step(self) -> None:
        """All robots sense, then all move for a period."""
        wanted = []
        for body, own in zip(self.bodies, self.own, strict=True):
            ahead, aside = 1.0, 0.0
            for beam in range(w.BEAMS):
                bearing = 2.0 * math.pi * beam / w.BEAMS
                along = body.angle + bearing
                end = body.position + pymunk.Vec2d(w.REACH * math.cos(along), w.REACH * math.sin(along))
                met = self.space.segment_query_first(body.position, end, 0.0, own)
                if met is not None and met.alpha * w.REACH < CLEARANCE:
                    push = 4.0 / w.BEAMS * (CLEARANCE / max(met.alpha * w.REACH, 1e-3) - 1.0)
                    ahead -= push * math.cos(bearing)
                    aside -= push * math.sin(bearing)
            wanted.append(math.atan2(aside, ahead))
        for _ in range(SUBSTEPS):
            for body, turn in zip(self.bodies, wanted, strict=True):
                pace = w.SPEED * 2.0 / 3.0 * max(math.cos(turn), 0.0)
                force = (pymunk.Vec2d(pace, 0.0).rotated(body.angle) - body.velocity) * (MASS / w.PERIOD)
                body.apply_force_at_world_point(force, body.position)
                body.torque = body.moment * (turn / w.PERIOD - body.angular_velocity) / w.PERIOD
            self.space.step(w.PERIOD / SUBSTEPS)


def rate(robots: int, steps: int) -> float:
    """Robot-steps per second of CPU time. Raises AssertionError if the robots hardly move."""
    swarm = Swarm(robots)
    begin = [body.position for body in swarm.bodies]
    begun = time.process_time()
    for _ in range(steps):
        swarm.step()
    seconds = time.process_time() - begun
    way = float(np.mean([(body.position - place).length for body, place in zip(swarm.bodies, begin, strict=True)]))
    assert way > 0.002 * min(steps, 10), way  # m
    return robots * steps / seconds

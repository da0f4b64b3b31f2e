"""Differential-drive discs against closed forms, a finer integration, geometry and pymunk's own attributes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import building, made
from numpy.testing import assert_array_equal
from scipy.integrate import cumulative_trapezoid
from scipy.spatial import cKDTree

from swarmsim.core.errors import InputError
from swarmsim.core.scenario.file import load
from swarmsim.core.scenario.robots import Robots
from swarmsim.engine.build import build
from swarmsim.kernels import drive
from swarmsim.robots.bodies import Pymunk, RigidDiscs
from swarmsim.robots.motion import WaypointFollower

OPEN = np.empty((0, 4))
RADIUS, BASE, SPEED, ACCELERATION = 0.055, 0.10, 0.15, 1.0
SUBSTEP, FRICTION = Pymunk().substep, Pymunk().friction


def robots(count=1, **changes):
    return Robots(count=count, spawn="anywhere", **changes)


def bodies(pose, walls=OPEN, substep=SUBSTEP, friction=FRICTION, **changes):
    pose = np.array(pose, float).reshape(-1, 3)
    physics = Pymunk(substep=substep, friction=friction)
    return RigidDiscs(robots(len(pose), **changes), physics, building(walls), pose)


class Steady:
    """The same wheel speeds for ever."""

    def __init__(self, *wanted):
        self.wanted = np.array(wanted, float).reshape(-1, 2)

    def command(self, pose):
        return self.wanted


class Script(Steady):
    """Other wheel speeds every half second, whatever the sub-step."""

    def __init__(self, wheel_speeds, substep):
        super().__init__(wheel_speeds[0])
        self.wheel_speeds = wheel_speeds  # (steps, n, 2)
        self.substep, self.asked = substep, 0

    def command(self, pose):
        now = self.asked * self.substep
        self.asked += 1
        return self.wheel_speeds[int((now + 1e-9) / 0.5)]


class Spy(Steady):
    """Passes commands on and looks at the poses at every sub-step."""

    def __init__(self, wanted, look):
        super().__init__(*wanted)
        self.look = look

    def command(self, pose):
        self.look(pose)
        return self.wanted


def rectangle(x1, y1, x2, y2):
    """A pillar: its four sides with the solid side on the left."""
    return [[x1, y1, x2, y1], [x2, y1, x2, y2], [x2, y2, x1, y2], [x1, y2, x1, y1]]


def room(width, height):
    """The sides of a pillar turned inside out."""
    return [[x2, y2, x1, y1] for x1, y1, x2, y2 in rectangle(0.0, 0.0, width, height)]


def column(x, y, radius, sides=24):
    turns = np.arange(sides) * (2.0 * np.pi / sides)
    corners = np.column_stack([x + radius * np.cos(turns), y + radius * np.sin(turns)])
    return np.hstack([corners, np.roll(corners, -1, axis=0)]).tolist()


def distance_to_walls(points, walls):
    """(n, s): how far each point is from each segment."""
    start, along = walls[:, :2], walls[:, 2:] - walls[:, :2]
    offset = points[:, None] - start
    share = np.clip((offset * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along, axis=-1)


# --- in the open ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wheels", [(0.15, 0.15), (0.15, 0.05), (0.02, 0.12), (-0.1, -0.1), (-0.05, -0.15), (0.1, -0.1)]
)
def test_ten_seconds_from_standstill_match_the_closed_form(wheels):
    """Each rim speed climbs at the motor's limit and then stays; speed and turn rate are their mean and difference."""
    drive = bodies([1.0, 2.0, 0.7])
    state = drive.state()
    time = np.linspace(0.0, 10.0, 100_001)
    left, right = (np.sign(wanted) * np.minimum(ACCELERATION * time, abs(wanted)) for wanted in wheels)
    yaw = 0.7 + cumulative_trapezoid((right - left) / BASE, time, initial=0.0)
    speed = (left + right) / 2.0
    x = 1.0 + cumulative_trapezoid(speed * np.cos(yaw), time, initial=0.0)
    y = 2.0 + cumulative_trapezoid(speed * np.sin(yaw), time, initial=0.0)
    way = cumulative_trapezoid((np.abs(left) + np.abs(right)) / 2.0, time)[-1]
    motion = Steady(wheels)
    for second in range(1, 11):
        state = drive.drive(motion, 1.0)
        now = second * 10_000
        assert math.dist(state.pose[0, :2], (x[now], y[now])) < 0.01 * way
        assert abs(state.pose[0, 2] - yaw[now]) < 0.01 * max(abs(yaw[-1] - 0.7), 0.01)
    assert state.iteration == 10


def test_a_straight_drive_goes_as_far_as_its_speed_and_ramp_say():
    state = bodies([0.0, 0.0, 0.0]).drive(Steady((SPEED, SPEED)), 10.0)
    assert state.pose[0, 0] == pytest.approx(SPEED * 10.0 - SPEED**2 / (2.0 * ACCELERATION), rel=0.01)
    assert state.pose[0, 1:] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert state.velocity[0] == pytest.approx([SPEED, 0.0, 0.0], abs=1e-6)


def test_an_arc_closes_after_a_full_turn():
    radius = 0.5 * BASE * (0.15 + 0.10) / (0.15 - 0.10)
    period = 2.0 * math.pi * radius / 0.125
    drive, motion = bodies([0.0, 0.0, 0.0]), Steady((0.10, 0.15))
    start = drive.drive(motion, 1.0)
    end = drive.drive(motion, period)
    assert math.dist(start.pose[0, :2], end.pose[0, :2]) < 0.01 * 2.0 * math.pi * radius
    assert end.pose[0, 2] - start.pose[0, 2] == pytest.approx(2.0 * math.pi, rel=0.01)


def test_a_robot_without_commands_stays_where_it_is():
    state = bodies([[1.0, 2.0, 3.0]]).drive(Steady((0.0, 0.0)), 5.0)
    assert state.pose.tolist() == [[1.0, 2.0, 3.0]]


def varied_drive(substep, seconds=60):
    """The end of a minute of commands that change every half second, and the way driven."""
    rng = np.random.default_rng(12)
    commands = rng.uniform(-0.3, 1.0, (2 * seconds, 30, 2)) * SPEED
    places = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * 100.0
    drive = bodies(np.column_stack([places, np.linspace(-3.0, 3.0, 30)]), substep=substep)
    motion = Script(commands, substep)
    for _ in range(seconds):
        state = drive.drive(motion, 1.0)
    way = np.abs(commands.mean(axis=2)).sum(axis=0) * 0.5
    return state.pose, way


@pytest.fixture(scope="module")
def drives():
    return {steps: varied_drive(1.0 / steps) for steps in (16, 64, 128, 1024)}


def test_half_the_substep_changes_the_end_of_a_minute_by_less_than_1_percent_of_the_way(drives):
    (pose, way), (finer, _) = drives[64], drives[128]
    assert pytest.approx(1.0 / 64.0) == SUBSTEP
    assert np.all(np.linalg.norm(pose[:, :2] - finer[:, :2], axis=1) < 0.01 * way)


def test_the_error_shrinks_with_the_substep_and_at_the_default_is_below_a_quarter_percent(drives):
    exact, way = drives[1024]
    error = {steps: np.linalg.norm(drives[steps][0][:, :2] - exact[:, :2], axis=1) / way for steps in (16, 64, 128)}
    assert error[16].max() > error[64].max() > error[128].max() > 0.0
    assert np.median(error[128]) < 0.7 * np.median(error[64]) < 0.7 * np.median(error[16])
    assert error[64].max() < 0.0025


# --- motors and traction -------------------------------------------------------------------------


def test_rim_speeds_never_change_faster_than_the_motors_allow():
    rng = np.random.default_rng(1)
    for acceleration in (0.2, 1.0):
        drive = bodies(np.column_stack([np.arange(20.0), np.zeros((20, 2))]), acceleration=acceleration)
        before, fastest = drive.state().wheels, 0.0
        for _ in range(120):
            after = drive.drive(Steady(rng.uniform(-SPEED, SPEED, (20, 2))), SUBSTEP).wheels
            fastest = max(fastest, np.abs(after - before).max())
            before = after
        assert 0.99 * acceleration * SUBSTEP < fastest <= acceleration * SUBSTEP * (1.0 + 1e-9)


def test_rim_speeds_reach_what_is_wanted_and_stay():
    drive, wanted = bodies([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), [(0.15, -0.07), (0.01, 0.02)]
    state = drive.drive(Steady(*wanted), 1.0)
    assert state.wheels == pytest.approx(np.array(wanted))


def test_with_hardly_any_traction_the_wheels_spin_and_the_body_follows_later():
    """The body cannot accelerate by more than friction coefficient times g, however fast the wheels."""
    traction = 0.005
    drive = bodies([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]], traction=traction)
    motion = Steady((SPEED, SPEED), (SPEED, -SPEED))
    speeds, turns = [], []
    for _ in range(300):
        state = drive.drive(motion, SUBSTEP)
        speeds.append(state.velocity[0, 0])
        turns.append(state.velocity[1, 2])
    assert state.wheels[0] == pytest.approx([SPEED, SPEED])
    assert np.diff(speeds).max() <= traction * 9.81 * SUBSTEP * (1.0 + 1e-6)
    reached = np.argmax(np.array(speeds) > 0.99 * SPEED) * SUBSTEP
    assert reached == pytest.approx(0.99 * SPEED / (traction * 9.81), rel=0.05)
    assert reached > 10.0 * SPEED / ACCELERATION
    assert speeds[-1] == pytest.approx(SPEED)
    assert turns[-1] == pytest.approx(-2.0 * SPEED / BASE)
    assert abs(turns[9]) < 0.9 * 10 * SUBSTEP * 2.0 * ACCELERATION / BASE


def test_with_good_traction_the_body_follows_the_motors():
    drive = bodies([0.0, 0.0, 0.0])
    state = drive.drive(Steady((SPEED, SPEED)), SPEED / ACCELERATION + 3.0 * SUBSTEP)
    assert state.velocity[0, 0] == pytest.approx(SPEED, rel=1e-3)


def test_a_robot_does_not_slide_sideways_when_it_turns_at_full_speed():
    drive = bodies([0.0, 0.0, 0.0])
    for _ in range(40):
        state = drive.drive(Steady((0.05, SPEED)), 0.1)
        yaw, (vx, vy) = state.pose[0, 2], state.velocity[0, :2]
        assert abs(vy * math.cos(yaw) - vx * math.sin(yaw)) < 0.008 * SPEED


# --- contacts ------------------------------------------------------------------------------------


@pytest.mark.parametrize("angle", [0.0, 0.3, 1.2])
def test_a_robot_that_drives_at_a_wall_stops_there(angle):
    """It may slide along the wall, but never enters it by more than 5 % of its radius."""
    x_wall, deepest = 0.5, []
    drive = bodies([0.0, 0.0, angle], [[x_wall, -20.0, x_wall, 20.0]])
    spy = Spy([(SPEED, SPEED)], lambda pose: deepest.append(pose[0, 0] + RADIUS - x_wall))
    for _ in range(30):
        state = drive.drive(spy, 1.0)
    assert max(deepest) < 0.05 * RADIUS
    if angle == 0.0:
        assert state.pose[0, 0] == pytest.approx(x_wall - RADIUS, abs=0.01 * RADIUS)
        assert np.abs(state.velocity).max() < 0.02 * SPEED


def test_two_robots_head_on_block_each_other():
    apart = []
    drive = bodies([[0.0, 0.0, 0.0], [1.0, 0.0, math.pi]])
    spy = Spy([(SPEED, SPEED)] * 2, lambda pose: apart.append(math.dist(pose[0, :2], pose[1, :2])))
    for _ in range(20):
        state = drive.drive(spy, 1.0)
    assert 0.9 * 2.0 * RADIUS < min(apart) < 2.0 * RADIUS
    assert state.pose[0, 0] < 0.5 < state.pose[1, 0]
    assert apart[-1] == pytest.approx(2.0 * RADIUS, rel=0.01)
    assert state.pose[:, 0].mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(state.velocity).max() < 0.02 * SPEED


def test_a_moving_robot_pushes_another_that_brakes_and_two_push_it_further():
    still, driven = (0.0, 0.0), (SPEED, SPEED)
    free = bodies([0.0, 0.0, 0.0]).drive(Steady(driven), 10.0).pose[0, 0]
    one = bodies([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]]).drive(Steady(driven, still), 10.0).pose
    two = bodies([[0.0, 0.0, 0.0], [-0.115, 0.0, 0.0], [0.2, 0.0, 0.0]]).drive(Steady(driven, driven, still), 10.0).pose
    assert 0.2 < one[1, 0] < two[2, 0]
    assert one[0, 0] < two[0, 0] < free
    assert one[1, 0] - one[0, 0] == pytest.approx(2.0 * RADIUS, rel=0.1)


class Rush:
    """Random full-throttle commands; measures how deep discs are in walls and in each other at every sub-step."""

    def __init__(self, count, walls, rng):
        self.walls, self.rng = walls, rng
        self.wanted = np.zeros((count, 2))
        self.into_walls, self.into_robots, self.farthest = 0.0, 0.0, 0.0
        self.asked, self.touching, self.last = 0, 0, None

    def follow(self, intents):
        """New commands: straight ahead most often, for that is how robots press on each other."""
        throttles = np.array([[1.0, 1.0], [1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 0.2], [0.2, 1.0]])
        self.wanted = SPEED * throttles[self.rng.integers(0, len(throttles), len(self.wanted))]

    def command(self, pose):
        points = pose[:, :2].copy()
        self.into_walls = max(self.into_walls, RADIUS - distance_to_walls(points, self.walls).min())
        pairs = cKDTree(points).query_pairs(2.0 * RADIUS, output_type="ndarray")
        if len(pairs):
            overlap = 2.0 * RADIUS - np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
            self.into_robots = max(self.into_robots, overlap.max())
            self.touching += len(pairs)
        if self.last is not None:
            self.farthest = max(self.farthest, np.linalg.norm(points - self.last, axis=1).max())
        self.last = points
        self.asked += 1
        return self.wanted


@pytest.mark.thorough
def test_in_100_000_robot_steps_through_a_crowd_no_disc_enters_a_wall_or_another_disc():
    """A robot-step is one robot for one control period, here the third of a second that it takes a robot to cross
    its own radius. As no disc's centre comes nearer to a wall than 95 % of its radius at any sub-step, and none moves
    by a tenth of its radius in between, none crosses a wall."""
    count, periods, period = 200, 500, 1.0 / 3.0
    rng = np.random.default_rng(99)
    pillars = [rectangle(0.7, 0.7, 0.85, 1.6), rectangle(1.5, 0.4, 2.2, 0.45), column(1.5, 1.4, 0.2)]
    sharp = [[2.05, 1.2, 2.4, 1.9], [2.4, 1.9, 2.0, 1.9], [2.0, 1.9, 2.05, 1.2]]
    walls = np.array(room(2.7, 2.4) + [side for pillar in pillars for side in pillar] + sharp)
    places = np.stack(np.meshgrid(np.arange(0.07, 2.64, 0.12), np.arange(0.07, 2.34, 0.12)), axis=-1).reshape(-1, 2)
    inside = (
        (np.abs(places - (0.775, 1.15)) < (0.075, 0.45)).all(axis=1)
        | (np.abs(places - (1.85, 0.425)) < (0.35, 0.025)).all(axis=1)
        | (np.hypot(*(places - (1.5, 1.4)).T) < 0.2)
        | (np.abs(places - (2.2, 1.55)) < (0.2, 0.35)).all(axis=1)
    )
    places = places[~inside & (distance_to_walls(places, walls).min(axis=1) >= RADIUS)]
    places = places[rng.permutation(len(places))[:count]]
    assert len(places) == count
    drive = bodies(np.column_stack([places, rng.uniform(-np.pi, np.pi, count)]), walls)
    rush = Rush(count, walls, rng)
    for _ in range(periods):
        rush.follow(None)
        state = drive.drive(rush, period)
    rush.command(state.pose)
    assert rush.asked == periods * math.ceil(period / SUBSTEP) + 1
    assert rush.touching > 100_000
    assert rush.into_robots < 0.10 * RADIUS
    assert 0.0 < rush.into_walls < 0.05 * RADIUS
    assert rush.farthest < 0.10 * RADIUS
    assert np.linalg.norm(state.pose[:, :2] - places, axis=1).mean() > RADIUS


# --- reading and repeating -----------------------------------------------------------------------


def test_batch_reads_equal_pymunks_attributes_after_every_substep():
    rng = np.random.default_rng(3)
    start = np.column_stack([rng.permutation(np.arange(12)) * 0.12, rng.uniform(0.1, 0.9, 12), rng.uniform(-3, 3, 12)])
    drive = bodies(start, [[-0.2, 0.0, 2.0, 0.0], [2.0, 1.0, -0.2, 1.0]])
    by_place = {tuple(body.position): body for body in drive.space.bodies}
    in_order = [by_place[x, y] for x, y, _ in start.tolist()]

    def slowly():
        return np.array([[*b.position, b.angle, *b.velocity, b.angular_velocity] for b in in_order])

    def look(pose):
        assert_array_equal(pose, slowly()[:, :3])

    for _ in range(20):
        state = drive.drive(Spy(rng.uniform(-SPEED, SPEED, (12, 2)), look), 0.25)
        assert_array_equal(np.hstack([state.pose, state.velocity]), slowly())
    assert np.abs(state.pose - start).max() > 0.1


def test_states_are_copies_that_later_driving_leaves_alone():
    drive = bodies([0.0, 0.0, 0.0])
    first = drive.drive(Steady((SPEED, SPEED)), 1.0)
    kept = first.pose.copy(), first.velocity.copy(), first.wheels.copy()
    drive.drive(Steady((-SPEED, SPEED)), 1.0)
    for then, now in zip(kept, (first.pose, first.velocity, first.wheels), strict=True):
        assert_array_equal(then, now)


def test_the_same_drive_twice_gives_the_same_bits():
    ends = []
    for _ in range(2):
        rng = np.random.default_rng(8)
        places = np.stack(np.meshgrid(np.arange(5), np.arange(6)), axis=-1).reshape(-1, 2) * 0.13 + 0.1
        start = np.column_stack([places, rng.uniform(-np.pi, np.pi, 30)])
        drive = bodies(start, room(0.85, 0.95))
        for _ in range(20):
            state = drive.drive(Steady(rng.uniform(-SPEED, SPEED, (30, 2))), 1.0)
        ends.append(state)
    for field in ("pose", "velocity", "wheels"):
        assert_array_equal(getattr(ends[0], field), getattr(ends[1], field))


def test_the_substep_is_rounded_down_to_a_whole_fraction_of_the_period():
    asked = []
    bodies([0.0, 0.0, 0.0], substep=0.03).drive(Spy([(0.0, 0.0)], asked.append), 0.1)
    assert len(asked) == 4


@pytest.mark.parametrize(("speed", "substep"), [(2.0, 0.125), (20.0, 1 / 64)])
def test_fast_robots_do_not_pass_thin_walls(tmp_path, speed, substep):
    """Walls 2 cm thin, sub-steps in which a robot would drive 25 cm or more."""
    (tmp_path / "w.svg").write_text(
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 3.6 2.4"><g id="walls"><path fill="none" stroke="#000" '
        'stroke-width="0.02" d="M.15 .15H3.45V2.25H.15Z M2.1 .15V1.2"/></g></svg>'
    )
    (tmp_path / "s.toml").write_text(
        f'world = "w.svg"\n[robots]\ncount = 8\nspeed = {speed}\nacceleration = {10 * speed}\ntraction = 9.0\n'
        f'[physics]\nsubstep = {substep}\n[network.topology]\nuse = "none"\n'
        '[stop]\niterations = 40\nwhen_done = "continue"\n'
    )
    run = build(load(tmp_path / "s.toml"), "s.toml")
    while not run.simulation.over:
        x, y, _ = run.simulation.tick().state.pose.T
        assert ((x > 0.15) & (x < 3.45) & (y > 0.15) & (y < 2.25)).all()


def test_a_pushed_robot_slides_as_far_as_friction_lets_it() -> None:
    """Sideways, wheels can only rub: v^2 / (2 mu g) is the way that a blow of v gives."""
    run = made("robots.count=2", "stop.iterations=12", 'faults=[{use="push", at=3, velocity=[0.0, 0.6], robots=[0]}]')
    still = made("robots.count=2", "stop.iterations=12")
    poses = []
    for one in (run, still):
        for _ in range(4):
            one.simulation.tick()
        poses.append(one.simulation.state.pose[0, :2])
    assert np.hypot(*(poses[0] - poses[1])) > 0.01
    with pytest.raises(InputError, match="particles have no mass"):
        made("stop.iterations=5", 'faults=[{use="push", at=3, velocity=[0.0, 0.6]}]', "physics.use='particles'")


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.09, 0.25, 0.6])
def test_a_robot_pressed_onto_a_wall_is_braked_by_friction_times_the_pressure(friction: float) -> None:
    """While it slides, before it rolls, it loses mu g t of its speed."""
    gravity, seconds, speed = 9.81, 0.125, 3.0
    drive = bodies([0.0, RADIUS, 0.0], [[1.0, 0.0, -1.0, 0.0]], 1 / 1024, friction, traction=1e-4)
    drive.space.gravity = (0.0, -gravity)
    drive.push(np.array([0]), (speed, 0.0))
    lost = speed - drive.drive(Steady((0.0, 0.0)), seconds).velocity[0, 0]
    assert lost == pytest.approx(friction * gravity * seconds, rel=0.02, abs=5e-4)


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.09, 0.25, 0.6])
def test_a_robot_that_is_grazed_gets_friction_times_the_blow_along_the_contact(friction: float) -> None:
    touching = [[0.0, 0.0, 0.0], [2.0 * RADIUS, 0.0, 0.0]]
    drive = bodies(touching, OPEN, 1e-4, friction, traction=1e-4)
    drive.push(np.array([0]), (0.1, 0.2))
    ahead, aside = drive.drive(Steady((0.0, 0.0), (0.0, 0.0)), 2e-3).velocity[1, :2]
    assert ahead > 0.04
    assert aside / ahead == pytest.approx(friction, rel=0.02, abs=3e-3)


def test_the_default_friction_gives_shapes_the_value_of_earlier_versions_to_the_bit() -> None:
    drive = bodies([0.0, RADIUS, 0.0], [[1.0, 0.0, -1.0, 0.0]])
    assert {shape.friction for shape in drive.space.shapes} == {0.3}


class Wrapped:
    """A motion that hides what it is, so that every sub-step asks it."""

    def __init__(self, inner: WaypointFollower) -> None:
        self._inner = inner

    def follow(self, intents) -> None:
        self._inner.follow(intents)

    def command(self, pose):
        return self._inner.command(pose)


FAILING = (
    'faults=[{use="motor", failure="slow", at=3, duration=20, wheel="left", factor=0.3, count=2}, '
    '{use="motor", failure="stuck", at=8, speed=-0.05, wheel="right", count=1}, '
    '{use="motor", failure="off", at=20, count=1}]'
)


@pytest.mark.parametrize(
    ("scenario", "changes"),
    [("room", ()), ("operations/heading-consensus", ()), ("faults/returns", ()), ("room", (FAILING,))],
)
def test_a_period_in_one_compiled_call_moves_bodies_as_the_loop_in_python_does(
    scenario: str, changes: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    fast, slow = (made("stop.iterations=40", *changes, scenario=scenario).simulation for _ in range(2))
    slow.parts = replace(slow.parts, motion=Wrapped(slow.parts.motion))
    rolled: list[int] = []
    monkeypatch.setattr(drive, "roll", lambda count, *rest, roll=drive.roll: (rolled.append(count), roll(count, *rest)))
    for _ in range(40):
        one, other = fast.tick().state, slow.tick().state
        assert rolled.pop() > 0  # the other runs the loop in Python
        assert not rolled
        assert_array_equal(one.pose, other.pose)
        assert_array_equal(one.velocity, other.velocity)
        assert_array_equal(one.wheels, other.wheels)
        if fast.over:
            break


@pytest.mark.parametrize("change", ["period=9e4", "physics.substep=1e-12", "robots.speed=1e4"])
def test_an_iteration_of_too_many_sub_steps_is_refused_with_their_number(change: str) -> None:
    with pytest.raises(InputError, match=r"physics\.substep: .* sub-steps of .*; expected at most 100000"):
        made(change)


def test_a_robot_stands_at_its_last_waypoint_and_at_no_other() -> None:
    pose, wanted, cursor = np.array([[1.0, 1.0, 0.0]]), np.full((1, 2), 9.0), np.zeros(1, np.int64)
    paces, rims, aims = np.array([[0.15, 0.5]]), np.array([[0.15, 0.1]]), np.full((1, 4), 9.0)
    ahead = 0.05

    def speeds(*ways: tuple[float, float]) -> list[float]:
        cursor[:] = 0
        counts = np.array([len(ways)], np.int32)
        drive.pursue(pose, np.array([ways]), counts, cursor, np.array([ahead]), paces, aims)
        drive.towards(aims, rims, wanted)
        return wanted[0].tolist()

    near = 1.0 + 0.5 * drive.ARRIVED * ahead
    assert speeds((near, 1.0)) == [0.0, 0.0]
    assert min(speeds((1.0 + 2.0 * drive.ARRIVED * ahead, 1.0))) > 0.0
    assert speeds((near, 1.0), (2.0, 1.0)) == [0.15, 0.15]
    assert cursor.tolist() == [1]

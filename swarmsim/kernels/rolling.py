"""Omnidirectional and steered wheels: commands within their limits, and their traction."""

from __future__ import annotations

import math

from swarmsim.kernels.compiling import njit

THIRD = 2.0 * math.pi / 3.0  # rad between two of three wheels
RELEASED = 0.5  # of the tightest bend: a car that backs out goes on once the bend to its aim is this wide


@njit(cache=True, error_model="numpy")
def omni_command(twists, traits, wanted):
    """The velocities (n, 3) that wheels can give: scaled down in proportion where one would be too fast.

    `traits` (n, 6) are each robot's own: top speed (m/s) of a wheel, its distance from the middle (m), mass (kg),
    moment of inertia (kg m^2), acceleration (m/s^2) and grip (N) of a wheel. No wheel is faster than the body plus its
    turn, which is held to the top speed in all directions alike. Writes `wanted` (n, 3).
    """
    for i in range(len(twists)):
        size = math.hypot(twists[i, 0], twists[i, 1]) + traits[i, 1] * abs(twists[i, 2])
        slower = min(1.0, traits[i, 0] / max(size, 1e-12))
        for axis in range(3):
            wanted[i, axis] = twists[i, axis] * slower


@njit(cache=True, error_model="numpy")
def omni_approach(aims, wanted):
    """The velocities (n, 3) straight to points `aims` (n, 4) as in `Kinematics.approach`, without turning."""
    for i in range(len(aims)):
        share = aims[i, 3] / aims[i, 2] if aims[i, 3] > 0.0 else 0.0
        wanted[i, 0], wanted[i, 1], wanted[i, 2] = aims[i, 0] * share, aims[i, 1] * share, 0.0


@njit(cache=True, error_model="numpy")
def omni_forces(moving, wheels, wanted, push, dt, traits):
    """Traction of three omnidirectional wheels at thirds of a turn, one of them behind, for one sub-step.

    `wheels` (n, 3) is the body velocity at which they would roll, m/s ahead, m/s to the left and rad/s; it moves
    straight towards `wanted` (n, 3), no wheel by more than its acceleration times `dt`. A wheel pushes only along its
    own direction, as rollers let it slide along its axle; the three pushes that together would give the body that
    velocity are each cut to the grip, Coulomb's limit for a third of the weight. All else as in `drive.forces`.
    """
    for i in range(len(wheels)):
        arm, mass, moment, grip = traits[i, 1], traits[i, 2], traits[i, 3], traits[i, 5]
        ahead, left, turn = wanted[i, 0] - wheels[i, 0], wanted[i, 1] - wheels[i, 1], wanted[i, 2] - wheels[i, 2]
        share = min(1.0, traits[i, 4] * dt / max(math.hypot(ahead, left) + arm * abs(turn), 1e-12))
        wheels[i, 0] += ahead * share
        wheels[i, 1] += left * share
        wheels[i, 2] += turn * share
        heading = moving[i, 2] + 1.5 * dt * moving[i, 5]
        cos, sin = math.cos(heading), math.sin(heading)
        along = mass * (wheels[i, 0] - moving[i, 3] * cos - moving[i, 4] * sin) / dt
        across = mass * (wheels[i, 1] - moving[i, 4] * cos + moving[i, 3] * sin) / dt
        spin = moment * (wheels[i, 2] - moving[i, 5]) / dt
        x, y, torque = 0.0, 0.0, 0.0
        for wheel in range(3):
            place = (0.5 + wheel) * THIRD
            to_x, to_y = -math.sin(place), math.cos(place)
            pushes = 2.0 / 3.0 * (along * to_x + across * to_y) + spin / (3.0 * arm)
            pushes = min(max(pushes, -grip), grip)
            x += pushes * to_x
            y += pushes * to_y
            torque += pushes * arm
        push[i, 0] = x * cos - y * sin
        push[i, 1] = x * sin + y * cos
        push[i, 2] = torque


@njit(cache=True, error_model="numpy")
def car_command(twists, traits, wanted):
    """Speeds and steering angles (n, 2) for velocities (n, 3).

    `traits` (n, 8) are each robot's own: top speed (m/s), distance of the axles (m), largest steering angle (rad) and
    its rate (rad/s), mass (kg), moment of inertia (kg m^2), acceleration (m/s^2) and grip of an axle (N). A turn too
    tight for the speed ahead is driven in the tightest bend, at the speed that this turn needs; velocity to the side is
    ignored.
    """
    for i in range(len(twists)):
        speed, turn = twists[i, 0], twists[i, 2]
        tightest = traits[i, 1] / math.tan(traits[i, 2])
        if abs(speed) < abs(turn) * tightest:
            speed = math.copysign(abs(turn) * tightest, speed)
        steering = math.atan(traits[i, 1] * turn / speed) if speed != 0.0 else 0.0
        wanted[i, 0] = min(max(speed, -traits[i, 0]), traits[i, 0])
        wanted[i, 1] = min(max(steering, -traits[i, 2]), traits[i, 2])


@njit(cache=True, error_model="numpy")
def car_approach(aims, traits, backing, wanted):
    """Speeds and steering angles (n, 2) that lead to points `aims` (n, 4) as in `Kinematics.approach`.

    The rear axle takes the arc of pure pursuit: ahead to points ahead of the middle, backwards to points behind.
    If that is tighter than the car can turn, it drives away from the point, turning towards it, until the remaining
    bend is wide enough; `backing` (n,) keeps the direction: 1 ahead, -1 backwards, 0 for none.
    """
    for i in range(len(aims)):
        wanted[i, 0], wanted[i, 1] = 0.0, 0.0
        if aims[i, 3] == 0.0:
            backing[i] = 0
            continue
        base, most, ahead, left = traits[i, 1], traits[i, 2], aims[i, 0], aims[i, 1]
        bend = 2.0 * left / (aims[i, 2] * aims[i, 2])
        tightest = math.tan(most) / base
        if abs(bend) <= RELEASED * tightest:
            backing[i] = 0
        elif abs(bend) > tightest and backing[i] == 0:
            backing[i] = -1 if ahead >= 0.0 else 1
        if backing[i] != 0:
            wanted[i, 0] = backing[i] * aims[i, 3]
            wanted[i, 1] = -math.copysign(most, left)
        else:
            wanted[i, 0] = math.copysign(aims[i, 3], ahead)
            wanted[i, 1] = math.atan(base * bend)


@njit(cache=True, error_model="numpy")
def car_forces(moving, wheels, wanted, push, dt, traits):
    """Traction of a car's two axles, equally far before and behind the middle, for one sub-step: the bicycle model.

    `wheels` (n, 2) is the speed of the rear axle (m/s) and the steering angle (rad); each moves towards `wanted` (n, 2)
    at its own rate; in a bend the front axle, the faster one, has the top speed at most. Both axles roll without
    slipping if the middle moves at that speed ahead and at half the turn times the distance of the axles to the left.
    The axles, both driven, share the force for this, with equal pushes along their wheels, and each share is cut to the
    friction circle of radius grip, Coulomb's limit for half the weight. All else as in `drive.forces`.
    """
    for i in range(len(wheels)):
        base, mass, moment, grip = traits[i, 1], traits[i, 4], traits[i, 5], traits[i, 7]
        limit = traits[i, 3] * dt
        wheels[i, 1] += min(max(wanted[i, 1] - wheels[i, 1], -limit), limit)
        limit, fastest = traits[i, 6] * dt, traits[i, 0] * math.cos(wheels[i, 1])
        aim = min(max(wanted[i, 0], -fastest), fastest)
        wheels[i, 0] += min(max(aim - wheels[i, 0], -limit), limit)
        speed, steering = wheels[i, 0], wheels[i, 1]
        turn = speed * math.tan(steering) / base
        heading = moving[i, 2] + 1.5 * dt * moving[i, 5]
        cos, sin = math.cos(heading), math.sin(heading)
        along = mass * (speed - moving[i, 3] * cos - moving[i, 4] * sin) / dt
        across = mass * (0.5 * base * turn - moving[i, 4] * cos + moving[i, 3] * sin) / dt
        spin = moment * (turn - moving[i, 5]) / dt
        # In the body's frame: the difference of the pushes to the side turns it, half a base from the middle.
        front_y, rear_y = 0.5 * across + spin / base, 0.5 * across - spin / base
        front_x = (along - front_y * math.sin(steering)) / (1.0 + math.cos(steering))
        rear_x = along - front_x
        front = min(1.0, grip / max(math.hypot(front_x, front_y), 1e-12))
        rear = min(1.0, grip / max(math.hypot(rear_x, rear_y), 1e-12))
        x, y = front_x * front + rear_x * rear, front_y * front + rear_y * rear
        push[i, 0] = x * cos - y * sin
        push[i, 1] = x * sin + y * cos
        push[i, 2] = 0.5 * base * (front_y * front - rear_y * rear)

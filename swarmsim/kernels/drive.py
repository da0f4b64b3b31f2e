"""Wheels and waypoints: each robot's motion within one physics sub-step."""

from __future__ import annotations

import math

from swarmsim.kernels.compiling import intrinsic, njit

ARRIVED = 0.1  # of the look-ahead distance: nearer than this to its last waypoint, a robot stands


@intrinsic
def _step(typingctx, function, space, dt):
    """Call `function(space, dt)`, given by its address, of a physics engine's space."""
    from llvmlite import ir  # which robots without a compiler lack
    from numba import types

    def code(context, builder, signature, args):
        anything = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [anything, ir.DoubleType()])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), [builder.inttoptr(args[1], anything), args[2]])
        return context.get_dummy_value()

    return types.void(types.uint64, types.uint64, types.float64), code


@intrinsic
def _each(typingctx, function, space, callback, data):
    """Call `function(space, callback, data)`, all given by their addresses."""
    from llvmlite import ir
    from numba import types

    def code(context, builder, signature, args):
        anything = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [anything] * 3)
        given = [builder.inttoptr(argument, anything) for argument in args[1:]]
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), given)
        return context.get_dummy_value()

    return types.void(*[types.uint64] * 4), code


@njit(cache=True, error_model="numpy")
def roll(
    count, dt, engine, written, read, moving, wheels, push, traits,
    waypoints, counts, cursor, ahead, paces, aims, wanted, turning, twisting, rims, failing, laws,
):  # fmt: skip
    """Run `count` sub-steps of `dt` (s): follow waypoints, push, step the engine and read it, each time.

    `engine` (7,) are the addresses of: the engine's step, its call for each body, the space, the call that writes
    forces with its data, and the call that reads motions with its data. `written` and `read` (1,), in the engine's
    memory, count the numbers these have handled. Robots that are `turning` (n,) take the wheel speeds `twisting` (n, 2)
    instead of following waypoints. Then come the failures of motors, one after another: where `failing` (f, n, 2), a
    wheel's speed becomes `laws` (f, 2), a gain, times the wanted one, plus a bias (m/s). All else is as in `forces`,
    `pursue` and `towards`.
    """
    size = written[0]
    for _ in range(count):
        pursue(moving[:, :3], waypoints, counts, cursor, ahead, paces, aims)
        towards(aims, rims, wanted)
        for i in range(len(turning)):
            if turning[i]:
                wanted[i, 0], wanted[i, 1] = twisting[i, 0], twisting[i, 1]
        for f in range(len(laws)):
            for i in range(len(wanted)):
                for w in range(2):
                    if failing[f, i, w]:
                        wanted[i, w] = wanted[i, w] * laws[f, 0] + laws[f, 1]
        forces(moving, wheels, wanted, push, dt, traits)
        written[0] = 0
        _each(engine[1], engine[2], engine[3], engine[4])
        written[0] = size
        _step(engine[0], engine[2], dt)
        read[0] = 0
        _each(engine[1], engine[2], engine[5], engine[6])


@njit(cache=True, error_model="numpy")
def forces(moving, wheels, wanted, push, dt, traits):
    """Traction of the wheels of every robot for one sub-step.

    `traits` (n, 5) are each robot's own: wheel base (m), mass (kg), moment of inertia (kg m^2), acceleration (m/s^2)
    and grip (N).

    Each wheel's rim speed in `wheels` (n, 2) first moves towards `wanted` (n, 2) by at most
    its acceleration times `dt`. The forces that would make the body roll without slipping are then shared
    between the two contact points, and each is cut to the friction circle of radius grip, Coulomb's
    limit for half the weight. `moving` (n, 6) is x, y, yaw and their rates in the world frame, and so are the
    force (N) and the torque (N m) written to `push` (n or more, 3). Semi-implicit Euler applies a force to the
    motion of the next sub-step, so it is aimed along the body's heading in the middle of that one.
    """
    for i in range(len(wheels)):
        base, mass, moment, acceleration, grip = traits[i, 0], traits[i, 1], traits[i, 2], traits[i, 3], traits[i, 4]
        for w in range(2):
            change = wanted[i, w] - wheels[i, w]
            limit = acceleration * dt
            wheels[i, w] += min(max(change, -limit), limit)
        heading = moving[i, 2] + 1.5 * dt * moving[i, 5]
        cos = math.cos(heading)
        sin = math.sin(heading)
        ahead = moving[i, 3] * cos + moving[i, 4] * sin
        aside = moving[i, 4] * cos - moving[i, 3] * sin
        thrust = mass * (0.5 * (wheels[i, 0] + wheels[i, 1]) - ahead) / dt
        spin = moment * ((wheels[i, 1] - wheels[i, 0]) / base - moving[i, 5]) / dt
        across = -0.5 * mass * aside / dt
        left = 0.5 * thrust - spin / base
        right = 0.5 * thrust + spin / base
        left_share = min(1.0, grip / max(math.hypot(left, across), 1e-12))
        right_share = min(1.0, grip / max(math.hypot(right, across), 1e-12))
        along = left * left_share + right * right_share
        across *= left_share + right_share
        push[i, 0] = along * cos - across * sin
        push[i, 1] = along * sin + across * cos
        push[i, 2] = 0.5 * base * (right * right_share - left * left_share)


@njit(cache=True, error_model="numpy")
def wheels_of(twists, rims, wheels):
    """Wheel speeds of velocities (n, 3) in m/s ahead, m/s to the left (ignored) and rad/s.

    `rims` (n, 2) as in `towards`. Slower, on the same arc, where a wheel is too fast. Writes `wheels` (n, 2).
    """
    for i in range(len(twists)):
        top, base = rims[i, 0], rims[i, 1]
        aside = 0.5 * base * twists[i, 2]
        left, right = twists[i, 0] - aside, twists[i, 0] + aside
        slower = min(1.0, top / max(abs(left), abs(right), 1e-12))
        wheels[i, 0], wheels[i, 1] = left * slower, right * slower


@njit(cache=True, error_model="numpy")
def pursue(pose, waypoints, counts, cursor, ahead, paces, aims):
    """The point of its way that each robot heads for, as in pure pursuit (Coulter 1992, CMU-RI-TR-92-01).

    It is its first waypoint at least `ahead` (n,) m away, remembered in `cursor` (n,); it stops only at the last one.
    `paces` (n, 2) are each robot's own: top speed (m/s) and braking (m/s^2). Writes `aims` (n, 4): m ahead, m to the
    left, distance in m, and m/s at most, 0 for standing robots.
    """
    for i in range(len(counts)):
        aims[i, 3] = 0.0
        if counts[i] == 0:
            continue
        while True:
            dx = waypoints[i, cursor[i], 0] - pose[i, 0]
            dy = waypoints[i, cursor[i], 1] - pose[i, 1]
            distance = math.hypot(dx, dy)
            last = cursor[i] >= counts[i] - 1
            if distance >= ahead[i] or last:
                break
            cursor[i] += 1
        if last and distance < ARRIVED * ahead[i]:
            continue
        cos = math.cos(pose[i, 2])
        sin = math.sin(pose[i, 2])
        aims[i, 0] = dx * cos + dy * sin
        aims[i, 1] = dy * cos - dx * sin
        aims[i, 2] = distance
        speed = paces[i, 0]
        aims[i, 3] = min(speed, math.sqrt(2.0 * paces[i, 1] * distance)) if last else speed


@njit(cache=True, error_model="numpy")
def towards(aims, rims, wanted):
    """Wheel speeds that lead to points `aims` (n, 4), as `pursue` gives them, in arcs.

    Robots slow down on too tight an arc, and turn on the spot to a target behind. `rims` (n, 2) are each robot's own:
    top speed (m/s at either wheel rim) and wheel base (m). Writes `wanted` (n, 2).
    """
    for i in range(len(aims)):
        forward, left, distance, limit = aims[i, 0], aims[i, 1], aims[i, 2], aims[i, 3]
        if limit == 0.0:
            wanted[i, 0], wanted[i, 1] = 0.0, 0.0
        elif forward > 0.0:
            bend = rims[i, 1] * left / (distance * distance)  # half the wheel base times the curvature 2 left / d^2
            wanted[i, 0] = limit * (1.0 - bend) / (1.0 + abs(bend))
            wanted[i, 1] = limit * (1.0 + bend) / (1.0 + abs(bend))
        else:
            wanted[i, 0] = -limit if left >= 0.0 else limit
            wanted[i, 1] = -wanted[i, 0]

"""How joints are driven, the same in every format that can say it: a critically damped servo a joint."""

from __future__ import annotations

import numpy as np

from rearticulate.export.robot import Robot

STIFFNESS = 50.0  # angular frequency of a joint under its servo, rad/s; what it holds hangs lower by g / STIFFNESS^2
DAMPING_RATIO = 1.0


def stiffness(robot: Robot, k: int) -> float:
    """Of the servo of joint k, N m/rad or N/m."""
    return STIFFNESS**2 * moved_inertia(robot, k)


def damping(robot: Robot, k: int) -> float:
    """Of the servo of joint k, N m s/rad or N s/m."""
    return 2 * DAMPING_RATIO * STIFFNESS * moved_inertia(robot, k)


def moved_inertia(robot: Robot, k: int) -> float:
    """What joint k moves in the rest pose: kg m^2 about its axis, or kg along it."""
    link, total, below = robot.links[k], 0.0, [k]
    for j in below:
        below += robot.children(j)
        body = robot.links[j].body
        if body is None:
            continue
        if link.kind == "prismatic":
            total += body.mass
        else:
            lever = np.cross(link.axis, robot.links[j].origin + body.centre - link.origin)
            total += float(link.axis @ body.inertia @ link.axis + body.mass * lever @ lever)
    return total

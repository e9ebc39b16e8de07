"""How joints resist and how they are driven, the same in every format that can say it: friction and damping, and a
critically damped servo a joint that carries what hangs on it."""

from __future__ import annotations

import numpy as np

from rearticulate.export.robot import ExportConfig, Robot

GRAVITY = 9.81
STIFFNESS = (
    50.0  # least angular frequency of a joint under its servo, rad/s: a slide hangs lower by GRAVITY / STIFFNESS^2
)
SAG = 0.003  # what a turning joint under its servo gives way to the weight at most, rad
DAMPING_RATIO = 1.0
FRICTION = 0.01  # where none is given: of the weight, or its largest moment
ARMATURE = 0.01  # inertia of the motor that drives a joint, of the inertia that the joint moves
DECAY = 1.0  # of a joint that swings freely where no damping is given, 1/s


def stiffness(robot: Robot, k: int) -> float:
    """Of the servo of joint k, N m/rad or N/m."""
    firm = STIFFNESS**2 * moved_inertia(robot, k)
    return firm if robot.links[k].kind == "prismatic" else max(firm, weight(robot, k) / SAG)


def servo_damping(robot: Robot, k: int) -> float:
    """Of the servo of joint k, N m s/rad or N s/m."""
    return 2 * DAMPING_RATIO * float(np.sqrt(stiffness(robot, k) * moved_inertia(robot, k)))


def armature(robot: Robot, k: int) -> float:
    """Of joint k, kg m^2 or kg."""
    return ARMATURE * moved_inertia(robot, k)


def friction(robot: Robot, k: int, config: ExportConfig) -> float:
    """Of joint k, N m or N."""
    return FRICTION * weight(robot, k) if config.friction is None else config.friction


def damping(robot: Robot, k: int, config: ExportConfig) -> float:
    """Of joint k without a servo, N m s/rad or N s/m."""
    return DECAY * moved_inertia(robot, k) if config.damping is None else config.damping


def moved_inertia(robot: Robot, k: int) -> float:
    """What joint k moves in the rest pose: kg m^2 about its axis, or kg along it."""
    link, total = robot.links[k], 0.0
    for j in robot.below(k):
        body = robot.links[j].body
        if body is None:
            continue
        if link.kind == "prismatic":
            total += body.mass
        else:
            lever = np.cross(link.axis, robot.links[j].origin + body.centre - link.origin)
            total += float(link.axis @ body.inertia @ link.axis + body.mass * lever @ lever)
    return total


def weight(robot: Robot, k: int) -> float:
    """What joint k carries where gravity pulls the most at it: N along it, or N m about its axis in the rest pose."""
    link, total = robot.links[k], np.zeros(3)
    bodies = [(robot.links[j].origin, body) for j in robot.below(k) if (body := robot.links[j].body) is not None]
    if link.kind == "prismatic":
        return GRAVITY * sum(body.mass for _, body in bodies)
    for origin, body in bodies:
        total += body.mass * np.cross(link.axis, origin + body.centre - link.origin)
    return GRAVITY * float(np.linalg.norm(total))

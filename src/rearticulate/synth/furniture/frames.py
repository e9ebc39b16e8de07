"""Things on frames: doors and windows, chairs, carts."""

from __future__ import annotations

import numpy as np

from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.furniture.hardware import Array, Rng, X, Y, Z, bars, sides, tray, wheel
from rearticulate.synth.primitives import bar, block


def doorway(rng: Rng) -> ArticulatedObject:
    """A door or window that swings or slides in its frame, with a handle that turns."""
    width, height, thick = rng.uniform((0.4, 0.5, 0.02), (1.0, 2.0, 0.06))
    posts = [block((0.08, 0.1, height), s + height / 2 * Z) for s in sides(width / 2 + 0.04)]
    build = ObjectBuilder("frame", np.concatenate([*posts, block((width + 0.16, 0.1, 0.08), (0, 0, height + 0.04))]))
    hinges = [block((0.02, 0.12, 0.1), (-width / 2, 0, share * height)) for share in (0.2, 0.8)]
    surface = np.concatenate([_leaf(width, height, thick, rng), *hinges])
    if rng.random() < 0.7:
        opening = (-rng.uniform(0.5, 1.8), 0)
        leaf = build.add("leaf", surface, 0, "revolute", axis=Z, point=-width / 2 * X, limits=opening)
    else:
        way, far = [(X, width), (-X, width), (Z, height)][rng.integers(3)]
        leaf = build.add("leaf", surface, 0, "prismatic", axis=way, limits=(0, 0.7 * far))
    lock, out = np.array([0.42 * width, 0, 0.5 * height]), 0.07 * Y
    levers = [lock - out, lock + out]
    grip = np.concatenate([bars(levers[:1], 2 * out, 0.012), bars(levers, -rng.uniform(0.08, 0.15) * X, 0.012)])
    build.add("handle", grip, leaf, "revolute", axis=Y, point=lock, limits=(-0.8, 0.8))
    return build.build()


def swivel_chair(rng: Rng) -> ArticulatedObject:
    """A star, a column that goes up and down, a seat that turns, a back that leans."""
    width, depth, height = rng.uniform(0.35, 0.6, 3)
    thin, neck, seat_height = rng.uniform(0.01, 0.02), (height / 2 - 0.1) * Z, height * Z
    spokes = [np.array([np.cos(a), np.sin(a), 0]) * 0.55 * depth for a in np.arange(5) * 0.4 * np.pi]
    star = [bar(0.06 * Z, s + 0.05 * Z, (2 * thin, thin), sides=4) for s in spokes]
    build = ObjectBuilder("star", np.concatenate([*star, bar((0, 0, 0), height / 2 * Z, 0.035)]))
    column = np.concatenate([bar(neck, seat_height, 0.025), block((0.12, 0.02, 0.02), (0.06, 0, height - 0.04))])
    lift = build.add("column", column, 0, "prismatic", axis=Z, limits=(-0.05, 0.09))
    arms = [block((0.05, 0.7 * depth, 0.03), s + (height + 0.2) * Z) for s in sides(width / 2)]
    arms += [block((0.03, 0.05, 0.22), s + (height + 0.1) * Z) for s in sides(width / 2)]
    cushion = block((width, depth, rng.uniform(0.02, 0.1)), seat_height)
    turn = build.add("seat", np.concatenate([cushion, *arms[: rng.choice([0, 4])]]), lift, "revolute", axis=Z)
    rear = depth / 2 * Y + seat_height
    rest = block((width, rng.uniform(0.02, 0.08), rng.uniform(0.3, 0.7)), rear + 0.4 * Z)
    stays = bars([s + rear for s in sides(width / 3)], 0.3 * Z, thin)
    build.add("back", np.concatenate([rest, stays]), turn, "revolute", axis=-X, point=rear, limits=(-0.2, 0.5))
    return build.build()


def folding_chair(rng: Rng) -> ArticulatedObject:
    """Crossed legs on one pivot, and a seat that tips up."""
    width, depth, height = rng.uniform(0.35, 0.6, 3)
    thin, top = rng.uniform(0.01, 0.02), height + 0.5
    slope = depth * Y + top * Z  # of the front legs, which carry the back
    foot = -depth / 2 * Y
    middle, pivot = foot + 0.5 * height / top * slope, foot + height / top * slope
    rest = block((width, 0.02, 0.15), foot + 0.9 * slope)
    stiles = bars([foot + s for s in sides(width / 2)], slope, thin)
    axle = bars([middle - width / 2 * X], width * X, thin)
    build = ObjectBuilder("frame", np.concatenate([stiles, rest, axle]))
    legs = bars([0.6 * depth * Y + s for s in sides(0.45 * width)], height * Z - depth * Y, thin)
    rung = bars([np.array([-0.45 * width, 0.5 * depth, 0.1 * height])], 0.9 * width * X, thin)
    rear = np.concatenate([legs, rung])
    build.add("rear_legs", rear, 0, "revolute", axis=X, point=middle, limits=(-0.1, 0.5))
    rail = bars([pivot - width / 2 * X], width * X, thin)
    seat = np.concatenate([block((0.98 * width, depth, 0.02), pivot - 0.3 * depth * Y), rail])
    build.add("seat", seat, 0, "revolute", axis=-X, point=pivot, limits=(-0.1, 1.2))
    return build.build()


def cart(rng: Rng) -> ArticulatedObject:
    """Two or four wheels under a box, sometimes with a bar that tilts or pulls out: a pram, mower or suitcase."""
    length, width, low = rng.uniform((0.3, 0.2, 0.08), (1.0, 0.6, 0.2))
    rear = np.array([0, length / 2, low + 0.15])
    body = block((width, length, rng.uniform(0.05, 0.6)), (0, 0, low + 0.1))
    if rng.random() < 0.5:
        body = tray(rear - length * Y, np.array([width, length, 0.25]))
    rows = [np.array([0, y * length, low]) for y in (-0.4, 0.4)[: rng.integers(1, 3)]]
    axles = bars([row - (width / 2 + 0.03) * X for row in rows], (width + 0.06) * X, 0.012)
    stays = [block((0.05, 0.05, 0.2), row + s + 0.05 * Z) for row in rows for s in sides(width / 4)]
    build = ObjectBuilder("body", np.concatenate([body, axles, *stays]))
    kind = rng.choice(["disc", "rim"])
    for at in [row + s for row in rows for s in sides(width / 2 + 0.02)]:
        surface = wheel(at, X, low * rng.uniform(0.7, 1), kind, rng)
        build.add("wheel", surface, 0, "revolute", axis=X, point=at)
    up, grip_kind = rng.uniform(0.4, 1.0), rng.choice(["none", "tilts", "tilts", "pulls"])
    grip = _push_bar(rear, width, up)
    if grip_kind == "tilts":
        build.add("handle", grip, 0, "revolute", axis=-X, point=rear, limits=(-0.5, 1.0))
    elif grip_kind == "pulls":
        build.add("handle", grip, 0, "prismatic", axis=-Z, limits=(0, 0.6 * up))
    return build.build()


def _push_bar(foot: Array, width: float, up: float) -> Array:
    stiles = bars([foot + s - 0.15 * Z for s in sides(0.35 * width)], (up + 0.15) * Z, 0.012)
    return np.concatenate([stiles, bars([foot - 0.4 * width * X + z * Z for z in (up, 0)], 0.8 * width * X, 0.015)])


def _leaf(width: float, height: float, thick: float, rng: Rng) -> Array:
    """The leaf of a door: full, or a frame with bars."""
    if rng.random() < 0.6:
        return block((width, thick, height), (0, 0, height / 2))
    rails = np.linspace(0.04, height - 0.04, int(rng.integers(2, 5)))
    stiles = [block((0.08, thick, height), s + height / 2 * Z) for s in sides(width / 2 - 0.04)]
    return np.concatenate([block((width, thick, 0.08), z * Z) for z in rails] + stiles)

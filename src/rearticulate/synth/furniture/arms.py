"""Things that reach: desk lamps, monitor arms, cranes, taps, fans, mills, telescopes."""

from __future__ import annotations

import numpy as np

from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.furniture.hardware import NOTHING, Array, Rng, X, Y, Z, add_knob, wheel
from rearticulate.synth.primitives import arc, ball, bar, block, ring, tube, turned


def lamp(rng: Rng) -> ArticulatedObject:
    """A foot, a column, a chain of rods, and a shade or plate at its end."""
    reach = rng.uniform(0.2, 0.6)
    thin = rng.uniform(0.03, 0.1) * reach
    tip, parent = rng.uniform(0.2, 1.0) * reach * Z, 0
    heel = turned([(0, rng.uniform(2, 5) * thin), (1, 2 * thin)], (0, 0, 0), (0, 0, thin))
    foot = [heel, block((3 * thin, thin, thin), (2 * thin, 0, thin)), bar((0, 0, 0), tip, thin)]
    build = ObjectBuilder("foot", np.concatenate(foot))
    for k in range(int(rng.integers(1, 5))):
        end = tip + reach * rng.uniform(0.5, 1) * _polar(rng.uniform(-0.8, 1.2), rng.uniform(-0.2, 0.2))
        axis = Z if k == 0 and rng.random() < 0.5 else Y
        beside, pin = thin * rng.choice([0.0, 1.0]) * Y, 1.2 * thin * axis
        rod = bar(tip + beside, end + beside, thin * rng.uniform(0.3, 0.9, 2), sides=int(rng.choice([4, 20])))
        surface = np.concatenate([rod, bar(tip - pin, tip + pin, thin)])
        parent = build.add(f"arm_{k}", surface, parent, "revolute", axis=axis, point=tip, limits=(-1.2, 1.2))
        tip = end
    axis = X if rng.random() < 0.3 else Y
    build.add("head", _shade(tip, thin, reach, rng), parent, "revolute", axis=axis, point=tip, limits=(-0.8, 0.8))
    return build.build()


def faucet(rng: Rng) -> ArticulatedObject:
    """A spout that swings over a base, with a lever on it or one or two valves beside it."""
    size, thin = rng.uniform(0.15, 0.5), rng.uniform(0.01, 0.03)
    top = 4 * thin * Z
    valves = [s * 0.4 * size * X for s in (-1, 1)][: rng.integers(0, 3)]
    plate = np.array([rng.uniform(0.1, 0.8) * size + 2 * thin, 4 * thin, thin])
    base = [block(plate, thin / 2 * Z), bar(0 * Z, top, 1.5 * thin)]
    base += [bar(thin * Z, v + thin * Z, thin) for v in valves] + [bar(v, v + 3 * thin * Z, thin) for v in valves]
    build = ObjectBuilder("base", np.concatenate(base))
    way = arc(top, top + size * rng.uniform(0.3, 1.2) * Z - size / 2 * Y, top - size * rng.uniform(0.5, 1) * Y)
    neck = bar(top - thin * Z, top + 2 * thin * Z, 1.3 * thin)
    spout = build.add("spout", np.concatenate([tube(way, thin), neck]), 0, "revolute", axis=Z, limits=(-1.5, 1.5))
    for v in valves:
        at, out = v + 3 * thin * Z, rng.uniform(2, 6) * thin * np.sign(v)
        grip = bar(at + thin * Z, at + 2 * thin * Z + out, 0.5 * thin)
        surface = np.concatenate([bar(at, at + 1.5 * thin * Z, 1.1 * thin), grip])
        build.add("valve", surface, 0, "revolute", axis=Z, point=at, limits=(-1.5, 1.5))
    if not valves:
        at, out = top + 2 * thin * Z, rng.uniform(3, 8) * thin * (X + 0.3 * Z)
        surface = np.concatenate([bar(at, at + out, (0.4 * thin, thin), sides=4), ball(1.3 * thin, at)])
        build.add("lever", surface, spout, "revolute", axis=Y, point=at, limits=(-0.6, 0.3))
    return build.build()


def fan(rng: Rng) -> ArticulatedObject:
    """A stand, a head that pans or nods, and blades or a wheel that turn in it."""
    height, size = rng.uniform(0.2, 1.2), rng.uniform(0.1, 0.35)
    heel = turned([(0, size), (1, 0.3 * size)], (0, 0, 0), (0, 0, 0.05))
    stand = [heel, block((1.5 * size, 0.05, 0.03), (0.2 * size, 0, 0.03)), bar((0, 0, 0), (0, 0, height), 0.02)]
    build = ObjectBuilder("stand", np.concatenate(stand))
    hub = np.array([0, -0.1, height + 0.05])
    back, arm = hub + 0.05 * Y, 1.1 * size
    motor = [bar(hub + 0.2 * Y, hub, 0.05), bar((0, 0, height - 0.05), (0, 0, hub[2]), 0.03)]
    cage = [ring(arm, 0.008, hub + y * Y, Y) for y in (-0.05, 0.05)]
    cage += [bar(back - arm * d, back + arm * d, 0.005, sides=4) for d in (X, Z)]
    surface = np.concatenate([*motor, block((0.04, 0.08, 0.06), hub + 0.1 * Y + 0.06 * Z), *cage[: rng.choice([0, 4])]])
    axis = Z if rng.random() < 0.6 else X
    head = build.add("head", surface, 0, "revolute", axis=axis, point=(0, 0, height), limits=(-0.8, 0.8))
    kind = "propeller" if rng.random() < 0.7 else "rim"
    build.add("blades", wheel(hub, Y, size, kind, rng), head, "revolute", axis=Y, point=hub)
    if rng.random() < 0.4:
        add_knob(build, np.array([0, -0.02, 0.5 * height]), -Y, 0.03, rng)
    return build.build()


def telescope(rng: Rng) -> ArticulatedObject:
    """Lengths that slide into each other, perhaps with a knob on top: a jack, pen, syringe or umbrella stick."""
    radius, length = rng.uniform(0.02, 0.08), rng.uniform(0.1, 0.4)
    edges = int(rng.choice([4, 6, 20]))
    fin = block((3 * radius, 0.4 * radius, 0.3 * length), (radius, 0, 0.3 * length))
    build = ObjectBuilder("sheath", np.concatenate([bar((0, 0, 0), (0, 0, length), radius, sides=edges), fin]))
    parent, top = 0, length * Z
    for k in range(int(rng.integers(1, 5))):
        radius *= rng.uniform(0.6, 0.9)
        inner = bar(top - 0.9 * length * Z, top + 0.1 * length * Z, radius, sides=edges)
        collar = bar(top, top + 0.08 * length * Z, radius * rng.uniform(1.1, 1.6, 2), sides=4)
        surface = np.concatenate([inner, collar])
        parent = build.add(f"length_{k}", surface, parent, "prismatic", axis=Z, limits=(0, 0.75 * length))
        top = top + 0.1 * length * Z
    if rng.random() < 0.6:
        add_knob(build, top, Z, rng.uniform(1, 3) * radius, rng, parent)
    return build.build()


def _shade(tip: Array, thin: float, reach: float, rng: Rng) -> Array:
    """What a lamp holds at its tip: a shade or a plate, with a stem."""
    down = _polar(rng.uniform(-1.5, 0), 0.3)
    profile = np.array([(0, 0.5), (0.3, 1), (1, rng.uniform(0.5, 3))]) * (1, 1.5 * thin)
    plate = bar(tip, tip + thin * down, reach * rng.uniform(0.2, 0.6, 2), sides=4)
    head = turned(profile, tip - thin * down, tip + 5 * thin * down) if rng.random() < 0.6 else plate
    stem = bar(tip - thin * Z, tip + 3 * thin * Z, 0.4 * thin) if rng.random() < 0.7 else NOTHING
    return np.concatenate([head, stem])


def _polar(elevation: float, turn: float) -> Array:
    """Unit vector (3,) at an elevation above the x axis and a turn about z, rad."""
    return np.array([np.cos(elevation) * np.cos(turn), np.cos(elevation) * np.sin(turn), np.sin(elevation)])

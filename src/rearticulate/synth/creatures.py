"""Trees of random lumpy parts: arms, humanoids, quadrupeds, hands, stars and bushes that no one has ever built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rearticulate.geometry.se3 import exp_se3, rotate, transform
from rearticulate.synth.articulated import ArticulatedObject, ObjectBuilder
from rearticulate.synth.flesh import flesh
from rearticulate.synth.primitives import bar, crosswise
from rearticulate.synth.surfaces import moved
from rearticulate.synth.trajectories import random_directions

Array = NDArray[np.floating]
Rng = np.random.Generator

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])  # left to right
UP, DOWN, FORWARD, LEFT = (np.array(d, dtype=np.float64) for d in ((0, 0, 1), (0, 0, -1), (0, 1, 0), (1, 0, 0)))

JOINTS = {"bend": 0.55, "turn": 0.2, "skew": 0.05, "telescope": 0.12, "carriage": 0.08}  # shares
ENDLESS = 0.1  # share of the turning joints that have no limits
ALIGNED = 0.6  # share of the bending joints that bend about a coordinate axis, as far as the bone allows
BESIDE = 0.25  # share of the bending joints whose two bones lie side by side
SOCKET = 0.6  # share of the other bending joints with a round housing
LARGEST = 15  # parts


@dataclass(frozen=True)
class Bone:
    """A part to be, in coordinates of the rest pose. socket: what its joint adds to the surface of its parent."""

    surface: Array
    socket: Array
    start: Array
    end: Array
    kind: str
    axis: Array
    point: Array
    limits: tuple[float, float]

    def moved(self, T: Array) -> Bone:
        """The same bone at another place; T (4, 4) may mirror it, and then left and right turn symmetrically."""
        hand = np.sign(np.linalg.det(T[:3, :3])) if self.kind == "revolute" else 1.0
        start, end, point = transform(T, np.stack([self.start, self.end, self.point]))
        axis = hand * rotate(T, self.axis)
        return Bone(moved(T, self.surface), moved(T, self.socket), start, end, self.kind, axis, point, self.limits)


class Body:
    """A trunk on which limbs are hung."""

    def __init__(self, start: Array, end: Array, half: float, rng: Rng) -> None:
        rest = (np.zeros((0, 3, 3)), start, end, "", np.zeros(3), np.zeros(3), (0.0, 0.0))
        self.bones, self.parent = [Bone(flesh(start, end, half, rng, solid=True), *rest)], [-1]

    def hang(self, limb: list[Bone], parent: int = 0) -> int:
        """Hang a chain of bones on a part; returns the number of the last one."""
        for bone in limb:
            self.bones.append(bone)
            self.parent.append(parent)
            parent = len(self.bones) - 1
        return parent

    def build(self) -> ArticulatedObject:
        sockets = [[b.socket for b, p in zip(self.bones, self.parent, strict=True) if p == j] for j in range(self.size)]
        surface = [np.concatenate([b.surface, *s]) for b, s in zip(self.bones, sockets, strict=True)]
        build = ObjectBuilder("part_0", surface[0])
        for j, bone in enumerate(self.bones[1:], start=1):
            build.add(f"part_{j}", surface[j], self.parent[j], bone.kind,
                      axis=bone.axis, point=bone.point, limits=bone.limits)  # fmt: skip
        return build.build()

    @property
    def size(self) -> int:
        return len(self.bones)


def random_creature(seed: int) -> ArticulatedObject:
    """A random tree of 3 to 15 parts, 0.25 to 2.5 m large in a random posture."""
    rng = np.random.default_rng(seed)
    plans: tuple[Callable[[Rng], Body], ...] = (_arm, _humanoid, _walker, _hand, _star, _bush)
    return plans[rng.integers(len(plans))](rng).build()


def _arm(rng: Rng) -> Body:
    """A chain on a foot, and fingers at its end."""
    body = Body(np.zeros(3), rng.uniform(0.1, 0.3) * UP, rng.uniform(0.05, 0.15), rng)
    chain = _limb(body.bones[0], _tilted(UP, 0.4, rng), int(rng.integers(2, 9)), rng, bend=0.8)
    hand = body.hang(chain)
    wrist, ahead = chain[-1].end, chain[-1].end - chain[-1].start
    knuckle = wrist + rng.uniform(0.02, 0.1) * crosswise(ahead / np.linalg.norm(ahead))
    finger = _limb(chain[-1], _tilted(ahead, 0.3, rng), 1, rng, size=0.4, start=knuckle)
    for copy in _around(finger, int(rng.integers(0, 4)), wrist, ahead):
        body.hang(copy, hand)
    return body


def _humanoid(rng: Rng) -> Body:
    hip, neck = rng.uniform(0.5, 0.9) * UP, rng.uniform(1.1, 1.6) * UP
    width = rng.uniform(0.07, 0.16)
    body = Body(hip, neck, width, rng)
    chest = _place(hip, neck, rng.uniform(0.75, 1.0)) + 1.5 * width * LEFT
    arms = _limb(body.bones[0], _tilted(LEFT + 2 * DOWN, 0.6, rng), int(rng.integers(1, 4)), rng, start=chest)
    legs = _limb(body.bones[0], _tilted(DOWN, 0.2, rng), int(rng.integers(1, 4)), rng, start=hip + 0.7 * width * LEFT)
    for limb in (arms, legs):
        body.hang(limb)
        body.hang([bone.moved(MIRROR) for bone in limb])
    body.hang(_limb(body.bones[0], UP, int(rng.integers(1, 3)), rng, size=0.5, start=neck))
    return body


def _walker(rng: Rng) -> Body:
    """Two or three pairs of legs under a trunk, with or without a head and a tail."""
    length, width = rng.uniform(0.4, 1.0), rng.uniform(0.06, 0.15)
    body = Body(-length / 2 * FORWARD, length / 2 * FORWARD, width, rng)
    pairs = int(rng.integers(2, 4))
    hip = 1.2 * width * LEFT + 0.45 * length * FORWARD
    leg = _limb(body.bones[0], _tilted(DOWN, 0.7, rng), int(rng.integers(1, 5 - pairs + 1)), rng, start=hip)
    for k in range(pairs):
        back = np.eye(4)
        back[1, 3] = -0.9 * length * k / (pairs - 1)
        body.hang([bone.moved(back) for bone in leg])
        body.hang([bone.moved(MIRROR @ back) for bone in leg])
    for way in (FORWARD, -FORWARD):
        if body.size < LARGEST and rng.random() < 0.6:
            body.hang(_limb(body.bones[0], _tilted(way, 0.8, rng), 1, rng, size=0.6, start=length / 2 * way))
    return body


def _hand(rng: Rng) -> Body:
    """Fingers of one kind side by side on a palm, and a thumb."""
    width = rng.uniform(0.03, 0.07)
    body = Body(np.zeros(3), rng.uniform(0.1, 0.2) * UP, width, rng)
    fingers = int(rng.integers(2, 5))
    knuckle = body.bones[0].end + width * LEFT
    finger = _limb(body.bones[0], _tilted(UP, 0.4, rng), int(rng.integers(1, 4)), rng, size=0.4, start=knuckle)
    for k in range(fingers):
        aside = _turn(FORWARD, rng.uniform(-0.15, 0.15))
        aside[0, 3] = -2 * width * k / (fingers - 1)
        body.hang([bone.moved(aside) for bone in finger])
    aside = _place(body.bones[0].start, body.bones[0].end, 0.4) + width * LEFT
    body.hang(_limb(body.bones[0], _tilted(LEFT, 0.6, rng), int(rng.integers(1, 3)), rng, size=0.4, start=aside))
    return body


def _star(rng: Rng) -> Body:
    """The same limb several times around a hub."""
    body = Body(-0.1 * UP, 0.1 * UP, rng.uniform(0.06, 0.15), rng)
    arms = int(rng.integers(3, 7))
    limb = _limb(body.bones[0], _tilted(LEFT, 0.6, rng), int(rng.integers(1, (LARGEST - 1) // arms + 1)), rng,
                 start=rng.uniform(0.05, 0.25) * LEFT)  # fmt: skip
    for arm in _around(limb, arms, np.zeros(3), UP):
        body.hang(arm)
    return body


def _bush(rng: Rng) -> Body:
    """Each bone grows out of a random earlier one."""
    body = Body(np.zeros(3), rng.uniform(0.1, 0.4) * random_directions(1, rng)[0], rng.uniform(0.06, 0.15), rng)
    for _ in range(int(rng.integers(2, LARGEST))):
        parent = int(rng.integers(max(0, body.size - 4), body.size))
        body.hang(_limb(body.bones[parent], random_directions(1, rng)[0], 1, rng), parent)
    return body


def _limb(parent: Bone, along: Array, bones: int, rng: Rng, *,
          start: Array | None = None, size: float = 1.0, bend: float = 0.4) -> list[Bone]:  # fmt: skip
    """A chain of bones that grows from `start` (by default the end of `parent`), first along a direction (3,).

    size: share of the usual length of a bone, 0.15 to 0.45 m. bend: largest angle between successive bones, rad.
    """
    chain: list[Bone] = []
    half = size * rng.uniform(0.02, 0.07)
    for _ in range(bones):
        chain.append(_bone(parent, along, size * rng.uniform(0.15, 0.45), half, rng, start))
        parent, start = chain[-1], None
        half *= rng.uniform(0.75, 1.0)
        along = _tilted(parent.end - parent.start, bend, rng)
    return chain


def _bone(parent: Bone, along: Array, length: float, half: float, rng: Rng, start: Array | None) -> Bone:
    along = along / np.linalg.norm(along)
    rail, origin = parent.end - parent.start, parent.end if start is None else start
    nearest = parent.start + np.clip((origin - parent.start) @ rail / (rail @ rail), 0, 1) * rail
    socket = [bar(nearest, origin, half)] if np.linalg.norm(origin - nearest) > half / 2 else []
    how = rng.choice(list(JOINTS), p=list(JOINTS.values())) if start is None else "bend"
    axis, limits = _joint(str(how), along, length, rail, rng)
    foot = origin
    if how == "bend":
        away = rng.choice([-1, 1]) * half * axis  # some bones bend beside the end of the one that carries them
        beside = rng.random() < BESIDE
        foot = origin + 2.2 * beside * away
        if beside or rng.random() < SOCKET:
            socket.append(bar(origin - 1.2 * away, foot + 1.2 * away, rng.uniform(0.9, 1.4) * half))
    end = foot + length * along
    kind = "revolute" if how in ("bend", "turn", "skew") else "prismatic"
    surface = flesh(foot, end, half, rng)
    return Bone(surface, np.concatenate([np.zeros((0, 3, 3)), *socket]), foot, end, kind, axis, origin, limits)


def _joint(how: str, along: Array, length: float, rail: Array, rng: Rng) -> tuple[Array, tuple[float, float]]:
    """Axis (3,) and limits of a joint of a bone that lies along a direction; `rail` (3,) is the bone that carries it.

    The foot of the bone stays where the two overlap: a telescope goes in, a carriage goes back along the rail.
    """
    if how == "telescope":
        return along, (-rng.uniform(0.2, 0.6) * length, 0.0)
    if how == "carriage":
        return rail / np.linalg.norm(rail), (-rng.uniform(0.4, 0.9) * float(np.linalg.norm(rail)), 0.0)
    limits = (-rng.uniform(0.3, 1.6), rng.uniform(0.3, 1.6))
    if rng.random() < ENDLESS:
        limits = (-np.inf, np.inf)
    hint = random_directions(1, rng)[0]
    if how == "skew":
        return hint, limits
    if how == "turn":
        return along, limits
    return crosswise(along, np.eye(3)[rng.integers(3)] if rng.random() < ALIGNED else hint), limits


def _tilted(direction: Array, most: float, rng: Rng) -> Array:
    """The direction (3,), turned by up to `most` rad."""
    unit = direction / np.linalg.norm(direction)
    return rotate(_turn(crosswise(unit, random_directions(1, rng)[0]), rng.uniform(0, most)), unit)


def _turn(axis: Array, angle: float) -> Array:
    """(4, 4) turn about an axis (3,) through the origin, rad."""
    return exp_se3(np.concatenate([angle * axis, np.zeros(3)]))


def _around(limb: list[Bone], copies: int, centre: Array, axis: Array) -> list[list[Bone]]:
    """Copies of a limb, evenly spaced about the line through `centre` along `axis` (3,)."""
    there, back = np.eye(4), np.eye(4)
    there[:3, 3], back[:3, 3] = centre, -centre
    turns = [there @ _turn(axis / np.linalg.norm(axis), 2 * np.pi * k / copies) @ back for k in range(copies)]
    return [[bone.moved(T) for bone in limb] for T in turns]


def _place(a: Array, b: Array, share: float) -> Array:
    return a + share * (b - a)

"""A robot from a fitted model: bodies for all parts, single-valued joints with limits, shapes with room to move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rearticulate.export.clearing import cleared
from rearticulate.export.names import safe_names
from rearticulate.export.robot import ExportConfig, Link, Robot
from rearticulate.io.palette import part_colors
from rearticulate.parallel import side_by_side
from rearticulate.posing.fuse import fuse
from rearticulate.posing.single import single_valued
from rearticulate.records import FitResult, KinematicModel, PointSequence
from rearticulate.shape.body import Body, ShapeConfig, make_body

Array = NDArray[np.floating]

FULL_TURN = 2 * np.pi


def make_robot(result: FitResult, sequence: PointSequence, name: str, config: ExportConfig) -> Robot:
    """Bodies for all parts, three hinges for every ball joint, and room for them to move."""
    model, clouds = result.model, fuse(result, sequence)
    single = single_valued(model)
    q = single.hinges(result.motion.q)
    bodies = dict(zip(single.number.tolist(), make_bodies(model, clouds, config.shape), strict=True))
    owner = dict(zip(single.number.tolist(), part_colors(model.n_parts), strict=True))
    names = safe_names(single.model.names)
    links = [
        _link(single.model, k, names[k], q[:, k], bodies.get(k), owner.get(k, np.full(3, 128, dtype=np.uint8)), config)
        for k in range(single.model.n_parts)
    ]
    robot = Robot(
        name=safe_names([name])[0],
        links=tuple(links),
        floating=config.floating,
        q=q,
        T_world_root=result.motion.T_world_root,
        canonical=model.canonical,
        clouds=clouds,
    )
    return cleared(robot)


def _link(
    model: KinematicModel,
    k: int,
    name: str,
    q: Array,
    body: Body | None,
    color: NDArray[np.uint8],
    config: ExportConfig,
) -> Link:
    """One link; its body is brought to its own frame."""
    origin = model.origin[k] if k else np.zeros(3)
    kind, low, high = model.joint_type[k], float(q.min()), float(q.max())
    extra = config.margin * (high - low)
    turns_freely = kind == "revolute" and high - low + 2 * extra >= FULL_TURN
    return Link(
        name=name,
        parent=int(model.parent[k]),
        origin=origin,
        kind="continuous" if turns_freely else kind if kind in ("revolute", "prismatic") else "fixed",
        axis=model.axis[k],
        limits=(low - extra, high + extra),
        body=None if body is None else moved(body, -origin),
        color=color,
    )


def moved(body: Body, shift: Array) -> Body:
    """The body in coordinates whose origin lies at -shift."""
    return replace(
        body,
        surface=body.surface.copy().apply_translation(shift),
        pieces=tuple(piece.copy().apply_translation(shift) for piece in body.pieces),
        centre=body.centre + shift,
    )


def make_bodies(model: KinematicModel, clouds: Sequence[Array], config: ShapeConfig) -> list[Body]:
    """One a part, on all cores, the largest first."""
    size = float(np.linalg.norm(np.ptp(model.points, axis=0))) or 1.0
    order = np.argsort([-len(cloud) for cloud in clouds], kind="stable")
    work = partial(_body, size, config)
    found = side_by_side(work, work, [(clouds[p], model.origin[p]) for p in order])
    return [found[k] for k in np.argsort(order)]


def _body(size: float, config: ShapeConfig, part: tuple[Array, Array]) -> Body:
    return make_body(*part, size=size, config=config)

"""Ball joints as three hinges in a row: what a solver, or a format, that knows one value a joint can work with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from rearticulate.geometry.se3 import exp_se3, log_so3
from rearticulate.records import Array, IntArray, JointType, KinematicModel

AXES = np.eye(3)


@dataclass(frozen=True)
class SingleValued:
    """model: the same object with hinges about x, y and z in place of every ball joint. The first two carry links
    without points, the third the part. number: (P,) of each part of the original in it."""

    original: KinematicModel
    model: KinematicModel
    number: IntArray

    def hinges(self, q: Array) -> Array:
        """Joint values (F, D) of the original -> (F, P') of the hinges."""
        own = self.original
        out = np.zeros((len(q), self.model.n_parts))
        for j, k in enumerate(self.number):
            if own.joint_type[j] == "spherical":
                out[:, k - 2 : k + 1] = Rotation.from_rotvec(q[:, own.values(j)]).as_euler("XYZ")
            else:
                out[:, k] = q[:, j]
        return out

    def back(self, q: Array) -> Array:
        """Joint values (P',) of the hinges -> (D,) of the original."""
        own = self.original
        out = np.zeros(own.n_values)
        for j, k in enumerate(self.number):
            if own.joint_type[j] == "spherical":
                turns = np.zeros((3, 6))
                turns[:, :3] = q[k - 2 : k + 1, None] * AXES
                x, y, z = exp_se3(turns)[:, :3, :3]
                out[own.values(j)] = log_so3(x @ y @ z)
            else:
                out[j] = q[k]
        return out


def single_valued(model: KinematicModel) -> SingleValued:
    """The model without ball joints; one that has none stays as it is."""
    number = np.zeros(model.n_parts, dtype=np.int64)
    links: list[Link] = []
    for j, kind in enumerate(model.joint_type):
        above = int(number[model.parent[j]]) if j else -1
        if kind == "spherical":
            limits = np.array([-1.0, 1.0]) * model.limits[j, 1]
            for letter, axis in zip("xyz", AXES, strict=True):
                name = model.names[j] if letter == "z" else f"{model.names[j]}.{letter}"
                links.append(Link(j, above, name, "revolute", axis, limits))
                above = len(links) - 1
        else:
            links.append(Link(j, above, model.names[j], kind, model.axis[j], model.limits[j]))
        number[j] = len(links) - 1
    hinges = replace(
        model,
        parent=np.array([link.parent for link in links]),
        joint_type=tuple(link.kind for link in links),
        axis=np.array([link.axis for link in links]),
        origin=model.origin[[link.part for link in links]],
        limits=np.array([link.limits for link in links]),
        names=tuple(link.name for link in links),
        labels=number[model.labels],
    )
    return SingleValued(model, hinges, number)


@dataclass(frozen=True)
class Link:
    """A part to be. part: whose joint it takes over."""

    part: int
    parent: int
    name: str
    kind: JointType
    axis: Array
    limits: Array

"""A part as a rigid body: a surface to look at, convex pieces to touch, a mass to move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
import trimesh
from numpy.typing import NDArray

from rearticulate.bounds import Bounds, Settings
from rearticulate.shape.surface import simplified, surface

Array = NDArray[np.floating]

FLAT = 0.004  # least thickness of a body, of the object's size
HULL_FILLS = 1.1  # a hull with at most this many times the volume of the surface stands for it
COARSE = 300  # triangles that are cut into convex pieces
SLIVER = 1e-4  # least thickness of a convex piece, of its length
SEED = 0


@dataclass(frozen=True)
class ShapeConfig(Settings):
    """What bodies look like.

    max_faces:  triangles of one surface. density: kg/m^3 (1000: water; hollow machines weigh less than they look).
    collision:  "pieces": convex pieces where the hull is much larger than the body; "hull": one hull a part.
    max_pieces: of one part. concavity: how far pieces may bridge, of the part's size (CoACD's threshold).
    """

    max_faces: Annotated[int, Bounds(100, 10**7)] = 4000
    density: Annotated[float, Bounds(0, 1e6, open=True)] = 500.0
    collision: Literal["pieces", "hull"] = "pieces"
    max_pieces: Annotated[int, Bounds(1, 1000)] = 12
    concavity: Annotated[float, Bounds(0.01, 1)] = 0.2


@dataclass(frozen=True)
class Body:
    """surface: closed, outward normals; pieces: convex; both in canonical coordinates, m. mass: kg. centre: (3,) of
    mass. inertia: (3, 3) about it, kg m^2, positive definite. note: what had to be made up, if anything. cut: share of
    the volume of the pieces that gave way to other bodies."""

    surface: trimesh.Trimesh
    pieces: tuple[trimesh.Trimesh, ...]
    mass: float
    centre: Array
    inertia: Array
    note: str = ""
    cut: float = 0.0


def make_body(points: Array, place: Array, size: float, config: ShapeConfig) -> Body:
    """Body of a part from its points (M, 3) of all frames.

    place: (3,) where a part without points is put. size: of the whole object, m.
    """
    mesh, note = surface(points, config.max_faces) if len(points) else None, ""
    if mesh is None or not sound(mesh, size):
        mesh = thick_hull(points if len(points) else place[None], FLAT * size)
        note = "its points span no volume: a thickened hull" if len(points) else "it has no points: a small stand-in"
    pieces = convex_pieces(mesh, config)
    solid = mesh if sound(mesh, size) else trimesh.util.concatenate(list(pieces))
    properties = solid.mass_properties  # type: ignore[union-attr]
    return Body(
        surface=mesh,
        pieces=pieces,
        mass=float(config.density * properties.volume),
        centre=np.asarray(properties.center_mass),
        inertia=config.density * np.asarray(properties.inertia),
        note=note,
    )


def sound(mesh: trimesh.Trimesh, size: float) -> bool:
    """Closed, and thick enough in all directions for a simulator."""
    if len(mesh.vertices) < 4 or not mesh.is_watertight:
        return False
    return bool(mesh.volume > 0 and mesh.bounding_box_oriented.primitive.extents.min() > 0.25 * FLAT * size)


def thick_hull(points: Array, thickness: float) -> trimesh.Trimesh:
    """Convex hull of points (M, 3) with a small octahedron around each: it has a volume whatever the points are."""
    corners = np.concatenate([np.eye(3), -np.eye(3)]) * thickness / 2
    return trimesh.convex.convex_hull((points[:, None] + corners).reshape(-1, 3))


def convex_pieces(mesh: trimesh.Trimesh, config: ShapeConfig) -> tuple[trimesh.Trimesh, ...]:
    """The hull where it fits, else an approximate convex decomposition (Wei et al., CoACD, SIGGRAPH 2022)."""
    hull = mesh.convex_hull
    if config.collision == "hull" or hull.volume <= HULL_FILLS * abs(mesh.volume):
        return (hull,)
    import coacd

    coacd.set_log_level("error")
    coarse = simplified(mesh, COARSE, 1e-3 * mesh.scale)
    found = coacd.run_coacd(
        coacd.Mesh(coarse.vertices, coarse.faces),
        threshold=config.concavity,
        max_convex_hull=config.max_pieces,
        preprocess_mode="off",  # the mesh is closed already
        resolution=300,
        mcts_nodes=10,
        mcts_iterations=20,
        mcts_max_depth=2,
        seed=SEED,
    )
    pieces = [hull_of(np.asarray(vertices)) for vertices, _ in found]
    return grown([piece for piece in pieces if piece is not None] or [hull], np.asarray(mesh.vertices))


def grown(pieces: Sequence[trimesh.Trimesh], points: Array) -> tuple[trimesh.Trimesh, ...]:
    """Convex pieces that hold all points (M, 3): every point joins the piece that it is in or nearest to. Pieces of a
    coarse mesh miss what the coarse mesh has lost."""
    outside = [beyond(piece, points) for piece in pieces]
    nearest = np.argmin(outside, axis=0)
    return tuple(
        trimesh.convex.convex_hull(np.concatenate([piece.vertices, points[nearest == k]]))
        for k, piece in enumerate(pieces)
    )


def beyond(piece: trimesh.Trimesh, points: Array) -> Array:
    """(M,) how far points are beyond the farthest plane of a convex piece; negative inside."""
    return (points @ piece.face_normals.T - np.einsum("fi,fi->f", piece.face_normals, piece.triangles[:, 0])).max(
        axis=1
    )


def hull_of(points: Array) -> trimesh.Trimesh | None:
    """Convex hull of points (M, 3); None where they span no volume, as slivers between two cuts do."""
    if len(points) < 4:
        return None
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return trimesh.convex.convex_hull(points) if extent[2] > SLIVER * extent[0] else None

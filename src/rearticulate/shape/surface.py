"""A closed surface around the points of a part: a ball that rolls over the points from outside, its radius just too
large to fall through their gaps (morphological closing: Serra 1982; for points: Bernardini et al. 1999).

Normals are not needed, so neither sheets nor hidden inner walls can turn the surface inside out, and it is always
closed. Cavities that the ball cannot reach become solid; a wall scanned from one side becomes a thin sheet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy import ndimage

from rearticulate.geometry.nearest import nearest, search_tree

if TYPE_CHECKING:
    import manifold3d

Array = NDArray[np.floating]

NEIGHBOUR = 6
GAP = 2.0  # radius of the ball, in distances to the 6th neighbour: it passes no gap of a randomly sampled surface
CELL = 0.25  # side of a grid cell, in radii
SHEET = 0.75  # half the thickness of a wall that has only one side, in cells
MAX_CELLS = 4_000_000
SPECK = 0.02  # pieces with a smaller share of the surface are left out
FEW_HANDLES = 2  # that a part may have without a question
GROWTH, GROWTHS = 1.4, 3  # of a ball that pierces walls: the factor, and how often
SMOOTHING = 10  # iterations (Taubin 1995)
TOLERANCE, COARSER = 0.05, 1.4  # of the surface when it is simplified, in cells; and by how much it grows


def surface(points: Array, max_faces: int) -> trimesh.Trimesh | None:
    """Closed mesh around points (M, 3), outward normals, at most about `max_faces` triangles; None where the points
    span no volume."""
    if len(points) <= NEIGHBOUR or not (radius := ball_radius(points)):
        return None
    grid, mesh = unpierced(points, radius)
    if mesh is None:
        return None
    mesh = onto_points(mesh, points, grid)
    trimesh.smoothing.filter_taubin(mesh, iterations=SMOOTHING)
    return simplified(mesh, max_faces, TOLERANCE * grid.cell)


def unpierced(points: Array, radius: float) -> tuple[Grid, trimesh.Trimesh | None]:
    """The closing by the smallest ball that does not pierce it.

    A ball sinks into the gaps of a thin wall from both sides, and may meet itself there. A larger one sinks less: while
    many handles vanish as it grows, they were such holes; those that stay are the object's own.
    """
    grid = Grid.around(points, radius)
    mesh = _closed(points, grid)
    for _ in range(GROWTHS):
        if mesh is None or handles(mesh) <= FEW_HANDLES:
            break
        wider = Grid.around(points, GROWTH * grid.radius)
        other = _closed(points, wider)
        if other is None or handles(other) >= handles(mesh) - FEW_HANDLES:
            break
        grid, mesh = wider, other
    return grid, mesh


def handles(mesh: trimesh.Trimesh) -> int:
    """Of a closed mesh: 0 of a ball or a cup, 1 of a ring."""
    return mesh.body_count - mesh.euler_number // 2


def _closed(points: Array, grid: Grid) -> trimesh.Trimesh | None:
    mesh = closing(points, grid)
    return None if mesh is None else without_specks(mesh)


def ball_radius(points: Array) -> float:
    """Of a ball that cannot fall through, m."""
    return GAP * float(np.median(nearest(search_tree(points), points, k=NEIGHBOUR + 1)[0][:, -1]))


@dataclass(frozen=True)
class Grid:
    """low: (3,) first node. shape: nodes along x, y, z. cell: distance between nodes, m. radius: of the ball, m."""

    low: Array
    shape: tuple[int, int, int]
    cell: float
    radius: float

    @staticmethod
    def around(points: Array, radius: float) -> Grid:
        """Cells of a quarter radius, or larger ones where there would be too many."""
        low, high = points.min(axis=0), points.max(axis=0)
        while True:
            cell = CELL * radius
            margin = radius + 2 * cell
            shape = np.ceil((high - low + 2 * margin) / cell).astype(int) + 1
            if shape.prod() <= MAX_CELLS:
                return Grid(low - margin, tuple(int(n) for n in shape), cell, radius)  # type: ignore[arg-type]
            radius *= 1.1

    def nodes(self, where: NDArray[np.bool_]) -> Array:
        """(n, 3) coordinates of some nodes."""
        return self.low + self.cell * np.argwhere(where)

    def contour(self, field: Array) -> trimesh.Trimesh:
        """Where a field over the nodes is zero; negative inside."""
        from skimage.measure import marching_cubes

        vertices, faces, _, _ = marching_cubes(field, 0.0, gradient_direction="descent")
        return trimesh.Trimesh(self.low + self.cell * vertices, faces, process=False)


def closing(points: Array, grid: Grid) -> trimesh.Trimesh | None:
    """What the ball cannot enter: all within a radius of the points is outside for its centre; back by a radius."""
    everywhere = np.ones(grid.shape, dtype=bool)
    distance = nearest(search_tree(points), grid.nodes(everywhere), within=grid.radius + 2 * grid.cell)[0]
    distance = np.minimum(distance, grid.radius + 2 * grid.cell).reshape(grid.shape)
    free = distance > grid.radius
    regions = np.asarray(ndimage.label(free)[0])  # type: ignore[index]
    outside = regions == regions[0, 0, 0]
    offset = grid.contour(np.where(outside | ~free, distance - grid.radius, -grid.cell))
    depth = np.zeros(grid.shape)
    deep = grid.radius + grid.cell
    depth[~outside] = np.minimum(nearest(search_tree(offset.vertices), grid.nodes(~outside), within=deep)[0], deep)
    field = grid.radius - SHEET * grid.cell - depth
    return grid.contour(field) if field.min() < 0 else None


def without_specks(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The pieces that have a share of the surface worth having."""
    pieces = mesh.split(only_watertight=False)
    total = sum(piece.area for piece in pieces)
    return trimesh.util.concatenate([piece for piece in pieces if piece.area >= SPECK * total])  # type: ignore


def onto_points(mesh: trimesh.Trimesh, points: Array, grid: Grid) -> trimesh.Trimesh:
    """Vertices along their normals to the middle of the nearest points, but never so far that a sheet vanishes."""
    index = nearest(search_tree(points), mesh.vertices, k=NEIGHBOUR)[1]
    normals = mesh.vertex_normals
    offset = np.einsum("vki,vi->v", points[index] - mesh.vertices[:, None], normals) / NEIGHBOUR
    most = SHEET * grid.cell
    step = np.clip(offset, -0.67 * most, most)
    return trimesh.Trimesh(mesh.vertices + step[:, None] * normals, mesh.faces, process=False)


def simplified(mesh: trimesh.Trimesh, max_faces: int, tolerance: float) -> trimesh.Trimesh:
    """With edges collapsed that do not matter by a tolerance, m, or by a larger one until there are few enough; still
    closed."""
    body = solid(mesh)
    while body.num_tri() > max_faces:
        body = body.simplify(tolerance)
        tolerance *= COARSER
    found = body.to_mesh()
    return trimesh.Trimesh(found.vert_properties[:, :3].astype(np.float64), found.tri_verts, process=False)


def solid(mesh: trimesh.Trimesh) -> manifold3d.Manifold:
    """A closed mesh for exact cuts."""
    import manifold3d

    return manifold3d.Manifold(
        manifold3d.Mesh(mesh.vertices.astype(np.float32), np.asarray(mesh.faces, dtype=np.uint32))
    )


def meet(one: manifold3d.Manifold, two: manifold3d.Manifold, T_one_two: Array) -> bool:
    """Whether a body and another one, moved by T (4, 4), have any room in common."""
    return not (one ^ two.transform(np.asarray(T_one_two[:3], dtype=np.float64))).is_empty()

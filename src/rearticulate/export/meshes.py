"""The mesh files that a URDF and an MJCF share, in a folder beside them."""

from __future__ import annotations

from pathlib import Path

from rearticulate.export.robot import Link, Robot

FOLDER = "meshes"


def visual_file(link: Link) -> str:
    """Relative to the description."""
    return f"{FOLDER}/{link.name}.obj"


def collision_file(link: Link, piece: int) -> str:
    return f"{FOLDER}/{link.name}_collision_{piece}.obj"


def write_meshes(robot: Robot, folder: Path) -> None:
    """All surfaces and convex pieces, each in the frame of its link."""
    (folder / FOLDER).mkdir(exist_ok=True)
    for link in robot.links:
        if link.body is not None:
            link.body.surface.export(folder / visual_file(link), header=None, include_normals=True)
            for i, piece in enumerate(link.body.pieces):
                piece.export(folder / collision_file(link, i), header=None, include_normals=False)

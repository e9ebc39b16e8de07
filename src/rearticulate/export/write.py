"""All formats of an export, written into one folder, whole or not at all."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.errors import InputError
from rearticulate.export.build import make_robot
from rearticulate.export.meshes import write_meshes
from rearticulate.export.names import joint_name
from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.io.atomic import atomic_folder
from rearticulate.io.ply import write_cloud
from rearticulate.records import FitResult, PointSequence

MARK = "export.json"  # in every folder that we wrote, and may replace
FORMATS = ("urdf", "mjcf", "usd", "gltf", "ply")
NEEDS_MESHES = {"urdf", "mjcf"}


def save_robot(
    folder: str | os.PathLike[str],
    result: FitResult,
    sequence: PointSequence,
    *,
    name: str = "robot",
    formats: Sequence[str] = FORMATS,
    config: ExportConfig | None = None,
) -> tuple[list[Path], dict[str, Any]]:
    """Write a result for simulators and viewers: the whole folder at once, an earlier one is replaced.

    Returns the main file of each format, relative to the folder, and what `describe` says of the robot.
    """
    config = config or ExportConfig()
    with atomic_folder(folder) as partial:
        robot = make_robot(result, sequence, name, config)
        files = [path.relative_to(partial) for path in export(robot, partial, formats, config)]
        facts = describe(robot, config)
        (partial / MARK).write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    return files, facts


def describe(robot: Robot, config: ExportConfig) -> dict[str, Any]:
    """What was written, in plain numbers."""
    links = [
        {
            "name": link.name,
            "parent": None if link.parent < 0 else robot.links[link.parent].name,
            "joint": None if link.parent < 0 else link.kind,
            "limits": [float(x) for x in link.limits],
            "mass_kg": 0.0 if link.body is None else link.body.mass,
            "faces": 0 if link.body is None else len(link.body.surface.faces),
            "pieces": 0 if link.body is None else len(link.body.pieces),
            "collision_cut": 0.0 if link.body is None else round(link.body.cut, 4),
            "note": "" if link.body is None else link.body.note,
        }
        for link in robot.links
    ]
    touches = [
        {
            "links": [robot.links[touch.a].name, robot.links[touch.b].name],
            "joint": joint_name(robot.links[touch.joint].name),
            "values": [float(x) for x in touch.values],
        }
        for touch in robot.touches
    ]
    return {"name": robot.name, "links": links, "touches": touches, "config": dataclasses.asdict(config)}


def export(robot: Robot, folder: Path, formats: Sequence[str], config: ExportConfig) -> list[Path]:
    """Write the formats into an existing folder; returns the main file of each."""
    unknown = [name for name in formats if name not in FORMATS]
    if unknown:
        raise InputError(f"there is no format {unknown[0]!r}; there are {', '.join(FORMATS)}")
    if NEEDS_MESHES & set(formats):
        write_meshes(robot, folder)
    return [_WRITERS[name](robot, folder, config) for name in formats]


def _urdf(robot: Robot, folder: Path, config: ExportConfig) -> Path:
    from rearticulate.export.urdf import urdf

    return _text(folder / f"{robot.name}.urdf", urdf(robot, config))


def _mjcf(robot: Robot, folder: Path, config: ExportConfig) -> Path:
    from rearticulate.export.mjcf import mjcf

    return _text(folder / f"{robot.name}.xml", mjcf(robot, config))


def _usd(robot: Robot, folder: Path, config: ExportConfig) -> Path:
    from rearticulate.export.usd import write_usd

    path = folder / f"{robot.name}.usdc"
    write_usd(path, robot, config)
    return path


def _gltf(robot: Robot, folder: Path, config: ExportConfig) -> Path:
    from rearticulate.export.gltf import write_gltf

    path = folder / f"{robot.name}.glb"
    write_gltf(path, robot, config)
    return path


def _ply(robot: Robot, folder: Path, config: ExportConfig) -> Path:
    """The points of all frames in the rest pose, a file a part."""
    clouds = folder / "parts"
    clouds.mkdir(exist_ok=True)
    solid = [link for link in robot.links if link.body is not None]
    for link, cloud in zip(solid, robot.clouds, strict=True):
        write_cloud(clouds / f"{link.name}.ply", cloud, np.tile(link.color, (len(cloud), 1)))
    return clouds


def _text(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


_WRITERS = {"urdf": _urdf, "mjcf": _mjcf, "usd": _usd, "gltf": _gltf, "ply": _ply}

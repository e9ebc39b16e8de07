"""What a fitted model is worth to its users: exports in real simulators, clicks, new scans, clips. Needs the extra
`dev` (MuJoCo)."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yourdfpy

from rearticulate.bench.dynamics import gate
from rearticulate.bench.khronos import validate
from rearticulate.bench.referees import referees
from rearticulate.export.build import make_robot
from rearticulate.export.mjcf import mjcf
from rearticulate.export.robot import ExportConfig, Robot
from rearticulate.export.write import FORMATS, export
from rearticulate.geometry.nearest import nearest, search_tree
from rearticulate.geometry.se3 import inverse, transform
from rearticulate.localization.localize import track
from rearticulate.records import Array, FitResult, GroundTruth, KinematicModel, PointSequence
from rearticulate.render.clip import film, write_clip
from rearticulate.render.panels import PANELS, PanelData, novel_posture
from rearticulate.render.viewpoint import best_view
from rearticulate.retargeting.retarget import retarget

mujoco: Any = import_module("mujoco")  # these two have no types
usd, usd_validation = (import_module(f"pxr.{name}") for name in ("Usd", "UsdValidation"))

POSTURES = 100
STEPS, HOLD = 2000, 100  # of the simulator; how long it is told the same
SAMPLES = 6000  # points on the surfaces of a posed export
CLICKS = 15
REPEATS = 20
SEEN_FROM = 3  # the frame whose points are moved to a novel posture, to be a new scan


def use(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> dict[str, float]:
    """All measures of one object."""
    with tempfile.TemporaryDirectory() as folder:
        return {
            **exports(result, sequence, Path(folder)),
            **clicks(result),
            **new_scans(result, truth, sequence),
            **clip(result, sequence, Path(folder)),
        }


def exports(result: FitResult, sequence: PointSequence, folder: Path) -> dict[str, float]:
    """Time, what loads, forward kinematics against ours (m), steps, and the recording played back against the input."""
    config = ExportConfig(floating=False)
    started = time.perf_counter()
    robot = make_robot(result, sequence, "robot", config)
    export(robot, folder, FORMATS, config)
    seconds = time.perf_counter() - started
    (folder / "floating.xml").write_text(mjcf(replace(robot, floating=True), config), encoding="utf-8")
    files = [mujoco.MjModel.from_xml_path(str(folder / name)) for name in ("robot.urdf", "robot.xml")]
    stage = usd.Stage.Open(str(folder / "robot.usdc"))
    registry = usd_validation.ValidationRegistry()
    validators = registry.GetOrLoadValidatorsByName([found.name for found in registry.GetAllValidatorMetadata()])
    scene = trimesh.load_scene(folder / "robot.glb")
    urdf = yourdfpy.URDF.load(str(folder / "robot.urdf"))
    bodies = sum(link.body is not None for link in robot.links)
    return {
        "export_s": seconds,
        "usd_errors": len(usd_validation.ValidationContext(validators).Validate(stage)),
        "glb_missing": bodies - len(scene.geometry),
        **khronos(folder / "robot.glb"),
        "urdf_errors": len(urdf.errors) + (not urdf.validate()),
        "not_closed": sum(link.body is not None and not link.body.surface.is_watertight for link in robot.links),
        "kinematics_m": max(kinematic_error(robot, model) for model in files),
        "bad_steps": bad_steps(files[1]),
        **dynamics(robot, folder),
        **playback(robot, mujoco.MjModel.from_xml_path(str(folder / "floating.xml")), sequence),
    }


def dynamics(robot: Robot, folder: Path) -> dict[str, float]:
    """What the simulators say of the export ("ENGINE.measure", see `dynamics.measure`), how many convex pieces it has,
    the largest share of a link's that was cut away, and how many pairs of links meet over some range."""
    bodies = [link.body for link in robot.links if link.body is not None]
    found = {f"{engine}.{key}": value for engine, told in gate(robot, folder).items() for key, value in told.items()}
    cut = {"pieces": sum(len(body.pieces) for body in bodies), "cut": max(body.cut for body in bodies)}
    told = referees(folder / f"{robot.name}.urdf")
    return {**found, **told, **cut, "touches": len({(touch.a, touch.b) for touch in robot.touches})}


def khronos(path: Path) -> dict[str, float]:
    """Errors and warnings of the Khronos validator, where npm can install it."""
    told = validate(path)
    return {} if told is None else {"glb_errors": told["numErrors"] + told["numWarnings"]}


def kinematic_error(robot: Robot, model: Any) -> float:
    """Largest distance of a body, or of the ends of its axes 1 m away, from where we say, over random postures, m."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    links = [j for j, link in enumerate(robot.links) if link.body is not None]
    bodies = [model.body(robot.links[j].name).id for j in links]
    address = [model.joint(f"{robot.links[j].name}_joint").qposadr[0] for j in robot.joints]
    worst = 0.0
    for _ in range(POSTURES):
        q = np.zeros(len(robot.links))
        q[robot.joints] = [rng.uniform(*robot.links[j].limits) for j in robot.joints]
        data.qpos[address] = q[robot.joints]
        mujoco.mj_kinematics(model, data)
        T = robot.forward(q)[links]
        shift = np.linalg.norm(data.xpos[bodies] - T[:, :3, 3], axis=-1)
        turn = np.linalg.norm(data.xmat[bodies].reshape(-1, 3, 3) - T[:, :3, :3], axis=-2).max(axis=-1)
        worst = max(worst, float((shift + turn).max()))
    return worst


def bad_steps(model: Any) -> int:
    """Warnings and numbers that are not finite in 2,000 steps under gravity and random controls."""
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for step in range(STEPS):
        if step % HOLD == 0 and model.nu:
            data.ctrl[:] = rng.uniform(*model.actuator_ctrlrange.T)
        mujoco.mj_step(model, data)
    broken = ~np.isfinite(data.qpos).all() + ~np.isfinite(data.qvel).all()
    return int(sum(warning.number for warning in data.warning) + broken)


def playback(robot: Robot, model: Any, sequence: PointSequence) -> dict[str, float]:
    """The keyframes in MuJoCo against the measured frames: mean distance both ways, mm, and between neighbouring
    measured points, which is what sampling alone costs."""
    data, solid = mujoco.MjData(model), [link for link in robot.links if link.body is not None]
    weights = np.array([link.body.surface.area for link in solid if link.body is not None])
    counts = np.maximum(SAMPLES * weights / weights.sum(), 20).astype(int)
    clouds = [
        trimesh.sample.sample_surface(link.body.surface, count, seed=0)[0]
        for link, count in zip(solid, counts, strict=True)
        if link.body is not None
    ]
    there, back, apart = [], [], []
    for f, measured in enumerate(sequence.points):
        mujoco.mj_resetDataKeyframe(model, data, f)
        mujoco.mj_kinematics(model, data)
        posed = np.concatenate(
            [
                cloud @ data.body(link.name).xmat.reshape(3, 3).T + data.body(link.name).xpos
                for link, cloud in zip(solid, clouds, strict=True)
            ]
        )
        there.append(nearest(search_tree(posed), measured)[0].mean())
        back.append(nearest(search_tree(measured), posed)[0].mean())
        apart.append(nearest(search_tree(measured), measured, k=2)[0][:, 1].mean())
    return {
        "measured_to_export_mm": 1000 * float(np.mean(there)),
        "export_to_measured_mm": 1000 * float(np.mean(back)),
        "spacing_mm": 1000 * float(np.mean(apart)),
    }


def clicks(result: FitResult) -> dict[str, float]:
    """Up to 15 points of all parts, dragged to a posture within the observed ranges: time of one solution after warm-up
    (median, ms) and distance that remains (mean, mm)."""
    model = result.model
    order = np.random.default_rng(0).permutation(len(model.points))
    first = [order[model.labels[order] == p][:1] for p in range(model.n_parts)]
    rows = np.concatenate([*first, order])[:CLICKS]
    novel = novel_posture(model)
    target = model.pose(novel.q)[rows]
    times = []
    for _ in range(REPEATS):
        started = time.perf_counter()
        found = retarget(model, model.points[rows], target, part=model.labels[rows], q=np.zeros(model.n_values))
        times.append(time.perf_counter() - started)
    return {"retarget_ms": 1000 * float(np.median(times)), "retarget_miss_mm": 1000 * float(found.residual.mean())}


def new_scans(result: FitResult, truth: GroundTruth, sequence: PointSequence) -> dict[str, float]:
    """Points of one frame, moved by their true parts to the novel postures, as scans that were never seen: mean error
    of the canonical points under the tracked posture (cm), and under the posture that true correspondences lead to."""
    c, f = result.model.canonical, SEEN_FROM % len(sequence)
    own, labels = truth.labels[f][sequence.index[f]], truth.labels[c][sequence.index[c]]
    scans = [transform((T @ inverse(truth.poses[f]))[own], sequence.points[f]) for T in truth.novel]
    started = time.perf_counter()
    found = track(result, sequence, PointSequence.from_arrays(scans))
    seconds = (time.perf_counter() - started) / len(scans)
    true = [transform((T @ inverse(truth.poses[c]))[labels], result.model.points) for T in truth.novel]
    miss = [off(result.model, q, root, x) for q, root, x in zip(*vars(found.motion).values(), true, strict=True)]
    led = [retarget(result.model, result.model.points, x, part=result.model.labels) for x in true]
    best = [off(result.model, pose.q, pose.T_world_root, x) for pose, x in zip(led, true, strict=True)]
    return {"track_cm": float(np.mean(miss)), "possible_cm": float(np.mean(best)), "track_s": seconds}


def off(model: KinematicModel, q: Array, T_world_root: Array, true: Array) -> float:
    """Mean distance of the posed canonical points from where they should be, cm."""
    return 100 * float(np.linalg.norm(model.pose(q, T_world_root) - true, axis=1).mean())


def clip(result: FitResult, sequence: PointSequence, folder: Path) -> dict[str, float]:
    """Time of a clip with all panels."""
    started = time.perf_counter()
    view = best_view(result, sequence)
    write_clip(
        folder / "clip.gif",
        film(PanelData(result, sequence, novel_posture(result.model), view, (300, 300)), list(PANELS)),
    )
    return {"render_s": time.perf_counter() - started}

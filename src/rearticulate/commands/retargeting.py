"""`retarget`: a few points and where they should go become a posture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rearticulate.commands.outputs import check_folder
from rearticulate.commands.posing import first_posture, save_posed
from rearticulate.commands.show import print_json, show_change, show_clicks
from rearticulate.errors import InputError
from rearticulate.io.atomic import atomic_folder
from rearticulate.io.clicks import Clicks, load_clicks
from rearticulate.io.model import load_result, write_joint_values
from rearticulate.io.posture import named_values, save_posture
from rearticulate.posing.blend import blend, eased
from rearticulate.posing.pick import pick
from rearticulate.records import Array, KinematicModel, Posture
from rearticulate.render.clip import dragged, there_and_back, write_clip
from rearticulate.retargeting.retarget import RetargetResult, retarget

STEPS = 30  # of the animation
MARK = "posture.json"


def run_retarget(
    folder: Path,
    clicks_file: Path,
    out: Path,
    frame: int | None,
    start: Path | None,
    fixed_root: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """The command `retarget`."""
    check_folder(out, MARK, "retargeting", overwrite)
    result = load_result(folder)
    model, clicks = result.model, load_clicks(clicks_file)
    first = first_posture(result, frame, start)
    with atomic_folder(out) as partial:
        source, found = solve(model, clicks, first, fixed_root, clicks_file)
        last = Posture(found.q, found.T_world_root)
        told = describe(model, clicks, found)
        save_posture(partial / MARK, model, last, **told)
        save_posed(partial / "cloud.ply", model, last)
        way = blend(first, last, eased(STEPS))
        write_joint_values(partial / "motion.csv", model, way)
        write_clip(partial / "animation.gif", there_and_back(dragged(model, way, source, found.part, clicks.target)))
    if as_json:
        print_json({"out": str(out), "joints": named_values(model, last), "T_world_root": last.T_world_root, **told})
    else:
        show_clicks(told["clicks"])
        show_change(model, first, last)
        print(out)


def solve(
    model: KinematicModel, clicks: Clicks, first: Posture, fixed_root: bool, where: Path
) -> tuple[Array, RetargetResult]:
    """The clicked points in the canonical frame, and the posture in which they are where they should be: from the
    canonical frame the best one, from any other the one nearest to it."""
    unknown = [name for name in clicks.part if name is not None and name not in model.names]
    if unknown:
        raise InputError(f"{where}: no part is called {unknown[0]!r}; the parts are {', '.join(model.names)}")
    known = np.array([-1 if name is None else model.names.index(name) for name in clicks.part])
    source, part = pick(model, first, clicks.source, known)
    at_rest = not first.q.any()
    found = retarget(
        model,
        source,
        clicks.target,
        part=part if (known >= 0).any() else None,
        free_root=not fixed_root,
        q=None if at_rest else first.q,
        T_world_root=first.T_world_root,
    )
    return source, found


def describe(model: KinematicModel, clicks: Clicks, found: RetargetResult) -> dict[str, Any]:
    """What became of every click."""
    rows = zip(clicks.source.tolist(), clicks.target.tolist(), found.part, found.residual.tolist(), strict=True)
    told = [{"source": s, "target": t, "part": model.names[p], "residual": r} for s, t, p, r in rows]
    return {"clicks": told, "converged": found.converged}

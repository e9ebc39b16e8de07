"""A result in words and plain numbers: shared by the terminal, the page and `--json`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rearticulate.records import FitResult, JointDiagnostics, KinematicModel, PointSequence
from rearticulate.report.confidence import confidence

NOT_MEASURED = "–"


@dataclass(frozen=True)
class JointRow:
    """One line of the joint table, as text with units."""

    part: str
    parent: str
    kind: str
    axis: str
    origin: str
    range: str
    residual: str
    uncertainty: str
    note: str


def joint_rows(result: FitResult) -> list[JointRow]:
    """The joint table, the root left out."""
    return [_joint_row(result, j) for j in range(1, result.model.n_parts)]


def _joint_row(result: FitResult, j: int) -> JointRow:
    model, joint = result.model, result.joints[j]
    moves = model.joint_type[j] != "fixed"
    return JointRow(
        part=model.names[j],
        parent=model.names[model.parent[j]],
        kind=model.joint_type[j],
        axis=_vector(model.axis[j], 3) if model.axis[j].any() else "",
        origin=_vector(model.origin[j], 3),
        range=joint_range(model, j),
        residual=length(joint.residual),
        uncertainty=_uncertainty(joint) if moves else "",
        note=confidence(model.joint_type[j], joint),
    )


def joint_range(model: KinematicModel, j: int) -> str:
    """Observed values of q: degrees for a hinge or a ball, centimetres for a slide."""
    low, high = model.limits[j]
    if model.joint_type[j] == "revolute":
        return f"{_rounded(math.degrees(low), 1)} … {_rounded(math.degrees(high), 1)}°"
    if model.joint_type[j] == "prismatic":
        return f"{_rounded(100 * low, 2)} … {_rounded(100 * high, 2)} cm"
    return f"up to {math.degrees(high):.1f}°" if model.joint_type[j] == "spherical" else ""


def joint_value(model: KinematicModel, j: int, q: np.ndarray) -> str:
    """One value of a posture: degrees or centimetres."""
    if model.joint_type[j] == "prismatic":
        return f"{_rounded(100 * q[j], 2)} cm"
    return " ".join(f"{_rounded(math.degrees(x), 1)}°" for x in q[model.values(j)])


def _rounded(x: float, digits: int) -> str:
    """Never "-0.0"."""
    return f"{round(x, digits) + 0.0:.{digits}f}"


def _uncertainty(joint: JointDiagnostics) -> str:
    """Of the axis direction and of its position, as far as they were measured."""
    known = [] if joint.axis_std is None else [angle(joint.axis_std)]
    known += [] if joint.origin_std is None else [length(joint.origin_std)]
    return " ".join(f"±{text}" for text in known) or NOT_MEASURED


def angle(radians: float) -> str:
    """An angle in degrees, to two digits."""
    return f"{math.degrees(radians):.2g}°" if math.isfinite(radians) else "∞"


def length(metres: float | None) -> str:
    """A length in the unit that reads best."""
    if metres is None or math.isnan(metres):
        return NOT_MEASURED
    if math.isinf(metres):
        return "∞"
    if abs(metres) < 1e-6:
        return "0 mm"
    for unit, scale in (("mm", 1000.0), ("cm", 100.0)):
        if abs(metres) * scale < 100:
            return f"{metres * scale:.3g} {unit}"
    return f"{metres:.3g} m"


def _vector(v: np.ndarray, digits: int) -> str:
    return " ".join(f"{x:.{digits}f}" for x in np.round(v, digits) + 0.0)


def counted(n: int, noun: str) -> str:
    """ "1 part", "2 parts"."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def headline(result: FitResult, sequence: PointSequence | None = None) -> list[str]:
    """The facts to read first."""
    model = result.model
    kinds = [k for k in ("revolute", "prismatic", "spherical", "fixed") if k in model.joint_type]
    joints = counted(model.n_parts - 1, "joint")
    if kinds:
        joints += " (" + ", ".join(f"{model.joint_type.count(k)} {k}" for k in kinds) + ")"
    frames = counted(len(result.motion.q), "frame")
    if sequence is not None:
        frames += f" of {points_in_words(result, sequence)}"
    seconds = sum(s.seconds for s in result.stages)
    return [
        counted(model.n_parts, "part"),
        joints,
        frames,
        f"canonical frame {model.canonical}",
        *([] if result.misfit is None else [f"misfit {length(float(result.misfit.mean()))} beyond the sampling"]),
        f"energy {energy_in_words(result)}",
        f"{seconds:.1f} s",
    ]


def energy_in_words(result: FitResult) -> str:
    """With what it is: solvers measure different things."""
    paper = result.config.get("articulate") == "paper"
    return f"{result.energy:.4g} " + ("of the paper (E_project + E_group)" if paper else "a point")


def points_of(result: FitResult, sequence: PointSequence) -> dict[str, list[int]]:
    """Points of every frame: in its source, kept, and taking part in the fit (the others get their labels at the
    end)."""
    kept = [len(p) for p in sequence.points]
    limit = int(result.config.get("working_points", max(kept)))
    return {"source": list(sequence.source_points) or kept, "kept": kept, "fitted": [min(n, limit) for n in kept]}


def points_in_words(result: FitResult, sequence: PointSequence) -> str:
    """ "60000 points, 20000 kept, 5000 take part in the fit"; what is the same is said once."""
    source, kept, fitted = points_of(result, sequence).values()
    words = f"{_between(source)} points"
    words += f", {_between(kept)} kept" if kept != source else ""
    return words + (f", {_between(fitted)} take part in the fit" if fitted != kept else "")


def _between(sizes: list[int]) -> str:
    return f"{min(sizes)}" if min(sizes) == max(sizes) else f"{min(sizes)} to {max(sizes)}"


def children(model: KinematicModel) -> dict[int, list[int]]:
    """Children of every part; the root under -1."""
    table: dict[int, list[int]] = {j: [] for j in range(-1, model.n_parts)}
    for j, p in enumerate(model.parent):
        table[int(p)].append(j)
    return table


def model_as_dict(model: KinematicModel) -> dict[str, Any]:
    """Parts and joints of a model as plain numbers, in metres and radians."""
    counts = np.bincount(model.labels, minlength=model.n_parts)
    return {
        "canonical": model.canonical,
        "parts": [{"name": n, "points": int(c)} for n, c in zip(model.names, counts, strict=True)],
        "joints": [_joint_as_dict(model, j) for j in range(1, model.n_parts)],
    }


def _joint_as_dict(model: KinematicModel, j: int) -> dict[str, Any]:
    return {
        "part": model.names[j],
        "parent": model.names[model.parent[j]],
        "type": model.joint_type[j],
        "axis": model.axis[j].tolist(),
        "origin": model.origin[j].tolist(),
        "limits": model.limits[j].tolist(),
    }


def result_as_dict(result: FitResult, sequence: PointSequence | None = None) -> dict[str, Any]:
    """A whole result as plain numbers, without its arrays. sequence: what was fitted, for its numbers of points."""
    out = model_as_dict(result.model)
    for entry, joint in zip(out["joints"], result.joints[1:], strict=True):
        entry |= {key: "inf" if value == math.inf else value for key, value in vars(joint).items()}
        entry["confidence"] = confidence(entry["type"], joint)
    out["energy"] = result.energy
    out["energies"] = {str(k): v for k, v in result.energies.items()}
    out["residual"] = np.asarray(result.residual).tolist()
    out["misfit"] = None if result.misfit is None else result.misfit.tolist()
    if sequence is not None:
        out["points"] = points_of(result, sequence)
    out["seconds"] = {s.name: s.seconds for s in result.stages}
    out["seed"] = result.seed
    out["notes"] = list(result.notes)
    out["machine"] = result.machine
    return out


def jsonable(value: Any) -> Any:
    """Strict JSON: numpy numbers become plain ones, NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(k): jsonable(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [jsonable(v) for v in value]
    if isinstance(value, np.ndarray):
        return jsonable(value.tolist())
    if isinstance(value, np.generic):
        return jsonable(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

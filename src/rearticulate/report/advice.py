"""What a fit leaves uncertain, and what scan would settle it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rearticulate.records import FitResult, JointDiagnostics, PointSequence
from rearticulate.report.confidence import close_call, confidence
from rearticulate.report.summary import counted, length
from rearticulate.report.support import Support

LITTLE_TURN, LITTLE_SLIDE = math.radians(10), 0.02  # rad; share of the object's size
UNSURE = math.radians(3)  # standard deviation of an axis
FEW = 40  # points of a part in a frame
HALF = 0.5  # of a part must be seen for the frame to count
WHOLE = 0.75  # of the object is seen in a whole frame
WORSE = 2.5  # times the median residual


@dataclass(frozen=True)
class Advice:
    """about: a part, joint or frame. finding: what is uncertain, and why. remedy: the scan that would settle it."""

    about: str
    finding: str
    remedy: str


def advice(result: FitResult, sequence: PointSequence, seen: Support) -> list[Advice]:
    """The most serious first; none where nothing is uncertain."""
    return [
        *(item for j in range(1, result.model.n_parts) for item in _of_joint(result, j)),
        *_of_parts(result, sequence, seen),
        *_of_frames(result, sequence, seen),
    ]


def _of_joint(result: FitResult, j: int) -> list[Advice]:
    model, joint, name = result.model, result.joints[j], result.model.names[j]
    kind = model.joint_type[j]
    if kind in ("fixed", "floating"):
        return []
    size = float(np.linalg.norm(np.ptp(model.points, axis=0)))
    turning = kind != "prismatic"
    little = joint.observed_range < (LITTLE_TURN if turning else LITTLE_SLIDE * size)
    moved = f"{math.degrees(joint.observed_range):.1f}°" if turning else length(joint.observed_range)
    further = f"move {name} further than the {moved} seen, in steps as small as now"
    if not joint.determined:
        return [Advice(f"joint of {name}", joint.note, _remedy(joint, further, name))]
    if close_call(joint):
        return [Advice(f"joint of {name}", confidence(kind, joint), further)]
    if joint.axis_std is not None and joint.axis_std > UNSURE:
        return [Advice(f"joint of {name}", f"its axis is known to ±{math.degrees(joint.axis_std):.1f}° only", further)]
    if little:
        return [Advice(f"joint of {name}", f"it moved by {moved} only, so its limits say little", further)]
    return []


def _remedy(joint: JointDiagnostics, further: str, name: str) -> str:
    if "surface" in joint.note:
        return f"a scan of the shape alone cannot tell: put something on {name} that sticks out, and scan again"
    return further


def _of_parts(result: FitResult, sequence: PointSequence, seen: Support) -> list[Advice]:
    model, F, out = result.model, len(sequence), []
    shares = seen.of_parts(model.n_parts)
    whole = seen.of_frames() >= WHOLE
    for p, name in enumerate(model.names):
        count = np.mean([(labels == p).sum() for labels in result.labels])
        if count == 0:
            finding = "no points of its own: inferred from how its neighbours move"
            out.append(Advice(name, finding, f"scan from closer, so that {name} itself is seen"))
        elif count < FEW:
            finding = f"{count:.0f} points a frame: its border is uncertain"
            out.append(Advice(name, finding, "scan denser or from closer"))
        hidden = [f for f in range(F) if whole[f] and shares[f, p] < HALF]
        if count and hidden:
            finding = f"hardly seen in {counted(len(hidden), 'frame')} ({_listed(hidden)})"
            out.append(Advice(name, finding, f"cover {name} in these frames, from another side"))
    return out


def _of_frames(result: FitResult, sequence: PointSequence, seen: Support) -> list[Advice]:
    shares, out = seen.of_frames(), []
    partial = [f for f in range(len(sequence)) if shares[f] < WHOLE]
    if partial:
        finding = f"{min(shares):.0%} of the object seen" if len(partial) == 1 else "only a part of the object seen"
        out.append(Advice(f"{_frames(partial)}", finding, "cover the side that is missing, the back"))
    residual = np.asarray(result.residual)
    worse = [f for f in range(len(residual)) if f not in partial and residual[f] > WORSE * np.median(residual)]
    if worse:
        finding = f"fits worse than the others ({length(float(residual[worse].max()))})"
        out.append(Advice(_frames(worse), finding, "take more frames there, so that less moves from one to the next"))
    return out


def _frames(frames: list[int]) -> str:
    return f"frame {frames[0]}" if len(frames) == 1 else f"frames {_listed(frames)}"


def _listed(frames: list[int]) -> str:
    return ", ".join(map(str, frames[:8])) + (", ..." if len(frames) > 8 else "")

"""How sure the type of a joint is, in words: for the terminal, the page and JSON alike."""

from __future__ import annotations

import math

from rearticulate.records import JointDiagnostics, JointType

CLOSE = 10.0  # extra chi-square of the other joint type below which the type is a close call


def close_call(joint: JointDiagnostics) -> bool:
    """Whether the other type explains the motion about as well; False where that was not measured."""
    return joint.runner_up_margin is not None and joint.runner_up_margin < CLOSE


def confidence(kind: JointType, joint: JointDiagnostics) -> str:
    """Why the joint is not determined, or its type and how sure it is."""
    if not joint.determined:
        return f"not determined: {joint.note}" if joint.note else "not determined"
    return "; ".join(filter(None, [_type(kind, joint), joint.note]))


def _type(kind: JointType, joint: JointDiagnostics) -> str:
    if not joint.runner_up:
        return ""
    if joint.runner_up_margin is None:
        return f"{kind}, {joint.runner_up} not tried"
    if math.isinf(joint.runner_up_margin):
        return f"{kind}, sure (a {joint.runner_up} joint would need an axis outside of the object)"
    if close_call(joint):
        return f"{kind} or {joint.runner_up}: the data hardly tell"
    return f"{kind}, sure ({joint.runner_up} fits worse by {_rounded(joint.runner_up_margin)} χ²)"


def _rounded(x: float) -> str:
    return f"{x:.3g}" if x < 1000 else f"{x:,.0f}"

"""What speaks against calling a joint determined.

Where the assumptions of a fit break (few states, a drifting scale, few cameras, a hand in the way), bodies fall into
pieces that seem to move by small joints which do not exist. Their own figures give them away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.special import stdtrit

MIN_POINTS = 30  # a frame: five for each of the six numbers of a pose
CHANCE = 2.7e-3  # what is beyond three standard deviations, were there no end of frames
CORRELATED = 9.0  # true deviations over those that count points as independent: neighbours share their errors
MIN_VISIBLE = 0.01  # share of the motion across the surface below which a joint cannot be seen
MAX_AXIS_STD = math.radians(5.0)
MAX_MISFIT = 1 / 3  # of the motion: one joint explains less than 8/9 of its square
OUTSIDE = 0.5  # of the size of the object: no hinge is that far from both of its parts


@dataclass(frozen=True)
class Claim:
    """The figures of one joint, lengths in metres.

    turning: a hinge, else a slide. points: of the part, a frame; 0 where it was inferred. span, value_std: range of the
    joint value and its deviation, rad or m. axis_std: rad. path: mean way of all points that the joint moves, over its
    range. motion: of the part, as far as it leaves the surface, misfit: what the best such joint leaves of that; None
    where not measured. away: of the axis from the nearest point of the two parts. size: of the object. seen: see
    `diagnose.visibility`. drift: see `scale.Scales`.
    """

    frames: int
    turning: bool
    points: float
    span: float
    value_std: float
    axis_std: float
    path: float
    motion: float | None
    misfit: float | None
    away: float
    size: float
    seen: float
    drift: float


def doubts(claim: Claim) -> list[str]:
    """Why the joint is not determined, in words; none where it is."""
    tests = (_few_points, _within_noise, _unexplained, _unseen, _unknown_axis, _far_axis, _explained_by_scale)
    return [words for test in tests if (words := test(claim))]


def least_range(frames: int, value_std: float) -> float:
    """Range of a joint value that errors alone do not reach, by Student's t: with few frames little is left to
    contradict a joint (6 numbers a frame, less one axis and a value a frame)."""
    return -float(stdtrit(max(5 * frames - 7, 1), CHANCE / 2)) * CORRELATED * value_std


def is_outside(away: float, size: float) -> bool:
    """Whether an axis lies too far from its parts to be a hinge of theirs: such a turn is a slide."""
    return away > OUTSIDE * size


def _few_points(claim: Claim) -> str:
    if not 0 < claim.points < MIN_POINTS:
        return ""
    return f"{claim.points:.0f} points a frame are too few to tell its pose"


def _within_noise(claim: Claim) -> str:
    noise = least_range(claim.frames, claim.value_std)
    if claim.span > noise:
        return ""
    few = "only two states, any small motion is a joint: " if claim.frames == 2 else ""
    return f"{few}it moved by {_amount(claim, claim.span)}, up to {_amount(claim, noise)} may be noise"


def _unexplained(claim: Claim) -> str:
    if claim.motion is None or claim.misfit is None or claim.misfit <= MAX_MISFIT * claim.motion:
        return ""
    return f"one joint leaves {_length(claim.misfit)} of its motion of {_length(claim.motion)} unexplained"


def _unseen(claim: Claim) -> str:
    return "its motion leaves the surface where it is" if claim.seen < MIN_VISIBLE else ""


def _unknown_axis(claim: Claim) -> str:
    if claim.axis_std <= MAX_AXIS_STD:
        return ""
    return f"the direction of its axis is known to ±{math.degrees(claim.axis_std):.2g}° only"


def _far_axis(claim: Claim) -> str:
    if not claim.turning or not is_outside(claim.away, claim.size):
        return ""
    return f"its axis lies {_length(claim.away)} outside of an object of {_length(claim.size)}"


def _explained_by_scale(claim: Claim) -> str:
    explained = claim.drift * claim.size
    if claim.path >= explained:
        return ""
    return f"it moved by {_length(claim.path)}, the different scales of the frames explain {_length(explained)}"


def _amount(claim: Claim, value: float) -> str:
    return f"{_rounded(math.degrees(value))}°" if claim.turning else _length(value)


def _length(metres: float) -> str:
    return f"{_rounded(1000 * metres)} mm" if metres < 1 else f"{_rounded(metres)} m"


def _rounded(x: float) -> str:
    return f"{x:.2g}" if x < 10 else f"{x:.0f}"

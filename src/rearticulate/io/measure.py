"""What a sequence measures: size, spacing, the step of its coordinates, and the unit that these suggest."""

from __future__ import annotations

import warnings

import numpy as np
from scipy.spatial import KDTree

from rearticulate.errors import InputWarning
from rearticulate.io.check import split_far_apart
from rearticulate.records import Array, PointSequence

_MIN_STEPS, _SURE_STEPS = 4, 20  # in between, the different numbers of one axis may be the planes of an object
_SAME = 0.02  # of a step
COARSE = 0.1  # a larger step, as a share of the spacing of the points, costs joints: at 0.2 phantom parts come


def extent(sequence: PointSequence) -> Array:
    """(3,) size of the box around all frames, stray points apart, m."""
    frames = [points[~split_far_apart(points).stray] for points in sequence.points]
    return np.ptp(np.concatenate(frames), axis=0)


def median_spacing(sequence: PointSequence) -> float:
    """Median distance of a point of the middle frame to its nearest neighbour."""
    points = sequence.points[len(sequence) // 2]
    if len(points) < 2:
        return float("nan")
    return float(np.median(KDTree(points).query(points, k=2)[0][:, 1]))


def grid_step(points: Array) -> Array:
    """(3,) step of which all coordinates of (N, 3) points are multiples, m; 0 where there is none, as in most data.

    Files rounded to so many decimals have one, and float32 far from the origin.
    """
    values = [np.unique(axis) for axis in points.T]
    steps = np.array([_step(np.diff(axis)) for axis in values])
    sure = np.array([len(axis) > _SURE_STEPS for axis in values])
    return steps if steps.all() else np.where(sure, steps, 0.0)


def _step(gaps: Array) -> float:
    """Of which all gaps between the numbers are multiples; 0 where there is none."""
    if len(gaps) < _MIN_STEPS:
        return 0.0
    near = gaps[gaps < 10 * gaps.min()]  # the smallest gap alone is less exact
    step = near.sum() / np.round(near / gaps.min()).sum()
    steps = gaps / step
    return float(step) if np.abs(steps - np.round(steps)).max() < _SAME else 0.0


def warn_of_steps(sequence: PointSequence) -> None:
    """An InputWarning where coordinates come in steps that are coarse beside the spacing of the points."""
    points = sequence.points[len(sequence) // 2]
    step, spacing = grid_step(points).max(), median_spacing(sequence)
    if step > COARSE * spacing:
        away = ", ".join(f"{x:.6g}" for x in np.median(points, axis=0))
        text = (
            f"coordinates come in steps of {step:.3g} m, points are {spacing:.3g} m apart: too coarse for exact "
            f"joints; save more digits, or subtract an offset such as ({away}) m before saving as float32"
        )
        warnings.warn(text, InputWarning, stacklevel=4)


def warn_of_unit(sequence: PointSequence) -> None:
    """An InputWarning where the size of the object suggests another unit than metres."""
    diagonal = float(np.linalg.norm(extent(sequence)))
    unit, advice = unit_guess(diagonal)
    if advice:
        warnings.warn(f"the object is {diagonal:.3g} m across if in metres; {unit}{advice}", InputWarning, stacklevel=3)


def unit_guess(diagonal: float) -> tuple[str, str]:
    """The unit that makes an object of everyday size (2 cm to 20 m) of this diagonal, and what to do about it."""
    if 0.02 <= diagonal < 20:
        return "metres", ""
    if 20 <= diagonal < 200:
        return "centimetres", ": fit with --scale 0.01"
    if 200 <= diagonal < 20_000:
        return "millimetres", ": fit with --scale 0.001"
    return "unknown", ": no everyday object in metres, centimetres or millimetres"

"""What each half of a fit is given and what it gives, whatever method it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rearticulate.arrays import Array, Int
from rearticulate.config import FitConfig
from rearticulate.joints.articulated import Articulated
from rearticulate.methods.spherical import BallTree
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import Frames
from rearticulate.parts.relaxed import Relaxed


@dataclass(frozen=True)
class Start:
    """A relaxed model, from one canonical frame, and its score a point."""

    canonical: int
    relaxed: Relaxed
    score: float


@dataclass(frozen=True)
class Problem:
    """Frames, and the canonical one that the model is fitted from.

    flow: between successive frames, none where no half asks for it. progress(stage, fraction done of it). device: of
    gradient descent.
    """

    frames: Frames
    canonical: int
    flow: tuple[SceneFlow, ...]
    config: FitConfig
    progress: Callable[[str, float], None]
    device: str = "cpu"


@dataclass(frozen=True)
class Candidate:
    """One complete fit from one canonical frame, in the fitter's units. energy: what canonical frames are chosen by."""

    canonical: int
    tree: Articulated | BallTree
    labels: Int[Array, " M"]
    energy: float
    relaxed: Relaxed


Relax = Callable[[Problem, np.random.Generator], Relaxed]
Articulate = Callable[[Problem, Sequence[Start], np.random.Generator], Candidate]

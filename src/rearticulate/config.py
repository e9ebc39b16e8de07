"""The settings of a fit: those of the direct solver in `FitConfig` itself, those of the paper's method in groups.

One default for every object. An unknown key is an error. What nobody needs to vary is a constant of the module that
uses it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from rearticulate.bounds import Bounds, Count, CountOrZero, NotNegative, Positive, Settings, Share, shown
from rearticulate.errors import InputError
from rearticulate.jsons import read_json

Mechanism = Literal[
    "network",  # matches of the correspondence network, as a start of the tracking where a frame fits badly
    "small middles",  # a small part as the middle link of a chain between its neighbours
    "hidden links",  # links without points of their own
    "restart",  # parts that lost their pose in a frame start again
    "simplify",  # joints that the data do not need are fixed
    "second look",  # other structures than the first, from more accurate motions
    "exchange",  # whole layers go to one body
    "sweep",  # poses along the directions of which the points say little
    "split",  # a body becomes two
    "slides",  # ... where whole sheets move along a screw, or stand still
    "other starts",  # bodies that other starts found, beside those of the best one
    "seams",  # plane borders across the axes of hinges
    "views",  # what the sensors see of other places, where their origins are known
    "incomplete frames",  # frames that show only a part of the object take no part in finding the structure
]
Mechanisms = Annotated[tuple[Mechanism, ...], Bounds(0)]
MECHANISMS: tuple[Mechanism, ...] = get_args(Mechanism)


@dataclass(frozen=True)
class NeuralConfig(Settings):
    """The paper's relaxed model (`methods.paper.relax`), supplement, "Optimization Details". Lengths in metres of the
    object as the fit sees it, scaled to `radius`."""

    radius: Positive = 0.3  # rms distance of the canonical points from their centroid: about that of a robot of 1 m
    start: Literal["cells", "random", "direct"] = (
        "cells"  # parts around farthest points, anywhere, or of the direct solver
    )
    refined: bool = True  # the network's matches are the start of a registration of patches; False: as in the paper
    ratio: Share = 0.9  # ... of feature distances to the nearest and second nearest above which a match is not sure
    parts: Count = 20
    hidden: Count = 128  # width of the part field
    field: bool = True  # a field over space says the part of a point; False: each point has a choice of its own
    gumbel: bool = True  # parts are drawn while fitting; False: a point follows the blend of the parts
    chamfer_iterations: CountOrZero = 5000
    emd_iterations: CountOrZero = 10_000
    emd_thinning: Count = 4  # one point in this many takes part in an assignment
    emd_every: Count = 5  # iterations an assignment is kept
    chamfer_every: Count = 1  # ... the nearest neighbours of the Chamfer term
    flow_every: Count = 5  # ... the observed flow at the moved points
    chamfer: NotNegative = 1.0  # weights of the energy terms, 0: without it
    emd: NotNegative = 0.3
    flow: NotNegative = 1.0
    flow_neighbours: Count = 3
    flow_far: NotNegative = 0.05  # a point farther from any anchor than this and than the flow there is long ...
    flow_still: NotNegative = 1e-2  # ... is held still, with this weight
    rate_field: Positive = 1e-3  # Adam
    rate_poses: Positive = 1e-2
    rate_end: Share = 1.0  # share of the rates that is left at the end, by a cosine; 1 as in the paper
    temperature: Positive = 5.0  # of the draw, by a cosine to:
    temperature_end: NotNegative = 1.0
    minimum_points: CountOrZero = 20  # a part with fewer canonical points is dissolved
    start_iterations: CountOrZero = 300  # that fit the field to given labels, when there are any
    final_iterations: CountOrZero = 200  # of the final fit (`methods.paper.refine`)
    final_rate: Positive = 1e-2
    final_rate_end: Share = 0.0
    final_thinning: Count = 2
    final_every: Count = 1


@dataclass(frozen=True)
class DeviationConfig(Settings):
    """The paper's rules for merging and projecting (`methods.deviation`), in metres of an object scaled to
    `radius`."""

    joints: Literal["screw", "ball"] = "screw"  # hinges and slides, or ball joints alone ("beyond 1DOF joints")
    radius: Positive = 0.3  # rms distance of the canonical points from their centroid
    merge: NotNegative = 3e-2  # mean squared deviation from the identity below which two parts are one
    merge_gap: NotNegative = 0.02  # ... if they come this near ("spatially close")
    spatial: NotNegative = 100.0  # weights of the two terms of the projection
    one_dof: NotNegative = 1.0


@dataclass(frozen=True)
class FitConfig(Settings):
    """Everything a fit depends on besides the sequence and the seed. Chi-squares are per degree of freedom."""

    relax: Literal["direct", "neural"] = "direct"  # the relaxed model: `search.relax`, `methods.paper.relax`
    articulate: Literal["direct", "paper"] = "direct"  # the tree: `search.articulate`, `methods.paper.method`
    without: Mechanisms = ()  # mechanisms of the direct solver that are left out, of `MECHANISMS`
    working_points: Count = 5000  # points a frame that take part in the fit; all are labelled
    canonical_tries: Count = 4  # frames from which the model is fitted, at most; the lowest score wins
    canonical_work: Count = 82_000  # ... and two at least, but no more than make this many points to register in all
    canonical_share: Share = 0.9  # frames with less than this share of the most points a frame has come last
    capture_range: Positive = 37.0  # spacings; robust scale of a correspondence when the tracking of a frame begins
    fragment_penalty: NotNegative = 5.0  # growth of the rigid-fit error, in its variance, that stops the merging ...
    max_fragments: Count = 80  # ... of tracked patches, once there are no more fragments than this
    merge_threshold: Positive = 0.03  # spacings; growth of a point's misfit below which two fragments are one body
    max_parts: Count = 40  # rigid parts that are worked with; where more are found, the smallest are dissolved
    joint_chi2: NotNegative = 3.0  # one joint is enough below this
    slide_margin: NotNegative = 6.0  # extra chi-square, not per degree of freedom, at which a slide is still preferred
    max_hidden: CountOrZero = 20  # links without points of their own, in all
    neural: NeuralConfig = field(default_factory=NeuralConfig)
    deviation: DeviationConfig = field(default_factory=DeviationConfig)

    def uses(self, mechanism: Mechanism) -> bool:
        """Whether a mechanism of the direct solver takes part."""
        return mechanism not in self.without

    @property
    def uses_paper(self) -> bool:
        """Whether a half of the fit is the paper's, which wants the observed flow and PyTorch."""
        return self.relax != "direct" or self.articulate != "direct"


PRESETS = {
    "direct": FitConfig(),
    "paper": FitConfig(relax="neural", articulate="paper"),
    "paper-fast": FitConfig(
        relax="neural",
        articulate="paper",
        neural=NeuralConfig(start="direct", chamfer_iterations=200, emd_iterations=100, temperature=1.0, rate_end=0.0),
    ),
}


def preset(name: str) -> FitConfig:
    """The configuration of a named preset. Raises InputError with the names that exist."""
    if name not in PRESETS:
        raise InputError(f"there is no preset {name!r}; presets: {', '.join(PRESETS)}")
    return PRESETS[name]


def load_config(path: str | Path, base: FitConfig | None = None) -> FitConfig:
    """`base` with the values of a JSON file, nested as the dataclasses are. Unknown keys raise InputError."""
    return _override(base or FitConfig(), read_json(Path(path)), str(path))


def _override(config: Any, values: Any, where: str) -> Any:
    if not isinstance(values, dict):
        raise InputError(f"{where}: an object of settings is needed, this is {type(values).__name__}")
    known = {f.name: getattr(config, f.name) for f in fields(config)}
    changed = dict(known)
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{where}: unknown setting {shown(key)}; there are {', '.join(known)}")
        changed[key] = _override(known[key], value, f"{where}: {key}") if is_dataclass(known[key]) else value
    try:
        return type(config)(**changed)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error

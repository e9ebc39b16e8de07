"""The configuration: one frozen dataclass a stage. Lengths are in point spacings unless a unit is named.

One default for every object. An unknown key is an error.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from rearticulate.bounds import Bounds, Count, CountOrZero, NotNegative, Positive, Settings, Share, shown
from rearticulate.errors import InputError
from rearticulate.jsons import read_json

AtLeastTwo = Annotated[int, Bounds(2, 10**9)]  # of a schedule with a first and a last one


@dataclass(frozen=True)
class TrackConfig(Settings):
    """Patch tracking (`parts.patches`)."""

    points_per_node: Positive = 12.8
    min_nodes: CountOrZero = 160
    max_nodes: Count = 360
    patch_size: Count = 30
    edges_per_node: Count = 6
    iterations: AtLeastTwo = 30
    sigma: Positive = 37.0  # robust scale of a correspondence: first and last iteration
    sigma_end: Positive = 0.75
    stiffness: Positive = 3.0  # weight of a patch edge, relative to the data of one patch
    stiffness_end: Positive = 0.02
    tear: Positive = 9.3  # robust scale of the gap of an edge
    tear_end: Positive = 1.9
    tear_memory: NotNegative = 3.7  # an edge that was torn by more than this in another frame stays weak
    point_share: Share = 0.3
    bad_cost: NotNegative = 2.15  # spacings; a frame with a larger two-sided distance is tried again from others ...
    unusual: NotNegative = 1.08  # ... and one with so many times the usual distance
    gain: NotNegative = 0.02  # a start is taken if it lowers that distance by this (standard error 0.012, 4096 points)
    network: bool = True  # one of those starts comes from the correspondence network


@dataclass(frozen=True)
class ClusterConfig(Settings):
    """Over-segmentation of the tracked patches (`parts.cluster`)."""

    sigma: Positive = 0.75
    penalty: NotNegative = 5.0  # growth of the rigid-fit error, in sigma^2 a frame, that stops the merging ...
    max_parts: Count = 80  # ... once there are no more parts than this


@dataclass(frozen=True)
class TrialConfig(Settings):
    """Trial merges and repairs of parts (`parts.trial`)."""

    subset: Count = 90  # points of a part that take part in a trial (`parts.trial.Trials.subset`)
    gap: NotNegative = 4.0  # parts closer than this may be tried
    border: NotNegative = 0.5  # what a border as long as the smaller part has points is worth when pairs compete
    threshold_first: Positive = 0.03  # growth of the misfit below which two parts are one
    threshold: Positive = 0.045


@dataclass(frozen=True)
class RepairConfig(Settings):
    """Restarts of lost parts (`parts.repair`)."""

    subset: Count = 150  # points of a part that take part in a restart (`parts.trial.Trials.subset`)
    minimum_points: CountOrZero = 12
    margin: NotNegative = 0.06  # another pose must lower the misfit by this much to be taken
    unexplained: Positive = 1.5  # a point farther than this from every other part is unexplained
    max_unexplained: CountOrZero = 300
    reach: Positive = 4.0  # an unexplained point costs at most this much
    backward_weight: NotNegative = 0.3  # of the unexplained points, against the part's own misfit
    suspicion: Positive = 1.3  # a misfit above this times the part's best one calls for a search
    pivot_subset: Count = 40
    pivot_radius_deg: Positive = 50.0  # turns about a joint are searched this far
    pivot_step_deg: Positive = 12.5
    pivot_keep: Count = 3
    branch_suspicion: Positive = 1.08
    branch_points: Count = 400  # points of a branch of the tree in a joint-space restart
    joint_margin: NotNegative = 0.015
    swing_deg: Positive = 60.0  # a joint is searched this far either way
    swing_step_deg: Positive = 6.0


@dataclass(frozen=True)
class RestConfig(Settings):
    """The part at rest (`parts.rest`)."""

    motion: NotNegative = 1.0  # only when every part moves more than this
    minimum_part: CountOrZero = 40
    excess: NotNegative = 0.05  # standing still may cost a point this much more
    minimum_points: CountOrZero = 60
    carried: NotNegative = 3.0  # the points must have been carried farther than this


@dataclass(frozen=True)
class LabelConfig(Settings):
    """Labels of all frames' points (`parts.labels`)."""

    offset_scale: Positive = 0.4  # Gaussian weight of the offset between the tangent planes of two neighbours
    space_scale: Positive = 1.87  # Gaussian weight of a spatial neighbour
    time_scale: Positive = 1.12  # Gaussian weight of a neighbour in another frame
    evidence_frames: Count = 12  # every point is tested against at most this many frames
    nearest_weight: Positive = 5.0
    candidate_radius: Positive = 3.7
    minimum_points: NotNegative = 20.0  # a part with fewer points a frame is dissolved by the coarse labels
    minimum_support: NotNegative = 12.0  # ... and below this when the structure is looked at again
    sheet_candidates: Positive = 3.7
    sheet_radius: NotNegative = 2.6
    sheet_neighbours: Count = 40
    sheet_tries: CountOrZero = 20
    sheet_thickness: Positive = 0.093  # of points without noise
    sampling_noise: NotNegative = 0.25  # deviation from a surface that sampling alone may show; what is more is noise
    certain: Share = 0.99  # a point that was this sure of its part ...
    certain_radius: NotNegative = 2.0  # ... has only candidates that are nearer than this
    sheet_curvature: NotNegative = 0.008  # thickness grows by this times the squared distance, per spacing


@dataclass(frozen=True)
class ProjectConfig(Settings):
    """Tests of relative motion and the kinematic tree (`joints.project`). Chi-squares are per degree of freedom."""

    noise_floor: NotNegative = 0.25  # registration is never trusted to better than this
    merge: NotNegative = 1.0  # parts that rest against each other better than this are one
    merge_rms: NotNegative = 0.36  # ... or whose relative motion is below this (and chi-square below 10)
    joint: NotNegative = 3.0  # one joint is enough below this
    joint_rms: NotNegative = 0.25  # ... or when its misfit is below this
    gain: NotNegative = 0.2  # another joint in series must lower the chi-square to this share
    small_rms: NotNegative = 0.5  # misfits below this need the stricter gain
    small_gain: NotNegative = 0.05
    gap: NotNegative = 7.5  # parts farther apart are not joined if it can be helped
    gap_series: NotNegative = 4.0  # two joints in series are tried for parts nearer than this
    gap_weight: NotNegative = 0.35
    series_cost: NotNegative = 2.0  # what a second joint costs in the spanning tree
    link_near: Positive = 4.0  # a hidden link starts with the points of the part that hangs on it within this reach
    link_far: Positive = 12.0  # ... or within this one
    link_share: Share = 0.4  # ... but with at most this share of them
    max_hidden: CountOrZero = 20  # hidden links in all
    weld_rounds: CountOrZero = 10  # each of which tries all joints that are left
    weld: NotNegative = 1.0  # a joint that the others make up for to this misfit is put to the test of the energy
    small_part: Share = 0.04  # share of the points below which a part may become a link of a chain
    off_root: NotNegative = 0.7  # what a joint between two moving parts costs more than one on the root
    prismatic_margin: NotNegative = 6.0  # extra chi-square at which a slide is still preferred to a turn
    root_motion: NotNegative = 1.5  # the root is the largest part among those that move at most this times the least


@dataclass(frozen=True)
class SeamConfig(Settings):
    """Plane seams across joint axes (`joints.seams`)."""

    zone: NotNegative = 9.0  # points this near to both parts may change sides
    minimum_points: CountOrZero = 30
    neighbours: Count = 32  # the evidence is averaged over this many points first
    slack: NotNegative = 1.4  # cuts this close to the best (times the root of the number of points) count as equal
    bin_width: Positive = 0.75  # of the histogram along the axis that finds the faces of links
    peak: Positive = 2.0  # a face has this many times the usual number of points
    doubt: NotNegative = 2.7  # a point with more evidence than this against the cut stays where it is
    sacrifice: NotNegative = 1.15  # evidence a changed point may give up on average, for ten frames
    misfit: NotNegative = 0.1  # ... and growth of their misfit to the other frames
    minimum_support: NotNegative = 5.0  # a link with fewer points a frame may claim points near the gap it bridges
    link_reach: Positive = 12.0
    claim: NotNegative = 0.25  # cuts that give it up to this share of the sacrifice too much count as equal to the best


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
    """The paper's rules for merging and projecting (`joints.deviation`), in metres of an object scaled to `radius`."""

    joints: Literal["screw", "ball"] = "screw"  # hinges and slides, or ball joints alone ("beyond 1DOF joints")
    radius: Positive = 0.3  # rms distance of the canonical points from their centroid
    merge: NotNegative = 3e-2  # mean squared deviation from the identity below which two parts are one
    merge_gap: NotNegative = 0.02  # ... if they come this near ("spatially close")
    spatial: NotNegative = 100.0  # weights of the two terms of the projection
    one_dof: NotNegative = 1.0


@dataclass(frozen=True)
class FitConfig(Settings):
    """Everything a fit depends on besides the sequence and the seed."""

    relax: Literal["direct", "neural"] = "direct"  # the relaxed model: `search.relax`, `methods.paper.relax`
    articulate: Literal["direct", "paper"] = "direct"  # the tree: `search.articulate`, `methods.paper.method`
    working_points: Count = 5000  # points a frame that take part in the fit; all are labelled
    canonical_tries: Count = 4  # frames from which the model is fitted, at most; the lowest energy wins
    canonical_work: Count = 82_000  # ... and two at least, but no more than make this many points to register in all
    canonical_share: Share = 0.9  # frames with less than this share of the most points a frame has come last
    max_parts: Count = 40  # rigid parts that are worked with; where more are found, the smallest are dissolved
    track: TrackConfig = field(default_factory=TrackConfig)
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    trial: TrialConfig = field(default_factory=TrialConfig)
    repair: RepairConfig = field(default_factory=RepairConfig)
    rest: RestConfig = field(default_factory=RestConfig)
    label: LabelConfig = field(default_factory=LabelConfig)
    seam: SeamConfig = field(default_factory=SeamConfig)
    project: ProjectConfig = field(default_factory=ProjectConfig)
    neural: NeuralConfig = field(default_factory=NeuralConfig)
    deviation: DeviationConfig = field(default_factory=DeviationConfig)

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

"""The configuration: one frozen dataclass a stage. Lengths are in point spacings unless a unit is named.

One default for every object. An unknown key is an error.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, get_args, get_type_hints

from rearticulate.errors import InputError


@dataclass(frozen=True)
class TrackConfig:
    """Patch tracking (`solver.track`)."""

    points_per_node: float = 12.8
    min_nodes: int = 160
    max_nodes: int = 360
    patch_size: int = 30
    edges_per_node: int = 6
    iterations: int = 30
    sigma: float = 37.0  # robust scale of a correspondence: first and last iteration
    sigma_end: float = 0.75
    stiffness: float = 3.0  # weight of a patch edge, relative to the data of one patch
    stiffness_end: float = 0.02
    tear: float = 9.3  # robust scale of the gap of an edge
    tear_end: float = 1.9
    tear_memory: float = 3.7  # an edge that was torn by more than this in another frame stays weak
    point_share: float = 0.3
    bad_cost: float = 2.15  # spacings; a frame with a larger two-sided distance is tried again from other starts ...
    unusual: float = 1.08  # ... and one with so many times the usual distance
    gain: float = 0.02  # a start is taken if it lowers that distance by this; its standard error is 0.012, 4096 points
    network: bool = True  # one of those starts comes from the correspondence network


@dataclass(frozen=True)
class ClusterConfig:
    """Over-segmentation of the tracked patches (`solver.cluster`)."""

    sigma: float = 0.75
    penalty: float = 5.0  # growth of the rigid-fit error, in sigma^2 a frame, that stops the merging ...
    max_parts: int = 80  # ... once there are no more parts than this


@dataclass(frozen=True)
class TrialConfig:
    """Trial merges and repairs of parts (`solver.trial`)."""

    subset: int = 90  # points of a part that take part in a trial (`solver.trial.Trials.subset`)
    gap: float = 4.0  # parts closer than this may be tried
    border: float = 0.5  # what a border as long as the smaller part has points is worth when pairs compete
    threshold_first: float = 0.03  # growth of the misfit below which two parts are one
    threshold: float = 0.045


@dataclass(frozen=True)
class RepairConfig:
    """Restarts of lost parts (`solver.repair`)."""

    subset: int = 150  # points of a part that take part in a restart (`solver.trial.Trials.subset`)
    minimum_points: int = 12
    margin: float = 0.06  # another pose must lower the misfit by this much to be taken
    unexplained: float = 1.5  # a point farther than this from every other part is unexplained
    max_unexplained: int = 300
    reach: float = 4.0  # an unexplained point costs at most this much
    backward_weight: float = 0.3  # of the unexplained points, against the part's own misfit
    suspicion: float = 1.3  # a misfit above this times the part's best one calls for a search
    pivot_subset: int = 40
    pivot_radius_deg: float = 50.0  # turns about a joint are searched this far
    pivot_step_deg: float = 12.5
    pivot_keep: int = 3
    branch_suspicion: float = 1.08
    branch_points: int = 400  # points of a branch of the tree in a joint-space restart
    joint_margin: float = 0.015
    swing_deg: float = 60.0  # a joint is searched this far either way
    swing_step_deg: float = 6.0


@dataclass(frozen=True)
class RestConfig:
    """The part at rest (`solver.relax.part_at_rest`)."""

    motion: float = 1.0  # only when every part moves more than this
    minimum_part: int = 40
    excess: float = 0.05  # standing still may cost a point this much more
    minimum_points: int = 60
    carried: float = 3.0  # the points must have been carried farther than this


@dataclass(frozen=True)
class LabelConfig:
    """Labels of all frames' points (`solver.labels`)."""

    offset_scale: float = 0.4  # Gaussian weight of the offset between the tangent planes of two neighbours
    space_scale: float = 1.87  # Gaussian weight of a spatial neighbour
    time_scale: float = 1.12  # Gaussian weight of a neighbour in another frame
    evidence_frames: int = 12  # every point is tested against at most this many frames
    nearest_weight: float = 5.0
    candidate_radius: float = 3.7
    minimum_points: float = 20.0  # a part with fewer points a frame is dissolved by the coarse labels
    minimum_support: float = 12.0  # ... and below this when the structure is looked at again
    sheet_candidates: float = 3.7
    sheet_radius: float = 2.6
    sheet_neighbours: int = 40
    sheet_tries: int = 20
    sheet_thickness: float = 0.093  # of points without noise
    sampling_noise: float = 0.25  # deviation from a surface that sampling alone may show; what is more is noise
    certain: float = 0.99  # a point that was this sure of its part ...
    certain_radius: float = 2.0  # ... has only candidates that are nearer than this
    sheet_curvature: float = 0.008  # thickness grows by this times the squared distance, per spacing


@dataclass(frozen=True)
class ProjectConfig:
    """Tests of relative motion and the kinematic tree (`solver.project`). Chi-squares are per degree of freedom."""

    noise_floor: float = 0.25  # registration is never trusted to better than this
    merge: float = 1.0  # parts that rest against each other better than this are one
    merge_rms: float = 0.36  # ... or whose relative motion is below this (and chi-square below 10)
    joint: float = 3.0  # one joint is enough below this
    joint_rms: float = 0.25  # ... or when its misfit is below this
    gain: float = 0.2  # another joint in series must lower the chi-square to this share
    small_rms: float = 0.5  # misfits below this need the stricter gain
    small_gain: float = 0.05
    gap: float = 7.5  # parts farther apart are not joined if it can be helped
    gap_series: float = 4.0  # two joints in series are tried for parts nearer than this
    gap_weight: float = 0.35
    series_cost: float = 2.0  # what a second joint costs in the spanning tree
    link_near: float = 4.0  # a hidden link starts with the points of the part that hangs on it within this reach
    link_far: float = 12.0  # ... or within this one
    link_share: float = 0.4  # ... but with at most this share of them
    max_hidden: int = 20  # hidden links in all
    weld_rounds: int = 10  # each of which tries all joints that are left
    weld: float = 1.0  # a joint that the others make up for to this misfit is put to the test of the energy
    small_part: float = 0.04  # share of the points below which a part may become a link of a chain
    off_root: float = 0.7  # what a joint between two moving parts costs more: it must explain more than one on the root
    prismatic_margin: float = 6.0  # extra chi-square at which a slide is still preferred to a turn
    root_motion: float = 1.5  # the root is the largest part among those that move at most this times the least


@dataclass(frozen=True)
class SeamConfig:
    """Plane seams across joint axes (`solver.seams`)."""

    zone: float = 9.0  # points this near to both parts may change sides
    minimum_points: int = 30
    neighbours: int = 32  # the evidence is averaged over this many points first
    slack: float = 1.4  # cuts this close to the best (times the root of the number of points) count as equal
    bin_width: float = 0.75  # of the histogram along the axis that finds the faces of links
    peak: float = 2.0  # a face has this many times the usual number of points
    doubt: float = 2.7  # a point with more evidence than this against the cut stays where it is
    sacrifice: float = 1.15  # evidence a changed point may give up on average, for ten frames
    misfit: float = 0.1  # ... and growth of their misfit to the other frames
    minimum_support: float = 5.0  # a link with fewer points a frame may claim points near the gap it bridges
    link_reach: float = 12.0
    claim: float = 0.25  # cuts that give it up to this share of the sacrifice too much count as equal to the best


@dataclass(frozen=True)
class NeuralConfig:
    """The paper's relaxed model (`solver.neural.relax`), supplement, "Optimization Details". Lengths in metres of the
    object as the fit sees it, scaled to `radius`."""

    radius: float = 0.3  # rms distance of the canonical points from their centroid: about that of a robot of 1 m
    start: Literal["cells", "random", "direct"] = (
        "cells"  # parts around farthest points, anywhere, or of the direct solver
    )
    refined: bool = True  # the network's matches are the start of a registration of patches; False: as in the paper
    ratio: float = 0.9  # ... of feature distances to the nearest and second nearest above which a match is not sure
    parts: int = 20
    hidden: int = 128  # width of the part field
    field: bool = True  # a field over space says the part of a point; False: each point has a choice of its own
    gumbel: bool = True  # parts are drawn while fitting; False: a point follows the blend of the parts
    chamfer_iterations: int = 5000
    emd_iterations: int = 10_000
    emd_thinning: int = 4  # one point in this many takes part in an assignment
    emd_every: int = 5  # iterations an assignment is kept
    chamfer_every: int = 1  # ... the nearest neighbours of the Chamfer term
    flow_every: int = 5  # ... the observed flow at the moved points
    chamfer: float = 1.0  # weights of the energy terms, 0: without it
    emd: float = 0.3
    flow: float = 1.0
    flow_neighbours: int = 3
    flow_far: float = 0.05  # a point farther from any anchor than this and than the flow there is long ...
    flow_still: float = 1e-2  # ... is held still, with this weight
    rate_field: float = 1e-3  # Adam
    rate_poses: float = 1e-2
    rate_end: float = 1.0  # share of the rates that is left at the end, by a cosine; 1 as in the paper
    temperature: float = 5.0  # of the draw, by a cosine to:
    temperature_end: float = 1.0
    minimum_points: int = 20  # a part with fewer canonical points is dissolved
    start_iterations: int = 300  # that fit the field to given labels, when there are any
    final_iterations: int = 200  # of the final fit (`solver.neural.refine`)
    final_rate: float = 1e-2
    final_rate_end: float = 0.0
    final_thinning: int = 2
    final_every: int = 1


@dataclass(frozen=True)
class DeviationConfig:
    """The paper's rules for merging and projecting (`solver.deviation`), in metres of an object scaled to `radius`."""

    joints: Literal["screw", "ball"] = "screw"  # hinges and slides, or ball joints alone ("beyond 1DOF joints")
    radius: float = 0.3  # rms distance of the canonical points from their centroid
    merge: float = 3e-2  # mean squared deviation of the relative motion from the identity below which two parts are one
    merge_gap: float = 0.02  # ... if they come this near ("spatially close")
    spatial: float = 100.0  # weights of the two terms of the projection
    one_dof: float = 1.0


@dataclass(frozen=True)
class FitConfig:
    """Everything a fit depends on besides the sequence and the seed."""

    relax: Literal["direct", "neural"] = "direct"  # the relaxed model: `solver.relax`, `solver.neural.relax`
    articulate: Literal["direct", "paper"] = "direct"  # the tree: `solver.articulate`, `solver.neural.articulate`
    working_points: int = 5000  # points a frame that take part in the fit; all are labelled
    canonical_tries: int = 4  # frames from which the model is fitted, at most; the lowest energy wins
    canonical_work: int = 82_000  # ... and two at least, but no more than make this many points to register in all
    canonical_share: float = 0.9  # frames with less than this share of the most points a frame has come last
    max_parts: int = 40  # rigid parts that are worked with; where more are found, the smallest are dissolved
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
    path = Path(path)
    try:
        values = json.loads(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError as error:
        raise InputError(f"{path}: is not valid JSON ({error})") from None
    return _override(base or FitConfig(), values, str(path))


def _override(config: Any, values: Any, where: str) -> Any:
    if not isinstance(values, dict):
        raise InputError(f"{where}: an object of settings is needed, this is {type(values).__name__}")
    known = {f.name: getattr(config, f.name) for f in fields(config)}
    changed = dict(known)
    for key, value in values.items():
        if key not in known:
            raise InputError(f"{where}: unknown setting {key!r}; there are {', '.join(known)}")
        if is_dataclass(known[key]):
            changed[key] = _override(known[key], value, f"{where}: {key}")
        else:
            changed[key] = _checked(known[key], value, get_args(get_type_hints(type(config))[key]), f"{where}: {key}")
    return type(config)(**changed)


def _checked(before: Any, value: Any, choices: tuple[Any, ...], where: str) -> Any:
    """A setting of the type of the one before; choices: the allowed values of a setting that is not a number."""
    if choices:
        if value not in choices:
            raise InputError(f"{where} must be one of {', '.join(map(str, choices))}, this is {value!r}")
        return value
    if isinstance(before, bool):
        if not isinstance(value, bool):
            raise InputError(f"{where} must be true or false, this is {value!r}")
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"{where} must be a number, this is {value!r}")
    return type(before)(value)

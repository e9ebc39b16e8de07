"""The configuration: one frozen dataclass a stage. Lengths are in point spacings unless a unit is named.

One default for every object. An unknown key is an error.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

from rearticulate.errors import InputError


@dataclass(frozen=True)
class TrackConfig:
    """Patch tracking (`fit.track`)."""

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


@dataclass(frozen=True)
class ClusterConfig:
    """Over-segmentation of the tracked patches (`fit.cluster`)."""

    sigma: float = 0.75
    penalty: float = 5.0  # growth of the rigid-fit error, in sigma^2 a frame, that stops the merging


@dataclass(frozen=True)
class TrialConfig:
    """Trial merges and repairs of parts (`fit.trial`)."""

    subset: int = 90  # points of a part that take part in a trial (`fit.trial.Trials.subset`)
    gap: float = 4.0  # parts closer than this may be tried
    border: float = 0.5  # what a border as long as the smaller part has points is worth when pairs compete
    threshold_first: float = 0.03  # growth of the misfit below which two parts are one
    threshold: float = 0.045


@dataclass(frozen=True)
class RepairConfig:
    """Restarts of lost parts (`fit.repair`)."""

    subset: int = 150  # points of a part that take part in a restart (`fit.trial.Trials.subset`)
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
    """The part at rest (`fit.relax.part_at_rest`)."""

    motion: float = 1.0  # only when every part moves more than this
    minimum_part: int = 40
    excess: float = 0.05  # standing still may cost a point this much more
    minimum_points: int = 60
    carried: float = 3.0  # the points must have been carried farther than this


@dataclass(frozen=True)
class LabelConfig:
    """Labels of all frames' points (`fit.labels`)."""

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
    """Tests of relative motion and the kinematic tree (`fit.project`). Chi-squares are per degree of freedom."""

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
    weld: float = 1.0  # a joint that the others make up for to this misfit is put to the test of the energy
    small_part: float = 0.04  # share of the points below which a part may become a link of a chain
    off_root: float = 0.7  # what a joint between two moving parts costs more: it must explain more than one on the root
    prismatic_margin: float = 6.0  # extra chi-square at which a slide is still preferred to a turn
    root_motion: float = 1.5  # the root is the largest part among those that move at most this times the least


@dataclass(frozen=True)
class SeamConfig:
    """Plane seams across joint axes (`fit.seams`)."""

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
class FitConfig:
    """Everything a fit depends on besides the sequence and the seed."""

    working_points: int = 5000  # points a frame that take part in the fit; all are labelled
    canonical_tries: int = 4  # frames from which the model is fitted, at most; the lowest energy wins
    canonical_work: int = 82_000  # ... and two at least, but no more than make this many points to register in all
    canonical_share: float = 0.9  # frames with less than this share of the most points a frame has come last
    track: TrackConfig = field(default_factory=TrackConfig)
    cluster: ClusterConfig = field(default_factory=ClusterConfig)
    trial: TrialConfig = field(default_factory=TrialConfig)
    repair: RepairConfig = field(default_factory=RepairConfig)
    rest: RestConfig = field(default_factory=RestConfig)
    label: LabelConfig = field(default_factory=LabelConfig)
    seam: SeamConfig = field(default_factory=SeamConfig)
    project: ProjectConfig = field(default_factory=ProjectConfig)


PRESETS = {"direct": FitConfig()}


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
        elif isinstance(value, bool) or not isinstance(value, (int, float)):
            raise InputError(f"{where}: {key} must be a number, this is {value!r}")
        else:
            changed[key] = type(known[key])(value)
    return type(config)(**changed)

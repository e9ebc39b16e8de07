"""What the benchmark runs: every sequence with ground truth, and some of them made harder."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from rearticulate.errors import InputError
from rearticulate.io import load_sequence, load_truth
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth import bundled, perturb

Recording = tuple[PointSequence, GroundTruth]

# the paper's split; its other robots are for training and validation
PAPER_TEST = ("kinova", "ur5", "bolt", "allegro", "barrett", "reachy", "icub", "jvrc", "a1", "solo")
PAPER_VALIDATION = ("panda", "nao")
ROBOTS = (*PAPER_TEST, "nao", "panda", "atlas", "baxter", "laikago", "iiwa")
HOUSEHOLD = (
    "base_cabinet",
    "cabinet",
    "dishwasher",
    "kitchen_island",
    "microwave",
    "refrigerator",
    "safety_switch",
    "sink_cabinet",
)
BUNDLED = tuple(bundled.names())
ROBUSTNESS = ("nao", "solo", "allegro", "refrigerator")

PERTURBATIONS: dict[str, Callable[[PointSequence, GroundTruth], Recording]] = {
    "noise_1mm": lambda s, t: perturb.add_noise(s, t, 0.001),
    "noise_2mm": lambda s, t: perturb.add_noise(s, t, 0.002),
    "points_1024": lambda s, t: perturb.resample(s, t, 1024),
    "points_20000": lambda s, t: perturb.resample(s, t, 20_000),
    "half_of_one_frame": lambda s, t: perturb.drop_random_half(s, t, len(s) // 2),
    "one_side_of_one_frame": lambda s, t: perturb.drop_one_sided_half(s, t, len(s) // 2),
    "one_side_of_all_frames": perturb.one_sided,
    "moving_root": perturb.moving_root,
    "every_second_frame": lambda s, t: perturb.every_nth_frame(s, t, 2),
    "every_third_frame": lambda s, t: perturb.every_nth_frame(s, t, 3),
    "frames_30": lambda s, t: perturb.interpolate(s, t, 30),
}

# situations that break the assumptions of the fit
BROKEN: dict[str, Callable[[PointSequence, GroundTruth], Recording]] = {
    "two_states": lambda s, t: perturb.select_frames(s, t, [0, len(s) - 1]),
    "own_scales": lambda s, t: perturb.rescale(s, t, (1.004, 0.990, 0.992, 0.951)),
}
CAPTURED = ("fridge_fixed2", "range_fixed4", "refrigerator_c1", "base_cabinet_c2", "cabinet_c1")  # what cameras see


@dataclass(frozen=True)
class Case:
    """One fit: an object as it is, or perturbed."""

    object: str
    perturbation: str = ""

    @property
    def name(self) -> str:
        return f"{self.object}/{self.perturbation}" if self.perturbation else self.object

    @property
    def path(self) -> Path:
        """The sequence below the data folder."""
        folder = "roboart" if self.object in ROBOTS else "capture" if self.object in CAPTURED else "household"
        return Path(folder) / f"{self.object}.npz"

    def load(self, folder: Path) -> Recording:
        path = bundled.path(self.object) if self.object in BUNDLED else folder / self.path
        sequence, truth = load_sequence(path), load_truth(path.with_suffix(".truth.npz"))
        change = {**PERTURBATIONS, **BROKEN}.get(self.perturbation)
        return change(sequence, truth) if change else (sequence, truth)


SETS = {
    "roboart": [Case(name) for name in ROBOTS],
    "household": [Case(name) for name in HOUSEHOLD],
    "robustness": [Case(name, change) for name in ROBUSTNESS for change in ("", *PERTURBATIONS)],
}
ALL = list(dict.fromkeys(case for cases in SETS.values() for case in cases))


def find_case(name: str) -> Case:
    """The case of a name such as `nao` or `nao/noise_1mm`."""
    return Case(*name.split("/"))


def data_folder() -> Path:
    """$REARTICULATE_DATA, or ../shared/data beside a checkout of the repository. Raises InputError if there is none."""
    beside = Path(__file__).resolve().parents[4] / "shared" / "data"
    folder = Path(os.environ.get("REARTICULATE_DATA") or beside)
    if not folder.is_dir():
        raise InputError(f"{folder}: no sequences with ground truth there; set REARTICULATE_DATA")
    return folder

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
EVERYDAY_ROBOTS = ("b1", "fetch", "gen3", "inspire", "k1", "lite6", "mini_cheetah", "so101", "z1")
EVERYDAY = (
    *EVERYDAY_ROBOTS,
    "carton",
    "carton_f10",
    "cutter",
    "cutter_f10",
    "ext_table",
    "eyeglasses",
    "folding_rule",
    "kettle",
    "lighter",
    "office_chair",
    "office_chair_f10",
    "pliers",
    "scissors",
    "ss_drawers",
    "ss_drawers_f10",
    "ss_range",
    "ss_wardrobe",
    "stapler",
    "stapler_f10",
    "syringe",
    "telescope_arm",
    "telescope_arm_f10",
    "toaster",
    "toaster_f10",
)
WITH_SLIDES = (  # of EVERYDAY
    "fetch",
    "cutter",
    "cutter_f10",
    "ext_table",
    "office_chair",
    "office_chair_f10",
    "ss_drawers",
    "ss_drawers_f10",
    "ss_range",
    "ss_wardrobe",
    "syringe",
    "telescope_arm",
    "telescope_arm_f10",
    "toaster",
    "toaster_f10",
)
CAPTURE = (  # what depth cameras see: 11 viewpoints, NAME_cN of another set by N cameras, others
    "cabinet_11views",
    "nao_c1",
    "allegro_c1",
    "refrigerator_c1",
    "cabinet_c1",
    "base_cabinet_c2",
    "panda_fixed1",
    "panda_fixed4",
    "panda_hand",
    "allegro_fixed2",
    "fridge_fixed1",
    "fridge_fixed2",
    "fridge_hand",
    "range_fixed2",
    "range_fixed4",
    "range_scan1",
)
CAPTURED = ("fridge_fixed2", "range_fixed4", "refrigerator_c1", "base_cabinet_c2", "cabinet_c1")  # of CAPTURE
SETS = {"roboart": ROBOTS, "household": HOUSEHOLD, "everyday": EVERYDAY, "capture": CAPTURE}  # by their folders
BUNDLED = tuple(f"bundled_{name}" for name in bundled.names())
ROBUSTNESS = ("nao", "solo", "allegro", "refrigerator")

Change = Callable[[PointSequence, GroundTruth], Recording]

PERTURBATIONS: dict[str, Change] = {
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
BROKEN: dict[str, Change] = {
    "two_states": lambda s, t: perturb.select_frames(s, t, [0, len(s) - 1]),
    "own_scales": lambda s, t: perturb.rescale(s, t, (1.004, 0.990, 0.992, 0.951)),
}

# the same recording told otherwise, which should change nothing
RETOLD: dict[str, Change] = {
    "points_5000": lambda s, t: perturb.resample(s, t, 5000),
    "other_world": perturb.other_world,
}


@dataclass(frozen=True)
class Case:
    """One fit: an object as it is, or perturbed."""

    object: str
    perturbation: str = ""

    @property
    def name(self) -> str:
        return f"{self.object}/{self.perturbation}" if self.perturbation else self.object

    def path(self, folder: Path) -> Path:
        """The sequence below the data folder, or in the package."""
        for place, names in SETS.items():
            if self.object in names:
                return folder / place / f"{self.object}.npz"
        return bundled.path(self.object.removeprefix("bundled_"))

    def load(self, folder: Path) -> Recording:
        path = self.path(folder)
        sequence, truth = load_sequence(path), load_truth(path.with_suffix(".truth.npz"))
        change = {**PERTURBATIONS, **BROKEN, **RETOLD}.get(self.perturbation)
        return change(sequence, truth) if change else (sequence, truth)


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

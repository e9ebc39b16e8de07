"""Record a parametric human with ball joints: `python scripts/record_human.py human.npz [--seed N]`.

The human is anny 0.6.2 (Naver, Apache-2.0; its mesh comes from MakeHuman, CC0): `pip install anny==0.6.2`. Ten frames
of 4096 points, each sampled afresh; the skin bends at the joints, so no part is quite rigid. The ground truth, beside
it, holds the body part of every point and the motion of its main bone.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import anny
import numpy as np
import torch

from rearticulate.geometry.se3 import exp_se3, inverse
from rearticulate.io.sequence import save_sequence
from rearticulate.io.truth import save_truth
from rearticulate.records import GroundTruth, PointSequence
from rearticulate.synth.surfaces import sample

FRAMES, POINTS = 10, 4096
# part: its main bone, the part it hangs on, how far it swings (degrees), and what the names of its bones start with
PARTS = {
    "trunk": ("spine03", "", 0, ("root", "pelvis", "spine", "clavicle", "shoulder")),
    "head": ("head", "trunk", 25, ("neck", "head", "eye")),
}
for _side in "LR":
    PARTS |= {
        f"upper arm {_side}": (f"upperarm01.{_side}", "trunk", 40, ("upperarm",)),
        f"forearm {_side}": (f"lowerarm01.{_side}", f"upper arm {_side}", 45, ("lowerarm",)),
        f"hand {_side}": (f"wrist.{_side}", f"forearm {_side}", 30, ("wrist", "finger", "metacarpal")),
        f"thigh {_side}": (f"upperleg01.{_side}", "trunk", 35, ("upperleg",)),
        f"shank {_side}": (f"lowerleg01.{_side}", f"thigh {_side}", 35, ("lowerleg",)),
        f"foot {_side}": (f"foot.{_side}", f"shank {_side}", 25, ("foot", "toe")),
    }
FIRST_BONE = {"head": "neck01"}  # where a part is turned, if not at its main bone


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    sequence, truth = record(np.random.default_rng(options.seed))
    save_truth(options.out.with_suffix(".truth.npz"), truth)
    save_sequence(options.out, sequence)


def record(rng: np.random.Generator) -> tuple[PointSequence, GroundTruth]:
    """The sequence and its ground truth."""
    human = anny.Anny().to(dtype=torch.float32)
    bones = list(human.bone_labels)
    with torch.no_grad():
        posed = human(pose_parameters=torch.from_numpy(postures(bones, rng)))
    vertices, T = posed["vertices"].double().numpy(), posed["bone_poses"].double().numpy()
    faces, part = np.asarray(human.faces), part_of_faces(human, bones)
    clouds, labels = [], []
    for v in vertices:
        cloud, face = sample(v[faces], POINTS, rng)
        clouds.append(cloud)
        labels.append(part[face])
    main_bones = [bones.index(bone) for bone, *_ in PARTS.values()]
    poses = T[:, main_bones] @ inverse(T[:1, main_bones])
    names = list(PARTS)
    parent = np.array([names.index(above) if above else -1 for _, above, *_ in PARTS.values()])
    return PointSequence.from_arrays(clouds), GroundTruth(tuple(labels), poses, parent, poses[:0])


def postures(bones: list[str], rng: np.random.Generator) -> np.ndarray:
    """(F, bones, 4, 4) turns of all bones: every part swings about two axes, each at its own pace."""
    turns = np.tile(np.eye(4, dtype=np.float32), (FRAMES, len(bones), 1, 1))
    time = np.arange(FRAMES)
    for name, (bone, _, degrees, _) in PARTS.items():
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
        swing = np.sin(rng.uniform(0, 2 * np.pi, 2)[:, None] + rng.uniform(0.3, 0.5, 2)[:, None] * time)
        vector = np.deg2rad(degrees) * 0.7 * swing.T @ axes
        place = bones.index(FIRST_BONE.get(name, bone))
        turns[:, place] = exp_se3(np.concatenate([vector, np.zeros_like(vector)], axis=1))
    return turns


def part_of_faces(human: anny.Anny, bones: list[str]) -> np.ndarray:
    """(faces,) the part whose bones move most of a face."""
    starts = [start for *_, start in PARTS.values()]
    sides = [name[-1] if name[-2:] in (" L", " R") else "" for name in PARTS]
    of_bone = np.array(
        [
            next(
                p
                for p, start in enumerate(starts)
                if bone.startswith(start) and (not sides[p] or bone.endswith(sides[p]))
            )
            for bone in bones
        ]
    )
    weights = np.zeros((human.vertex_bone_indices.shape[0], len(PARTS)))
    rows = np.arange(len(weights))[:, None]
    np.add.at(weights, (rows, of_bone[human.vertex_bone_indices.numpy()]), human.vertex_bone_weights.numpy())
    return weights[np.asarray(human.faces)].sum(axis=1).argmax(axis=1)


if __name__ == "__main__":
    main()

"""The final fit: its kinematics are ours, what is exact stays, and what is off gets better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs rearticulate[paper]")

import torch

from oracle import in_spacings
from rearticulate.config import NeuralConfig
from rearticulate.geometry.se3 import adjoint, exp_se3, inverse, transform
from rearticulate.joints.articulated import Articulated, normalise_twists
from rearticulate.methods.paper.refine import ScrewTree, refine, screw_steps
from rearticulate.methods.paper.relax import make_scene
from rearticulate.observe.flow import SceneFlow
from rearticulate.observe.frames import make_frames
from rearticulate.synth.articulated import record
from rearticulate.synth.objects import cabinet

C = 1
QUICK = NeuralConfig(final_iterations=150)


@pytest.fixture(scope="module")
def truth_tree():
    """A cabinet's frames, its true tree in their units, labels (M,), and the flow between frames without error."""
    sequence, truth = record(cabinet(), frames=4, points=700, step_deg=20, moving_root=True, seed=0)
    frames = make_frames(sequence.points)
    labels = np.concatenate(truth.labels)[frames.order]
    T = in_spacings(frames, truth.poses, C)
    relative = inverse(T[:, truth.parent.clip(min=0)]) @ T
    revolute = np.array([k != "prismatic" for k in truth.joint_type])
    axis, point = (getattr(truth, f"joint_{k}") for k in ("axis", "point"))
    at_c = truth.poses[C, truth.parent.clip(min=0)]
    axis = np.einsum("pij,pj->pi", at_c[:, :3, :3], axis)
    point = (transform(at_c, point) - frames.centre) / frames.unit
    twist = np.where(
        revolute[:, None], np.concatenate([axis, np.cross(point, axis)], 1), np.concatenate([0 * axis, axis], 1)
    )
    twist[0] = 0
    q = (truth.joint_state - truth.joint_state[C]) / np.where(revolute, 1.0, frames.unit)
    q[:, 0] = 0
    tree = Articulated(truth.parent, twist, revolute, q, T[:, 0])
    np.testing.assert_allclose(tree.forward(), T, atol=1e-6)
    assert np.allclose(relative[C], np.eye(4))
    flow = []
    for f in range(3):
        here = frames.points[frames.rows(f)]
        step = (T[f + 1] @ inverse(T[f]))[labels[frames.rows(f)]]
        flow.append(SceneFlow(here, transform(step, here) - here))
    return frames, tree, labels, tuple(flow)


def silent(stage, fraction):
    pass


def test_steps_are_the_exponential_of_the_screw():
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(5, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    origin, turning = rng.normal(size=(5, 3)), np.array([1.0, 0, 1, 0, 1])
    q = np.concatenate([[np.zeros(5), np.full(5, np.pi)], rng.normal(size=(3, 5))])
    twist = np.where(
        turning[:, None] > 0, np.concatenate([axis, np.cross(origin, axis)], 1), np.concatenate([0 * axis, axis], 1)
    )
    steps = screw_steps(*(torch.from_numpy(a) for a in (axis, origin, q, turning)))
    np.testing.assert_allclose(steps.numpy(), exp_se3(q[..., None] * twist)[..., :3, :], atol=1e-12)


def test_gradients_at_zero_and_half_a_turn():
    rng = torch.Generator().manual_seed(0)
    axis = torch.nn.functional.normalize(torch.randn(2, 3, generator=rng, dtype=torch.float64), dim=1)
    origin = torch.randn(2, 3, generator=rng, dtype=torch.float64)
    q = torch.tensor([[0.0, 0.0], [torch.pi, torch.pi], [1e-9, -0.3]], dtype=torch.float64)
    inputs = [t.requires_grad_() for t in (axis, origin, q)]
    assert torch.autograd.gradcheck(lambda a, o, v: screw_steps(a, o, v, torch.tensor([1.0, 0.0])), inputs)


def test_the_tree_goes_in_and_comes_out_unchanged(truth_tree):
    frames, tree, labels, flow = truth_tree
    scene = make_scene(frames, C, flow, 0.3)
    model = ScrewTree(tree, labels[frames.rows(C)], scene)
    moved = transform(scene.poses_in(tree.forward())[:, labels[frames.rows(C)]], scene.canonical_points)
    np.testing.assert_allclose(model().detach().numpy(), moved, atol=1e-5)
    back = model.read(tree)
    np.testing.assert_allclose(back.forward(), tree.forward(), atol=1e-3)
    np.testing.assert_array_equal(back.q[C], 0)
    np.testing.assert_array_equal(back.T_root[C], np.eye(4))


def shaken(tree, seed=0):
    rng = np.random.default_rng(seed)
    twist = (
        adjoint(exp_se3(rng.normal(size=(tree.n_parts, 6)) * np.r_[[0.1] * 3, [1.5] * 3])) @ tree.twist[..., None]
    )[..., 0]
    twist[1:] = normalise_twists(twist[1:], tree.revolute[1:])
    q = tree.q + rng.normal(size=tree.q.shape) * np.where(tree.revolute, 0.5, 8.0)
    q[C], q[:, 0] = 0, 0
    return replace(tree, twist=twist, q=q)


def error(frames, tree, other, labels):
    rows = frames.rows(C)
    gap = transform(tree.forward()[:, labels[rows]], frames.points[rows]) - transform(
        other.forward()[:, labels[rows]], frames.points[rows]
    )
    return np.linalg.norm(gap, axis=-1).mean()


def test_what_is_off_gets_better_and_repeats(truth_tree):
    frames, tree, labels, flow = truth_tree
    start = shaken(tree)
    fitted = refine(frames, C, start, labels, flow, QUICK, silent)
    assert error(frames, fitted, tree, labels) < 0.3 * error(frames, start, tree, labels)
    np.testing.assert_array_equal(fitted.forward()[C], np.broadcast_to(np.eye(4), (tree.n_parts, 4, 4)))
    lengths = np.linalg.norm(fitted.axes[1:], axis=1)
    np.testing.assert_allclose(lengths, 1, atol=1e-6)
    again = refine(frames, C, start, labels, flow, QUICK, silent)
    np.testing.assert_array_equal(again.q, fitted.q)


@pytest.mark.parametrize("term", ["chamfer", "emd", "flow"])
def test_every_term_can_be_left_out(truth_tree, term):
    frames, tree, labels, flow = truth_tree
    start = shaken(tree)
    config = replace(QUICK, **{term: 0.0})
    fitted = refine(frames, C, start, labels, flow, config, silent)
    assert error(frames, fitted, tree, labels) < 0.7 * error(frames, start, tree, labels)

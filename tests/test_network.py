"""The network's geometry and features: neighbourhoods by brute force, and what the features must not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from rearticulate.geometry.nearest import rms_radius
from rearticulate.network.pyramid import ANCHORS, MIN_POINTS, NEIGHBOURS, RADII, build_pyramid, level_sizes
from rearticulate.synth.objects import arm
from rearticulate.synth.surfaces import sample

pytest.importorskip("torch", reason="needs rearticulate[paper]")

import torch

from rearticulate.network.correspond import mutual_matches
from rearticulate.network.inference import Network
from rearticulate.training.matching import matching_loss, scores
from rearticulate.training.pointnet import FEATURES, Batch, CorrespondenceNet


@pytest.fixture(scope="module")
def cloud():
    return sample(np.concatenate(arm().surfaces), 512, np.random.default_rng(0))[0]


@pytest.fixture(scope="module")
def net():
    torch.manual_seed(0)
    return CorrespondenceNet().eval()


def features(net, *clouds):
    pyramids = [build_pyramid(c, rms_radius(clouds[0])) for c in clouds]
    with torch.no_grad():
        f = net(Batch(pyramids)).numpy()
    return np.stack([row[np.argsort(p.order)] for row, p in zip(f, pyramids, strict=True)])


def test_levels_are_nested_samples_of_the_cloud(cloud):
    pyramid = build_pyramid(cloud, rms_radius(cloud))
    assert sorted(pyramid.order) == list(range(len(cloud)))
    back = pyramid.points * rms_radius(cloud) + cloud.mean(axis=0)
    np.testing.assert_allclose(back, cloud[pyramid.order], atol=1e-6)
    assert rms_radius(pyramid.points) == pytest.approx(1, abs=1e-6)
    assert level_sizes(len(cloud)) == [512, 128, 32, 8]


def test_neighbours_are_the_nearest_within_the_radius(cloud):
    pyramid = build_pyramid(cloud, rms_radius(cloud))
    sizes, x = level_sizes(len(cloud)), pyramid.points.astype(float)
    for level, radius in enumerate(RADII, 1):
        for found, source, k, reach in (
            (pyramid.near[level - 1], level - 1, NEIGHBOURS[0], radius),
            (pyramid.wide[level - 1], level, NEIGHBOURS[1], 2 * radius),
        ):
            d = np.linalg.norm(x[: sizes[level], None] - x[None, : sizes[source]], axis=-1)
            for own, rows in zip(d, found, strict=True):
                nearest = set(np.argsort(own, kind="stable")[:k])
                assert set(rows) <= {j for j in nearest if own[j] < reach + 1e-5}
                assert {j for j in nearest if own[j] < reach - 1e-5} <= set(rows)


def test_a_linear_function_at_an_anchor_is_interpolated_exactly(cloud):
    pyramid = build_pyramid(cloud, rms_radius(cloud))
    for level, (rows, weights) in enumerate(zip(pyramid.anchors, pyramid.weights, strict=True)):
        np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-6)
        assert rows.shape == (level_sizes(len(cloud))[level], ANCHORS)
        own = level_sizes(len(cloud))[level + 1]
        spread = (pyramid.points[rows] * weights[..., None]).sum(axis=1)
        np.testing.assert_allclose(spread[:own], pyramid.points[:own], atol=1e-4)


def test_features_belong_to_the_points(net, cloud):
    """Another order of the points, another place and another unit change nothing."""
    own = features(net, cloud)[0]
    assert own.shape == (len(cloud), FEATURES)
    shuffled = np.random.default_rng(1).permutation(len(cloud))
    np.testing.assert_allclose(features(net, cloud[shuffled])[0], own[shuffled], atol=1e-4)
    np.testing.assert_allclose(features(net, 1000 * (cloud + np.array([3.0, -2.0, 1.0])))[0], own, atol=1e-4)


def test_a_batch_is_its_clouds_one_by_one(net, cloud):
    other = cloud[::-1] * [1.0, 0.9, 1.1]
    both = features(net, cloud, other)
    np.testing.assert_allclose(both[0], features(net, cloud)[0], atol=1e-5)
    assert np.abs(both[0] - both[1]).max() > 0.1


def test_the_smallest_cloud_has_three_points_on_top():
    points = np.random.default_rng(0).normal(size=(MIN_POINTS, 3))
    pyramid = build_pyramid(points, 1.0)
    assert [len(n) for n in pyramid.near][-1] == ANCHORS


def test_copies_of_points_do_no_harm():
    points = np.repeat(np.random.default_rng(0).normal(size=(40, 3)), 6, axis=0)
    assert sorted(build_pyramid(points, 1.0).order) == list(range(240))


def test_the_loss_is_the_mean_cross_entropy_of_the_known_rows():
    rng = torch.Generator().manual_seed(0)
    a, b = torch.randn(2, 5, 8, generator=rng), torch.randn(2, 7, 8, generator=rng)
    to_b = torch.tensor([[0, 6, -1, 2, 3], [-1, -1, 4, 5, 1]])
    rows = torch.tensor([[0, 1, 2], [2, 1, 4]])
    p = scores(a, b).softmax(dim=-1)
    known = [(0, 0), (0, 1), (1, 2), (1, 4)]
    expected = -np.mean([float(p[i, j, to_b[i, j]].log()) for i, j in known])
    assert float(matching_loss(a, b, to_b, rows)) == pytest.approx(expected, rel=1e-5)
    assert float(matching_loss(a, b, torch.full_like(to_b, -1), rows)) == 0


def test_the_network_at_work_is_the_one_that_was_trained(net, cloud):
    pyramid = build_pyramid(cloud, rms_radius(cloud))
    own = Network({name: p.detach().numpy() for name, p in net.named_parameters()}).features(pyramid)
    with torch.no_grad():
        np.testing.assert_allclose(own, net(Batch([pyramid]))[0].numpy(), atol=1e-5)


def test_matches_are_mutual_and_distinct():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(40, 4)), rng.normal(size=(50, 4))
    d = np.linalg.norm(a[:, None] - b[None], axis=-1)
    for ratio in (0.6, 0.9, 1.0):
        i, j = mutual_matches(a, b, ratio)
        expected = [
            (r, int(row.argmin()))
            for r, row in enumerate(d)
            if d[:, row.argmin()].argmin() == r and np.sort(row)[0] <= ratio * np.sort(row)[1]
        ]
        assert list(zip(i, j, strict=True)) == expected

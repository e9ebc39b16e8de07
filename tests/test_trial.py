"""Trial merges: borders between fragments, and how many points are tried."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from rearticulate.geometry.nearest import nearest
from rearticulate.observe.frames import make_frames
from rearticulate.parts.relaxed import Relaxed
from rearticulate.parts.trial import Trials, shared_border, trial_merge


def test_borders_are_symmetric_and_as_long_as_the_common_edge():
    x, y = np.meshgrid(np.arange(30.0), np.arange(20.0))
    points = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    labels = np.where(points[:, 0] < 10, 0, np.where(points[:, 1] < 15, 1, 2))
    near = nearest(KDTree(points), points, k=9)[1][:, 1:]
    border = shared_border(near, labels, 4)
    np.testing.assert_allclose(border, border.T)
    assert border[0, 1] == pytest.approx(15 * 3 / 8, rel=0.15)
    assert border[0, 2] == pytest.approx(5 * 3 / 8, rel=0.35)
    assert border[0, 1] > border[1, 2] * 0.6
    assert not border[3].any()


@pytest.mark.parametrize(("F", "expected"), [(30, 50), (10, 50), (4, 150), (2, 450)])
def test_a_short_sequence_takes_more_points_of_each_frame(F, expected):
    rng = np.random.default_rng(0)
    frames = make_frames([rng.uniform(0, 10, (500, 3)) for _ in range(F)])
    trials = Trials(frames, 0, rng)
    chosen = trials.subset(np.zeros(500, dtype=int), 0, 50)
    assert len(chosen) == len(np.unique(chosen)) == expected


def test_a_fragment_that_slides_in_itself_joins_the_part_around_it():
    """A strip in a resting wall fits the wall and, by its translation, a sliding block as well."""
    rng = np.random.default_rng(3)
    shift = np.array([0.0, 4.0, 0.0])

    def cloud(f):
        wall = np.column_stack([np.zeros(4000), rng.uniform(0, 60, 4000), rng.uniform(0, 40, 4000)])
        end = np.column_stack([rng.uniform(-40, 0, 3000), np.zeros(3000), rng.uniform(0, 40, 3000)])
        block = np.column_stack([rng.uniform(1.2, 18, 1500), 20 + rng.uniform(0, 18, (1500, 2))])
        face = rng.integers(0, 3, 1500)
        block[np.arange(1500), face] = np.array([1.2, 20.0, 20.0])[face]
        return np.concatenate([wall, end, block + f * shift])

    clouds = [cloud(f) for f in range(3)]
    frames = make_frames(clouds)
    c = 1
    metres = frames.points * frames.unit + frames.centre
    labels = np.where(metres[:, 0] > 0.6, 1, 0)
    strip = (labels == 0) & (np.abs(metres[:, 1] - 30) < 6) & (np.abs(metres[:, 2] - 20) < 8)
    labels[strip] = 2
    T = np.tile(np.eye(4), (3, 3, 1, 1))
    for part in (1, 2):
        T[:, part, :3, 3] = (np.arange(3) - c)[:, None] * shift / frames.unit
    model = trial_merge(frames, c, Relaxed(T, labels), 0.045, np.random.default_rng(0))
    assert model.n_parts == 2
    rest = np.bincount(model.labels[labels == 0]).argmax()
    assert (model.labels[strip] == rest).all()
    assert (model.labels[labels == 1] != rest).all()

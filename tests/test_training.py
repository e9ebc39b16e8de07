"""Training: it learns, it goes on where it was, and its files are refused when they are not its own."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rearticulate.errors import InputError
from rearticulate.synth.objects import random_tree
from rearticulate.training.pairs import PairConfig, make_subject

pytest.importorskip("torch", reason="needs rearticulate[paper]")
pytest.importorskip("safetensors", reason="needs rearticulate[paper]")

import torch

from rearticulate.network.correspond import mutual_matches, point_features
from rearticulate.network.inference import Network, load_network
from rearticulate.training import train
from rearticulate.training.train import Run, TrainConfig, choose_device, learning_rate
from rearticulate.training.weights import load_tensors, save_network

CPU = torch.device("cpu")
TINY = TrainConfig(steps=4, points=(256,), points_per_batch=1024, matched=64, warmup=1, validate_every=2,
                   validation_batches=1, pair=PairConfig(one_sided=0.0, hole=0.0))  # fmt: skip


class Trees:
    """Subjects without robots: quick to make and always there."""

    def draw(self, rng):
        return make_subject(random_tree(4, seed=int(rng.integers(100))), rng)


@pytest.fixture(autouse=True)
def trees(monkeypatch):
    monkeypatch.setattr(train, "Subjects", Trees)


def weights(run):
    return {name: p.detach().clone() for name, p in run.net.named_parameters()}


def run_to(folder, config, resume=False):
    run = Run(config, folder, CPU, resume)
    seen = []
    run.train(lambda step, loss: seen.append(loss), workers=0)
    return run, seen


def test_a_run_goes_on_with_the_same_bits(tmp_path):
    whole, losses = run_to(tmp_path / "whole", TINY)
    _, early = run_to(tmp_path / "parts", replace(TINY, steps=2, cooldown=1e-9))
    rates = [learning_rate(c, 1) for c in (TINY, replace(TINY, steps=2, cooldown=1e-9))]
    assert rates[0] == rates[1]
    second, late = run_to(tmp_path / "parts", TINY, resume=True)
    assert early + late == losses
    for name, p in weights(whole).items():
        assert torch.equal(p, weights(second)[name]), name
    assert [note["step"] for note in second.history] == [2, 4]


def test_it_learns(tmp_path):
    _, losses = run_to(tmp_path, replace(TINY, steps=30, warmup=5, rate=3e-3))
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:5])


def test_processes_share_the_pairs(monkeypatch):
    monkeypatch.setattr(train, "make_example", lambda subjects, config, number: number)
    numbers = []
    for rank in range(2):
        run = Run(TINY, None, CPU, resume=False)  # type: ignore[arg-type]
        run.rank, run.world = rank, 2
        numbers.append(list(run._examples(workers=0)))
    assert numbers == [[0, 2, 4, 6], [1, 3, 5, 7]]


def test_the_rate_rises_stays_and_falls():
    config = TrainConfig(steps=1000, warmup=100, cooldown=0.2, rate=1.0)
    rates = [learning_rate(config, s) for s in range(1000)]
    assert rates[0] == pytest.approx(0.01)
    assert rates[99:800] == [1.0] * 701
    assert all(a > b for a, b in pairwise(rates[801:]))
    assert 0 < rates[-1] < 0.01


def test_weights_come_back_and_strangers_are_refused(tmp_path):
    run, _ = run_to(tmp_path / "run", replace(TINY, steps=2))
    path = tmp_path / "w.safetensors"
    save_network(path, run.net, {"steps": 2})
    back = load_network(path)
    cloud = np.random.default_rng(0).normal(size=(200, 3))
    i, j = mutual_matches(point_features(back, cloud, 1.7), point_features(back, cloud, 1.7), ratio=0.9)
    np.testing.assert_array_equal(i, j)
    assert len(i) > 150, "equal clouds match point by point"
    assert load_tensors(path)[1] == {"steps": 2}
    with pytest.raises(InputError, match="something else"):
        load_network(tmp_path / "run" / "checkpoint.safetensors")
    path.write_bytes(b"\x80\x04" + b"x" * 50)
    with pytest.raises(InputError, match=r"w\.safetensors"):
        load_network(path)
    with pytest.raises(InputError, match="no such file"):
        load_network(tmp_path / "none.safetensors")


def test_too_few_points_are_one_clear_line():
    with pytest.raises(InputError, match="192 points a frame, one has 10"):
        point_features(Network({}), np.zeros((10, 3)), 1.0)


def test_devices():
    assert choose_device("cpu") == CPU
    with pytest.raises(InputError, match="auto, cpu or cuda"):
        choose_device("gpu")
    if not torch.cuda.is_available():
        assert choose_device("auto") == CPU
        with pytest.raises(InputError, match="no GPU"):
            choose_device("cuda")

"""Training of the correspondence network on pairs that are made while it runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader, Dataset

from rearticulate.bounds import Count, CountOrZero, NotNegative, Positive, Seed, Settings, Share
from rearticulate.errors import InputError
from rearticulate.network.pyramid import Pyramid, build_pyramid
from rearticulate.training.matching import matching_loss
from rearticulate.training.pairs import Pair, PairConfig, make_pair
from rearticulate.training.pointnet import Batch, CorrespondenceNet
from rearticulate.training.subjects import Subjects
from rearticulate.training.weights import load_tensors, save_tensors

VALIDATION = 2**20  # batches from this number on are never trained on


@dataclass(frozen=True)
class TrainConfig(Settings):
    """A training run. The same seed and number of processes give the same pairs."""

    steps: Count = 40_000
    points: tuple[Count, ...] = (1024, 2048, 4096)  # points a cloud; one of these a batch
    points_per_batch: Count = 16_384  # of all clouds of a batch
    matched: Count = 256  # points of a cloud that are matched each way
    rate: Positive = 2e-3
    warmup: CountOrZero = 500
    cooldown: Share = 0.3  # share of the steps, at the end, in which the rate falls to zero
    decay: NotNegative = 1e-2
    validate_every: Count = 500
    validation_batches: Count = 8
    mixed: bool = False  # compute in bfloat16 where that is safe
    seed: Seed = 0
    pair: PairConfig = field(default_factory=PairConfig)


@dataclass(frozen=True)
class Example:
    """A batch of pairs: pyramids of all clouds (a, b, a, b, ...), and in their order the true rows and asked rows."""

    pyramids: list[Pyramid]
    to_b: Tensor
    to_a: Tensor
    ask_a: Tensor
    ask_b: Tensor


class Pairs(Dataset):
    """Batch number i of a run: made from the seed and i alone, so a run can go on anywhere."""

    def __init__(self, config: TrainConfig, numbers: range) -> None:
        self._config, self._numbers = config, numbers
        self._subjects: Subjects | None = None

    def __len__(self) -> int:
        return len(self._numbers)

    def __getitem__(self, index: int) -> Example:
        self._subjects = self._subjects or Subjects()
        return make_example(self._subjects, self._config, self._numbers[index])


def make_example(subjects: Subjects, config: TrainConfig, number: int) -> Example:
    """One batch of pairs of the same number of points."""
    rng = np.random.default_rng([config.seed, number])
    n = int(rng.choice(config.points))
    pairs = [
        make_pair(subjects.draw(rng), n, config.pair, rng) for _ in range(max(1, config.points_per_batch // (2 * n)))
    ]
    whole = [_prepare(pair, min(config.matched, n), rng) for pair in pairs]
    pyramids = [pyramid for first, second, *_ in whole for pyramid in (first, second)]
    rows = [torch.from_numpy(np.stack(column)) for column in list(zip(*whole, strict=True))[2:]]
    return Example(pyramids, *rows)


def _prepare(pair: Pair, matched: int, rng: np.random.Generator) -> tuple[Any, ...]:
    """Pyramids of both clouds; the true rows in their orders; rows to ask for, those that have a counterpart first."""
    a, b = build_pyramid(pair.a, pair.scale), build_pyramid(pair.b, pair.scale)
    place_a, place_b = np.argsort(a.order), np.argsort(b.order)
    to_b = np.where(pair.to_b >= 0, place_b[pair.to_b], -1)[a.order]
    to_a = np.where(pair.to_a >= 0, place_a[pair.to_a], -1)[b.order]
    ask = [_known_first(truth, rng)[:matched] for truth in (to_b, to_a)]
    return a, b, to_b, to_a, *ask


def _known_first(truth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    shuffled = rng.permutation(len(truth))
    return shuffled[np.argsort(truth[shuffled] < 0, kind="stable")]


def example_loss(net: Callable[[Batch], Tensor], example: Example, device: torch.device, mixed: bool) -> Tensor:
    """Matching loss of a batch, both ways."""
    batch = Batch(example.pyramids, device)
    with torch.autocast(device.type, torch.bfloat16, enabled=mixed):
        features = net(batch)
    a, b = features.float().unflatten(0, (-1, 2)).unbind(1)
    to_b, to_a, ask_a, ask_b = (x.to(device) for x in (example.to_b, example.to_a, example.ask_a, example.ask_b))
    return (matching_loss(a, b, to_b, ask_a) + matching_loss(b, a, to_a, ask_b)) / 2


class Run:
    """One training run in a folder: `checkpoint.safetensors` holds all that is needed to go on, its history too."""

    def __init__(self, config: TrainConfig, folder: Path, device: torch.device, resume: bool) -> None:
        self.config, self.folder, self.device = config, folder, device
        self.rank, self.world = int(os.environ.get("RANK", "0")), int(os.environ.get("WORLD_SIZE", "1"))
        if self.world > 1:
            torch.distributed.init_process_group()
        torch.manual_seed(config.seed)
        self.net = CorrespondenceNet().to(device)
        self.optimiser = torch.optim.AdamW(self.net.parameters(), lr=config.rate, weight_decay=config.decay)
        self.step, self.history = 0, []
        if resume and self.checkpoint.exists():
            self._load()

    @cached_property
    def _unseen(self) -> list[Example]:
        data = Pairs(self.config, range(VALIDATION, VALIDATION + self.config.validation_batches))
        return [data[i] for i in range(len(data))]

    @property
    def checkpoint(self) -> Path:
        return self.folder / "checkpoint.safetensors"

    def train(self, progress: Callable[[int, float], None], workers: int) -> None:
        """Go on to the last step, with a checkpoint at every validation."""
        net = self.net if self.world == 1 else DistributedDataParallel(self.net)
        recent: list[float] = []
        for example in self._examples(workers):
            for group in self.optimiser.param_groups:
                group["lr"] = learning_rate(self.config, self.step)
            loss = example_loss(net, example, self.device, self.config.mixed)
            self.optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
            self.optimiser.step()
            self.step += 1
            recent.append(float(loss.detach()))
            progress(self.step, recent[-1])
            if self.step % self.config.validate_every == 0 or self.step == self.config.steps:
                self._note(float(np.mean(recent)))
                recent = []

    def close(self) -> None:
        """Leave the group of processes."""
        if self.world > 1:
            torch.distributed.destroy_process_group()

    def _examples(self, workers: int) -> Iterator[Example]:
        numbers = range(self.step * self.world + self.rank, self.config.steps * self.world, self.world)
        data = Pairs(self.config, numbers)
        return iter(DataLoader(data, batch_size=None, num_workers=workers, prefetch_factor=4 if workers else None))

    def _note(self, loss: float) -> None:
        """Validate, and keep everything that is needed to go on."""
        if self.rank:
            return
        self.history.append({"step": self.step, "loss": loss, **validate(self.net, self._unseen, self.device)})
        moments = {
            f"{key}.{name}": state[key]
            for name, p in self.net.named_parameters()
            for key, state in [(k, self.optimiser.state[p]) for k in ("exp_avg", "exp_avg_sq")]
        }
        weights = {f"weight.{name}": p for name, p in self.net.named_parameters()}
        save_tensors(self.checkpoint, {**weights, **moments}, {"step": self.step, "history": self.history})

    def _load(self) -> None:
        tensors, facts = load_tensors(self.checkpoint)
        self.step, self.history = facts["step"], facts["history"]
        with torch.no_grad():
            for name, p in self.net.named_parameters():
                p.copy_(tensors[f"weight.{name}"])
                moments = {key: tensors[f"{key}.{name}"].to(self.device) for key in ("exp_avg", "exp_avg_sq")}
                self.optimiser.state[p] = {"step": torch.tensor(float(self.step)), **moments}


def choose_device(name: str) -> torch.device:
    """The device of this process: auto takes a GPU if there is one; under torchrun each process takes its own."""
    if name not in ("auto", "cpu", "cuda"):
        raise InputError(f"--device must be auto, cpu or cuda, not {name!r}")
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError("--device cuda: PyTorch finds no GPU here")
    if name == "cpu" or not torch.cuda.is_available():
        return torch.device("cpu")
    device = torch.device("cuda", int(os.environ.get("LOCAL_RANK", "0")))
    torch.cuda.set_device(device)
    return device


def learning_rate(config: TrainConfig, step: int) -> float:
    """A linear start, constant, and a linear end."""
    left = (config.steps - step) / max(1.0, config.cooldown * config.steps)
    return config.rate * min(1.0, (step + 1) / max(1, config.warmup), left)


@torch.no_grad()
def validate(net: CorrespondenceNet, examples: Sequence[Example], device: torch.device) -> dict[str, float]:
    """Loss, and over all points the median error of the best match and the share below 0.1, in rms radii."""
    losses = [float(example_loss(net, example, device, mixed=False)) for example in examples]
    errors = np.concatenate([match_errors(net, example, device) for example in examples])
    return {
        "validation_loss": float(np.mean(losses)),
        "median_error": float(np.median(errors)),
        "within_tenth": float((errors < 0.1).mean()),
    }


def match_errors(net: CorrespondenceNet, example: Example, device: torch.device) -> np.ndarray:
    """Distance of the best match of every point of a that has a counterpart to that counterpart."""
    features = net(Batch(example.pyramids, device)).float()
    errors = []
    for i, truth in enumerate(example.to_b.numpy()):
        best = (features[2 * i] @ features[2 * i + 1].T).argmax(dim=1).cpu().numpy()
        known = truth >= 0
        points = example.pyramids[2 * i + 1].points
        errors.append(np.linalg.norm(points[best[known]] - points[truth[known]], axis=1))
    return np.concatenate(errors)

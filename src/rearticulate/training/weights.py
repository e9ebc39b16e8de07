"""What a training run keeps: safetensors, never a pickle."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

from rearticulate.errors import InputError
from rearticulate.io.atomic import atomic_file
from rearticulate.training.pointnet import CorrespondenceNet


def save_tensors(path: Path, tensors: dict[str, Tensor], facts: dict[str, Any]) -> None:
    """Write tensors with a dictionary of facts (JSON) beside them, whole or not at all."""
    whole = {name: t.detach().cpu().contiguous() for name, t in tensors.items()}
    with atomic_file(path) as temporary:
        save_file(whole, temporary, metadata={"facts": json.dumps(facts)})


def load_tensors(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """What `save_tensors` wrote. Raises InputError if the file is missing or not such a file."""
    try:
        with safe_open(path, framework="pt") as file:
            facts = json.loads((file.metadata() or {})["facts"])
            return {name: file.get_tensor(name) for name in file.keys()}, facts  # noqa: SIM118
    except FileNotFoundError:
        raise InputError(f"{path}: no such file of weights") from None
    except Exception as error:  # the library raises a type of its own for each kind of damage
        raise InputError(f"{path}: not a file of weights that can be read ({error})") from None


def save_network(path: Path, net: CorrespondenceNet, facts: dict[str, Any]) -> None:
    """Write the weights of a network, in half precision, and how they came about."""
    save_tensors(path, {name: p.half() for name, p in net.named_parameters()}, facts)

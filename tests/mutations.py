"""Good data made bad: edits of bytes, of words in a text, of values in a JSON tree, of arrays; repeatable by seed."""

from __future__ import annotations

import copy
import re
from typing import Any

import numpy as np

Rng = np.random.Generator

NUMBERS = (0, 1, 2**24, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63 - 1)
WORDS = (
    *("nan", "inf", "-inf", "1e300", "-1e300", "1e-320", "0", "-1", "-0.0", "2147483648", "9223372036854775807"),
    *("9223372036854775808", "9" * 23, "9" * 400, "0x10", "1_000", "1,5", "--1", "1e", "true", "null", "é", "x", ""),
    *("<script>", "../../x", "%s", "'", '"', "\x00", "A" * 5000, "vertex", "face", "float", "double", "uchar", "list"),
    *("ascii", "binary", "binary_compressed", "end_header", "element", "property", "POINTS", "WIDTH", "HEIGHT", "SIZE"),
    *("TYPE", "COUNT", "FIELDS", "DATA", "F", "U", "I"),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 99, 0.5, 2**63, 10**30, 1e300, -1e300, 5e-324, float("nan"), float("inf")),
    *("nan", "inf", "", "x", "base", "arm", "tip", "<script>", "../../x", "a\nb", "\u202e", "\ud800", "A" * 3000),
    *([], {}, [[]], [1, 2], [1, 2, 3], [0, 0, 0], [3, 0, 0], [float("nan")] * 3, [1e300] * 3, ["0", "0", "1"]),
    *([None] * 3, {"a": 1}, [True, False, True], [[1, 0, 0, 0]] * 4),
)


def bad_bytes(data: bytes, rng: Rng) -> bytes:
    """Flipped bits, holes, repeats, cuts, large numbers; more often near the beginning, where headers are."""
    out = bytearray(data)
    for _ in range(rng.integers(1, 4)):
        i = int(rng.integers(min(len(out), 400) if rng.random() < 0.6 else len(out))) if out else 0
        size = int(rng.choice([1, 4, 16, 256, 4096]))
        match int(rng.integers(7)):
            case 0 | 1:
                out[i : i + 1] = bytes([int(rng.integers(256))])
            case 2:
                del out[i : i + size]
            case 3:
                out[i:i] = rng.bytes(size)
            case 4:
                del out[i:]
            case 5:
                out[i : i + size] = bytes([int(rng.choice([0, 255]))]) * size
            case _:
                width = int(rng.choice([4, 8]))
                number = int(rng.choice(NUMBERS)) % 2 ** (8 * width)
                out[i : i + width] = number.to_bytes(width, "little" if rng.random() < 0.5 else "big")
    return bytes(out)


def bad_words(text: str, rng: Rng, head: int = 100_000) -> str:
    """Words replaced, swapped, doubled or left out in the first `head` characters."""
    pieces = re.split(r"([\s,]+)", text[:head])
    words = [i for i, piece in enumerate(pieces) if piece.strip(", \t\r\n")]
    for _ in range(rng.integers(1, 4)) if words else ():
        i, j = (int(k) for k in rng.choice(words[:60] if rng.random() < 0.6 else words, 2))
        match int(rng.integers(5)):
            case 0 | 1:
                pieces[i] = str(rng.choice(np.array(WORDS, dtype=object)))
            case 2:
                pieces[i], pieces[j] = pieces[j], pieces[i]
            case 3:
                pieces[i] = ""
            case _:
                pieces[i] = f"{pieces[i]} {pieces[i]}"
    return "".join(pieces) + text[head:]


def bad_json(tree: Any, rng: Rng) -> Any:
    """Values replaced, left out, doubled or exchanged anywhere in a tree of dicts and lists."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.integers(1, 3)):
        node: Any = tree
        while True:
            keys = list(node) if isinstance(node, dict) else list(range(len(node)))
            if not keys:
                break
            key = keys[int(rng.integers(len(keys)))]
            if isinstance(node[key], (dict, list)) and node[key] and rng.random() < 0.75:
                node = node[key]
                continue
            other = keys[int(rng.integers(len(keys)))]
            match int(rng.integers(6)):
                case 0:
                    del node[key]
                case 1:
                    node[key], node[other] = node[other], node[key]
                case 2 if isinstance(node, list):
                    node.insert(key, node[key])
                case _:
                    node[key] = copy.deepcopy(VALUES[int(rng.integers(len(VALUES)))])
            break
    return tree


def bad_array(array: np.ndarray, rng: Rng) -> np.ndarray:
    """Of another shape, another type, or with other values."""
    a = np.asarray(array)
    number = a.dtype.kind in "fiu"
    edits = [
        lambda: a[: len(a) // 2] if a.ndim else a[None],
        lambda: a.reshape(-1),
        lambda: a[None],
        lambda: np.zeros((0, *a.shape[1:]), a.dtype),
        lambda: np.float64(3.0),
        lambda: np.full(a.shape, np.nan),
        lambda: np.full(a.shape, 1e300),
        lambda: np.full(a.shape, -1),
        lambda: np.full(a.shape, 2**62),
        lambda: a.astype("U8"),
        lambda: np.zeros(a.shape, dtype=[("x", "f8")]),
        lambda: np.zeros(a.shape, "datetime64[s]"),
        lambda: a[..., ::-1],
        lambda: np.swapaxes(a, 0, -1) if a.ndim else a,
        lambda: np.concatenate([a, a]) if a.ndim else a,
    ]
    if number:
        edits += [lambda t=t: a.astype(t) for t in ("f2", ">f8", "c16", "?", "S8")] + [lambda: a * 0]
    if number and a.size:
        edits += [lambda: _one_changed(a, rng)] * 4
    with np.errstate(all="ignore"):
        return np.asarray(edits[int(rng.integers(len(edits)))]())


def _one_changed(a: np.ndarray, rng: Rng) -> np.ndarray:
    out = a.astype(np.float64) if a.dtype.kind == "f" else a.astype(np.int64)
    values = (
        (np.nan, np.inf, 1e300, -1e300, -1.0, 0.5, 3.0) if a.dtype.kind == "f" else (-1, -2, 3, 99, 2**40, -(2**63))
    )
    out.reshape(-1)[int(rng.integers(out.size))] = values[int(rng.integers(len(values)))]
    return out


def bad_arrays(arrays: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """One array of several wrong, gone, exchanged with another or under another name; now and then an object."""
    out = dict(arrays)
    name, other = (str(rng.choice(list(out))) for _ in range(2))
    match int(rng.integers(10)):
        case 0:
            del out[name]
        case 1:
            out[name], out[other] = out[other], out[name]
        case 2:
            out[str(rng.choice(["points", "labels", "../../x", "a/b", "x\ny", "labels_000", "novel"]))] = out[name]
        case 3:
            out[name] = np.array([{"a": 1}, None], dtype=object)
        case _:
            out[name] = bad_array(out[name], rng)
    return out

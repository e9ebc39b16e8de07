"""The found tree against the true one, with the types of its joints: as a whole, and joint by joint."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rearticulate.evaluation.tree_distance import tree_edit_distance, tree_edit_distance_best_root
from rearticulate.records import FitResult, GroundTruth, IntArray, Metric

STILL = 1e-6  # of any number in the poses of a root that rests

Edge = tuple[frozenset[int], str]  # the two parts that a joint links, and its type


def structure_metrics(result: FitResult, truth: GroundTruth, match: IntArray) -> list[Metric]:
    """match: (P_true,) the model part that stands for each true part, -1 where none.

    Where the root moves, any part may be called the root and trees are compared under the best one. Where the truth
    does not tell types (Nao), they do not count.
    """
    model, any_root = result.model, root_moves(truth)
    true_kinds = truth.joint_type or len(truth.parent) * ("",)
    kinds = model.joint_type if truth.joint_type else model.n_parts * ("",)
    found, true = edges(model.parent, kinds, np.arange(model.n_parts)), edges(truth.parent, true_kinds, match)
    same_root = any_root or bool(match[truth.parent < 0] == 0)
    exact = model.n_parts == len(match) and set(found) == set(true) and same_root
    alike = structure(model.parent, kinds, any_root) == structure(truth.parent, true_kinds, any_root)
    distance = tree_edit_distance_best_root if any_root else tree_edit_distance
    metrics = [
        Metric("exact", float(exact), "share", "higher"),
        Metric("tree_and_types", float(alike), "share", "higher"),
        Metric("tree_edit_distance_best_root", distance(model.parent, truth.parent), "edits", "lower"),
    ]
    if true:
        share = sum(edge in found for edge in true) / len(true)
        metrics.append(Metric("true_edges_share", share, "share", "higher"))
    return metrics


def root_moves(truth: GroundTruth) -> bool:
    """Whether the true root moves: which part is called the root is arbitrary then."""
    return bool(np.abs(truth.poses[:, truth.parent < 0] - np.eye(4)).max() > STILL)


def edges(parent: IntArray, kinds: Sequence[str], number: IntArray) -> list[Edge]:
    """All joints of a tree, of types kinds (P,). number: (P,) what its parts are called."""
    return [(frozenset((int(number[j]), int(number[p]))), kinds[j]) for j, p in _joints(parent)]


def structure(parent: IntArray, kinds: Sequence[str], any_root: bool) -> str:
    """A text that two trees share if they and the types of their joints are the same: whatever their parts are called,
    in whatever order, and with any_root whichever is the root (Aho, Hopcroft & Ullman 1974)."""
    around: list[list[tuple[int, str]]] = [[] for _ in parent]
    for j, p in _joints(parent):
        around[j].append((p, kinds[j]))
        around[p].append((j, kinds[j]))

    def text(node: int, above: int = -1) -> str:
        return "(" + "".join(sorted(kind + text(other, node) for other, kind in around[node] if other != above)) + ")"

    return min(text(root) for root in range(len(parent)) if any_root or parent[root] < 0)


def _joints(parent: IntArray) -> list[tuple[int, int]]:
    """Child and parent of every joint."""
    return [(j, p) for j, p in enumerate(parent.tolist()) if p >= 0]

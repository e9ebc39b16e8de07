"""Edit distance of rooted trees whose siblings have no order: insert or delete a node costs 1, rename nothing.

The value is the *minimum over all sibling orders of the ordered edit distance* (Zhang & Shasha 1989), the paper's
definition, without going through the orders. The ordered recursion takes the last root of each forest and deletes it,
inserts it or matches the two; here the last root is *any* of the siblings still to come, which fixes the order as it is
needed. A forest on the way is a stack of sibling groups: a deleted node leaves its children on top, and a group has to
be used up before the one below it. Isomorphic siblings are one and the same, so the forests are few.

It can only exceed the *unordered* edit distance (Zhang, Statman & Shasha 1992), which also allows mappings that no
order of the siblings can draw, such as regrouping ab|cd to bc|da under deleted nodes.
"""

from __future__ import annotations

import numpy as np

from rearticulate.records import IntArray

Tree = int  # number of an isomorphism class in `_Trees`
Forest = tuple[tuple[Tree, ...], ...]  # stack of groups of siblings, sorted; the last group comes next

_UNKNOWN = 1 << 30


def tree_edit_distance(a: IntArray, b: IntArray) -> int:
    """Distance of two rooted trees given by their `parent` arrays (P,), -1 at the root."""
    trees = _Trees()
    A, B = trees.add(a), trees.add(b)
    return _Search(trees).distance([((A,),)], ((B,),))


def tree_edit_distance_best_root(a: IntArray, b: IntArray) -> int:
    """The least distance over all nodes that the first tree could be rooted at."""
    trees = _Trees()
    shapes = {trees.add(rerooted(a, root)) for root in range(len(a))}
    B = trees.add(b)
    return _Search(trees).distance([((A,),) for A in shapes], ((B,),))


def rerooted(parent: IntArray, root: int) -> IntArray:
    """The same tree (P,) with another root: the joints on the way to the old one are turned round."""
    out, below, node = np.array(parent), -1, root
    while node >= 0:
        out[node], below, node = below, node, int(parent[node])
    return out


class _Trees:
    """Isomorphism classes of rooted trees: equal numbers mean equal shapes (Aho, Hopcroft & Ullman 1974)."""

    def __init__(self) -> None:
        self._number: dict[tuple[Tree, ...], Tree] = {}
        self.children: list[tuple[Tree, ...]] = []
        self.measure: list[tuple[int, int, int]] = []  # nodes, leaves, height

    def add(self, parent: IntArray) -> Tree:
        below: dict[int, list[int]] = {}
        for node, p in enumerate(np.asarray(parent).tolist()):
            below.setdefault(p, []).append(node)

        def visit(node: int) -> Tree:
            return self._intern(tuple(sorted(visit(child) for child in below.get(node, ()))))

        return visit(below[-1][0])

    def _intern(self, children: tuple[Tree, ...]) -> Tree:
        if children not in self._number:
            self._number[children] = len(self.children)
            self.children.append(children)
            nodes, leaves, height = self.measures((children,)) if children else (0, 1, 0)
            self.measure.append((nodes + 1, leaves, height + 1))
        return self._number[children]

    def measures(self, forest: Forest) -> tuple[int, int, int]:
        """Nodes, leaves and height of a forest. One edit changes each of them by at most 1."""
        of = [self.measure[tree] for group in forest for tree in group]
        return sum(m[0] for m in of), sum(m[1] for m in of), max((m[2] for m in of), default=0)


class _Search:
    """Depth-first search within a budget. What a pair of forests has been found to cost at least is remembered."""

    def __init__(self, trees: _Trees) -> None:
        self.trees = trees
        self.bound: dict[tuple[Forest, Forest], int] = {}
        self.exact: set[tuple[Forest, Forest]] = set()

    def distance(self, forests: list[Forest], G: Forest) -> int:
        """The smallest budget that suffices for one of the forests, which have the same number of nodes."""
        budget = min(self.at_least(F, G) for F in forests)
        while (found := min(self.search(F, G, budget) for F in forests)) > budget:
            budget = found
        return budget

    def at_least(self, F: Forest, G: Forest) -> int:
        """A lower bound of the right parity: the distance is nodes(F) + nodes(G) - 2 matched nodes."""
        if (F, G) not in self.bound:
            f, g = self.trees.measures(F), self.trees.measures(G)
            bound = max(abs(x - y) for x, y in zip(f, g, strict=True))
            self.bound[F, G] = bound + (bound + f[0] + g[0]) % 2
            if F == G or not F or not G:  # nothing to match or nothing to do: the bound is the distance
                self.exact.add((F, G))
        return self.bound[F, G]

    def search(self, F: Forest, G: Forest, budget: int) -> int:
        """The distance if it is at most `budget`, otherwise a lower bound above the budget."""
        floor = self.at_least(F, G)
        if floor > budget or (F, G) in self.exact:
            return floor
        budget -= (budget - floor) % 2
        best = min(self.edits(F, G, budget), self.matches(F, G, budget))
        self.bound[F, G] = best
        if best <= budget:
            self.exact.add((F, G))
        return best

    def edits(self, F: Forest, G: Forest, budget: int) -> int:
        """Cost when the next node is deleted from F or inserted from G."""
        best = _UNKNOWN
        pairs = [(f, G) for f in self.without_root(F)] + [(F, g) for g in self.without_root(G)]
        for f, g in pairs:
            best = min(best, 1 + self.search(f, g, min(budget, best - 2) - 1))
        return best

    def matches(self, F: Forest, G: Forest, budget: int) -> int:
        """Cost when the next two nodes are matched: their children are compared apart from what is left."""
        best = _UNKNOWN
        for v in set(F[-1]):
            for w in set(G[-1]):
                below = self.group(v), self.group(w)
                rest = _drop(F, v), _drop(G, w)
                limit = min(budget, best - 2)
                cost = self.search(*below, limit - self.at_least(*rest))
                best = min(best, cost + self.search(*rest, limit - cost))
        return best

    def group(self, tree: Tree) -> Forest:
        """The children of a tree's root as a forest of one group, or of none."""
        return (self.trees.children[tree],) if self.trees.children[tree] else ()

    def without_root(self, F: Forest) -> list[Forest]:
        """The forests that are left when one of the next roots is removed and its children take its place."""
        return [_drop(F, tree) + self.group(tree) for tree in set(F[-1])]


def _drop(F: Forest, tree: Tree) -> Forest:
    """The forest without one whole tree of its last group."""
    i = F[-1].index(tree)
    group = F[-1][:i] + F[-1][i + 1 :]
    return (*F[:-1], group) if group else F[:-1]

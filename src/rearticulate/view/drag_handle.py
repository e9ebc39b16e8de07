"""A handle on a point of a model. Dragging it retargets the model, live; pins hold other points."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import viser

from rearticulate.geometry.se3 import transform
from rearticulate.records import Array, Posture
from rearticulate.retargeting.retarget import retarget
from rearticulate.view.posed_model import PosedModel

Moved = Callable[[], None]


class DragHandle:
    """Holds one point of a posed model. moved: called when a drag has changed the posture."""

    def __init__(self, server: viser.ViserServer, posed: PosedModel, moved: Moved) -> None:
        self._server, self._posed, self._moved = server, posed, moved
        self.root_moves = False
        self.pins: list[tuple[Array, int, Array]] = []  # point in the canonical frame, its part, where it is held
        self._pin_nodes: list[viser.SceneNodeHandle] = []
        self._solving, self._wanted, self._dragging = threading.Lock(), None, False
        self._node = server.scene.add_transform_controls(
            f"/{posed.name}/handle", scale=0.12 * posed.size, disable_rotations=True, line_width=3.0
        )
        self.part, self._point = farthest_tip(posed)
        self.follow()
        self._node.on_update(self._dragged)

    @property
    def position(self) -> Array:
        """(3,) of the held point in the posture shown."""
        return transform(self._posed.T_world_part[self.part], self._point)

    def take(self, row: int) -> None:
        """Hold another point, a row of `posed.cloud`."""
        points, labels = self._posed.cloud
        self.part, self._point = int(labels[row]), points[row]
        self.follow()

    def follow(self) -> None:
        """Put the handle where the held point is."""
        if not self._dragging:
            self._node.position = self.position

    def pin(self) -> None:
        """Hold the point where it is while others are dragged."""
        here = self.position
        self.pins.append((self._point, self.part, here))
        node = self._server.scene.add_icosphere(
            f"/{self._posed.name}/pin_{len(self.pins)}", 0.012 * self._posed.size, (228, 87, 46), position=here
        )
        self._pin_nodes.append(node)

    def unpin(self) -> None:
        """Hold nothing."""
        for node in self._pin_nodes:
            node.remove()
        self.pins, self._pin_nodes = [], []

    def drag_to(self, target: Array) -> None:
        """The posture nearest to the one shown in which the held point is at a target (3,), and the pins stay."""
        posed = self._posed
        sources = [self._point, *(point for point, _, _ in self.pins)]
        parts = [self.part, *(part for _, part, _ in self.pins)]
        targets = [target, *(where for _, _, where in self.pins)]
        found = retarget(
            posed.model,
            np.array(sources),
            np.array(targets),
            part=np.array(parts),
            free_root=self.root_moves,
            q=posed.posture.q,
            T_world_root=posed.posture.T_world_root,
        )
        posed.show(Posture(found.q, found.T_world_root))
        self._moved()

    def _dragged(self, event: viser.TransformControlsEvent) -> None:
        """Solve for the newest target only: events that come in the meantime replace each other."""
        self._dragging, self._wanted = True, np.array(event.target.position)
        while self._wanted is not None and self._solving.acquire(blocking=False):
            try:
                target, self._wanted = self._wanted, None
                self.drag_to(target)
            finally:
                self._solving.release()
        if event.phase == "end":
            self._dragging = False
            self.follow()


def farthest_tip(posed: PosedModel) -> tuple[int, Array]:
    """The part at the end of the longest chain, and its point (3,) farthest from its joint."""
    model = posed.model
    depth = np.zeros(model.n_parts, dtype=int)
    for j in range(1, model.n_parts):
        depth[j] = depth[model.parent[j]] + 1
    points, labels = posed.cloud
    depth[np.bincount(labels, minlength=model.n_parts) == 0] = -1
    part = int(depth.argmax())
    own = points[labels == part]
    return part, own[np.linalg.norm(own - model.origin[part], axis=1).argmax()]

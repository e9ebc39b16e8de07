"""The viewer: a server with one object, or two side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser

from rearticulate.records import FitResult, PointSequence
from rearticulate.render.camera import View
from rearticulate.view.controls import Controls, Savers
from rearticulate.view.posed_model import PosedModel, on_ray

APART = 1.25  # widths between two objects


class Viewer:
    """Everything that one server shows. address: where."""

    def __init__(
        self,
        server: viser.ViserServer,
        shown: Sequence[tuple[str, FitResult, PointSequence]],
        savers: Savers,
        view: View,
        address: str,
    ) -> None:
        self.server, self.address = server, address
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        server.gui.main_panel.dock_right()
        server.scene.set_up_direction(_direction(view.up))
        right = view.R[0]
        self.models, place = [], None
        for name, result, sequence in shown:
            across = np.concatenate(sequence.points) @ right
            place = float(across.min()) if place is None else place  # the first stands where it was measured
            self.models.append(PosedModel(server, name, result, sequence, (place - across.min()) * right))
            place += APART * float(np.ptp(across))
        self.controls = self._add_controls(savers)
        self._look(view)
        server.scene.on_click()(self._clicked)

    def _add_controls(self, savers: Savers) -> list[Controls]:
        if len(self.models) == 1:
            return [Controls(self.server, self.models[0], savers)]
        tabs, out = self.server.gui.add_tab_group(), []
        for posed in self.models:
            with tabs.add_tab(posed.name):
                out.append(Controls(self.server, posed, savers))
        if len({len(posed.sequence) for posed in self.models}) == 1:
            for controls in out:
                controls.along = [other for other in out if other is not controls]
        return out

    def _look(self, view: View) -> None:
        """The camera that a browser starts with."""
        clouds = np.concatenate([np.concatenate(posed.sequence.points) + posed.offset for posed in self.models])
        middle = (clouds.min(axis=0) + clouds.max(axis=0)) / 2
        reach = float(np.linalg.norm(clouds - middle, axis=1).max())
        camera = self.server.initial_camera
        camera.look_at = middle
        camera.position = middle + 1.6 * reach * view.R[2]
        camera.near, camera.far = 0.01 * reach, 50.0 * reach

    def _clicked(self, event: viser.SceneClickEvent) -> None:
        """The foremost object on the ray is picked."""
        origin, direction = np.array(event.ray_origin), np.array(event.ray_direction)
        hits = [(hit, k) for k, posed in enumerate(self.models) if (hit := on_ray(posed, origin, direction))]
        if hits:
            (_, row), k = min(hits)
            self.controls[k].pick(row)


def _direction(up: str) -> tuple[float, float, float]:
    axis = np.eye(3)["xyz".index(up[-1])] * (-1.0 if up.startswith("-") else 1.0)
    return (float(axis[0]), float(axis[1]), float(axis[2]))

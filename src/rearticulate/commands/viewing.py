"""`view`: a result in the browser, or two side by side."""

from __future__ import annotations

import io
import socket
import time
import webbrowser
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING

from rearticulate.commands.options import check_up
from rearticulate.commands.outputs import check_folder
from rearticulate.errors import FitError
from rearticulate.export.robot import ExportConfig
from rearticulate.export.write import MARK, save_robot
from rearticulate.extras import needs
from rearticulate.io.atomic import atomic_file
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.io.numbered import write_numbered
from rearticulate.io.posture import save_posture
from rearticulate.render.viewpoint import best_view

if TYPE_CHECKING:
    from rearticulate.view.controls import Savers
    from rearticulate.view.posed_model import PosedModel
    from rearticulate.view.viewer import Viewer


def run_view(folder: Path, other: Path | None, host: str, port: int, up: str, overwrite: bool, browser: bool) -> None:
    """The command `view`: serves until it is interrupted."""
    viewer = open_viewer([folder] if other is None else [folder, other], host, port, check_up(up), overwrite)
    print(f"{viewer.address}  (Ctrl-C to stop)", flush=True)
    if browser:
        webbrowser.open(viewer.address)
    try:
        while True:
            time.sleep(3600)
    finally:
        viewer.server.stop()


def open_viewer(folders: list[Path], host: str, port: int, up: str, overwrite: bool = False) -> Viewer:
    """A server that shows the results, to those who know its address. overwrite: it may replace an earlier export."""
    loaded = [(load_result(folder), load_sequence_of(folder)) for folder in folders]
    names = viewer_names(folders)
    view = best_view(*loaded[0], up=up)
    with needs("view"):
        import viser

        from rearticulate.view.gate import Gate, guarded
        from rearticulate.view.viewer import Viewer
    port = _free_port(host, port)
    gate = Gate(host, port)
    with guarded(gate), redirect_stdout(io.StringIO()):  # its banner
        server = viser.ViserServer(host=host, port=port, label="rearticulate", verbose=False)
    if server.get_port() != port:  # taken in between: viser has gone on to the next in silence
        server.stop()
        raise FitError(f"{host}:{port}: cannot listen there (taken); try another --port")
    shown = [(name, *pair) for name, pair in zip(names, loaded, strict=True)]
    return Viewer(server, shown, savers(dict(zip(names, folders, strict=True)), up, overwrite), view, gate.address)


def viewer_names(folders: list[Path]) -> list[str]:
    """What the objects are called: their folders, with what tells them apart where two are alike."""
    names = [folder.resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [f"{name} {k + 1}" for k, name in enumerate(names)]


def savers(folders: dict[str, Path], up: str, overwrite: bool) -> Savers:
    """Saved things go into the folder of the result: postures/, export/, screenshots/. Only an export is ever replaced,
    and that by the rule of the command `export`."""
    from rearticulate.view.controls import Savers

    def posture(posed: PosedModel) -> Path:
        posture = posed.posture
        folder = folders[posed.name] / "postures"
        return write_numbered(folder, ".json", lambda path: save_posture(path, posed.model, posture))

    def export(posed: PosedModel) -> Path:
        folder = folders[posed.name]
        out = folder / "export"
        check_folder(out, MARK, "export", overwrite)
        with needs("export"):
            save_robot(out, posed.result, posed.sequence, name=folder.resolve().name, config=ExportConfig(up=up))
        return out

    def screenshot(posed: PosedModel, png: bytes) -> Path:
        def write(path: Path) -> None:
            with atomic_file(path) as partial:
                partial.write_bytes(png)

        return write_numbered(folders[posed.name] / "screenshots", ".png", write)

    return Savers(posture, export, screenshot)


def _free_port(host: str, port: int) -> int:
    """The port, or for 0 any that is free. viser would take the next one in silence."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            return int(probe.getsockname()[1])
        except (OSError, OverflowError) as error:
            raise FitError(f"{host}:{port}: cannot listen there ({error}); try another --port") from error

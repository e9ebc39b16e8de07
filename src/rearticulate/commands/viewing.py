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
from rearticulate.errors import FitError, InputError
from rearticulate.export.robot import ExportConfig
from rearticulate.export.write import MARK, save_robot
from rearticulate.extras import needs
from rearticulate.io.atomic import atomic_file
from rearticulate.io.model import load_result, load_sequence_of
from rearticulate.io.posture import save_posture
from rearticulate.render.viewpoint import best_view

if TYPE_CHECKING:
    from rearticulate.view.actor import Actor
    from rearticulate.view.controls import Savers
    from rearticulate.view.stage import Stage


def run_view(folder: Path, other: Path | None, host: str, port: int, up: str, browser: bool) -> None:
    """The command `view`: serves until it is interrupted."""
    stage = open_stage([folder] if other is None else [folder, other], host, port, check_up(up))
    url = f"http://{'127.0.0.1' if host == '0.0.0.0' else host}:{stage.server.get_port()}"
    print(f"{url}  (Ctrl-C to stop)", flush=True)
    if browser:
        webbrowser.open(url)
    try:
        while True:
            time.sleep(3600)
    finally:
        stage.server.stop()


def open_stage(folders: list[Path], host: str, port: int, up: str) -> Stage:
    """A server that shows the results."""
    loaded = [(load_result(folder), load_sequence_of(folder)) for folder in folders]
    names = stage_names(folders)
    view = best_view(*loaded[0], up=up)
    with needs("view"):
        import viser

        from rearticulate.view.stage import Stage
    _check_free(host, port)
    with redirect_stdout(io.StringIO()):  # its banner
        server = viser.ViserServer(host=host, port=port or _any_port(host), label="rearticulate", verbose=False)
    shown = [(name, *pair) for name, pair in zip(names, loaded, strict=True)]
    return Stage(server, shown, savers(dict(zip(names, folders, strict=True)), up), view)


def stage_names(folders: list[Path]) -> list[str]:
    """What the objects are called: their folders, with what tells them apart where two are alike."""
    names = [folder.resolve().name for folder in folders]
    return names if len(set(names)) == len(names) else [f"{name} {k + 1}" for k, name in enumerate(names)]


def savers(folders: dict[str, Path], up: str) -> Savers:
    """Saved things go into the folder of the result: postures/, export/, screenshots/."""
    from rearticulate.view.controls import Savers

    def posture(actor: Actor) -> Path:
        path = numbered(folders[actor.name] / "postures", ".json")
        save_posture(path, actor.model, actor.posture)
        return path

    def export(actor: Actor) -> Path:
        folder = folders[actor.name]
        out = folder / "export"
        if out.exists() and any(out.iterdir()) and not (out / MARK).exists():
            raise InputError(f"{out}: not an earlier export, so it is not replaced")
        with needs("export"):
            save_robot(out, actor.result, actor.sequence, name=folder.resolve().name, config=ExportConfig(up=up))
        return out

    def screenshot(actor: Actor, png: bytes) -> Path:
        path = numbered(folders[actor.name] / "screenshots", ".png")
        with atomic_file(path) as partial:
            partial.write_bytes(png)
        return path

    return Savers(posture, export, screenshot)


def numbered(folder: Path, suffix: str) -> Path:
    """001, 002, ...: the first that is not there."""
    k = 1
    while (path := folder / f"{k:03d}{suffix}").exists():
        k += 1
    return path


def _check_free(host: str, port: int) -> None:
    """viser would take the next free port in silence."""
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except (OSError, OverflowError) as error:
            raise FitError(f"{host}:{port}: cannot listen there ({error}); try another --port") from error


def _any_port(host: str) -> int:
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])

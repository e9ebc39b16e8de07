"""Which files are the frames of a sequence: those of a folder or a pattern, all of one format, in order.

A folder may also hold one folder a frame, each with one file of points.
"""

from __future__ import annotations

import glob
from collections.abc import Iterable
from pathlib import Path

from rearticulate.errors import InputError
from rearticulate.io.order import in_order
from rearticulate.io.readers import READERS

_NOTES = {".txt", ".csv"}  # beside frames of another format these are notes, not frames


def frame_files(path: Path) -> list[tuple[str, Path]]:
    """Name and file of every frame, in order (see `io.order`). Raises InputError where there are none or it is unclear
    which."""
    is_pattern = any(mark in str(path) for mark in "*?[") and not path.exists()
    named = [(Path(p).name, Path(p)) for p in glob.glob(str(path), recursive=True)] if is_pattern else _files_of(path)
    if not named:
        raise InputError(f"{path}: {'no file matches this pattern' if is_pattern else 'an empty folder'}")
    known = [(name, file) for name, file in named if _format(file) in (*READERS, ".npz")]
    formats = {_format(file) for _, file in known}
    if not is_pattern and formats - _NOTES:
        formats -= _NOTES
    _check_formats(path, (file for _, file in named), formats)
    suffix = formats.pop()
    files = {str(file): (name, file) for name, file in known if _format(file) == suffix}
    return [files[text] for text in in_order(files, suffix)]


def _format(file: Path) -> str:
    return file.suffix.lower()


def _files_of(path: Path) -> list[tuple[str, Path]]:
    """The visible files of a folder; where it has none, the one in each folder within, by the name of that."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if not path.is_dir():
        wrong = "one frame only, give the folder of all frames" if _format(path) in READERS else _unknown([path])
        raise InputError(f"{path}: {wrong}")
    files = _visible(path)
    folders = [child for child in path.iterdir() if child.is_dir() and not child.name.startswith((".", "_"))]
    if folders and not any(_format(file) in (*READERS, ".npz") for file in files):
        return [(folder.name, _only_cloud(path, folder)) for folder in folders]
    return [(file.name, file) for file in files]


def _visible(folder: Path) -> list[Path]:
    plain = (file for file in folder.iterdir() if not file.name.startswith((".", "_")) and file.is_file())
    return [file for file in plain if file.stem.lower() not in ("readme", "license", "licence")]


def _only_cloud(path: Path, folder: Path) -> Path:
    clouds = [file for file in _visible(folder) if _format(file) in READERS]
    clouds = [file for file in clouds if _format(file) not in _NOTES] or clouds
    if len(clouds) != 1:
        text = "give each folder exactly one, or a pattern such as '*/cloud.ply'"
        raise InputError(f"{path}: only folders, of which {folder.name} holds {len(clouds)} files of points; {text}")
    return clouds[0]


def _check_formats(path: Path, files: Iterable[Path], formats: set[str]) -> None:
    if not formats:
        raise InputError(f"{path}: {_unknown(files)}")
    if len(formats) > 1:
        raise InputError(f"{path}: frames of different formats ({', '.join(sorted(formats))}), expected one format")
    if formats == {".npz"}:
        raise InputError(f"{path}: an .npz holds a whole sequence; give one such file, not several")


def _unknown(files: Iterable[Path]) -> str:
    found = ", ".join(sorted({file.suffix or "no extension" for file in files}))
    return f"no known point format ({found}); known are .npz, {', '.join(READERS)}"

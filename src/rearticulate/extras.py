"""Optional packages: a clear line where one is absent."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from rearticulate.errors import InputError

EXTRAS = {  # what brings a module that not every installation has
    "av": "video",
    "coacd": "export",
    "manifold3d": "export",
    "pxr": "export",
    "pygltflib": "export",
    "skimage": "export",
    "torch": "paper",
    "viser": "view",
    "yourdfpy": "simulate",
    "mujoco": "simulators",
}


@contextmanager
def needs(extra: str = "") -> Iterator[None]:
    """An InputError that names the extra to install where a package of it cannot be imported.

    Without a name it is the extra that brings the module, where that is known.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        module = (error.name or "").partition(".")[0]
        extra = extra or EXTRAS.get(module, "")
        if module == "rearticulate" or not extra:
            raise
        raise InputError(f'this needs the package {error.name}: pip install "rearticulate[{extra}]"') from error

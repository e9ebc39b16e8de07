"""Colours that tell parts apart, the same in every picture, cloud and report.

Five familiar ones, then greedily the sRGB colour furthest from all before it in Oklab, readable on white.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_CODES = (
    "1f77b4 ff7f0e 2ca02c d62728 9467bd 78e1ff 3c4b00 87f000 78005a ff96ff "
    "0000d2 ff00b4 7800ff e1d287 96784b 5aa5ff 0fd296 3c3c87 c30ff0 872d00 "
    "b4a500 d287a5 b41e87 0f785a 00a5a5 005aff c378ff 8700b4 ffb4c3 784b69 "
    "ff4b78 b4b4f0 00d200 ff4bff 5a4bc3 6978ff b45a78 004b5a 785a00 4b00b4"
)
_HEX = _CODES.split()
_RGB = np.array([list(bytes.fromhex(code)) for code in _HEX], dtype=np.uint8)


def part_colors(n: int) -> NDArray[np.uint8]:
    """(n, 3) sRGB colours of parts 0..n-1; they repeat after 40."""
    return _RGB[np.arange(n) % len(_RGB)]


def part_hex(n: int) -> list[str]:
    """The same colours as "#rrggbb"."""
    return ["#" + _HEX[i % len(_HEX)] for i in range(n)]

"""Names that every format takes."""

from __future__ import annotations

import re
from collections.abc import Sequence


def safe_names(names: Sequence[str]) -> tuple[str, ...]:
    """Letters, digits and underscores, a letter first, no two alike whatever the case of their letters.

    A name that is fine already stays as it is, unless an earlier one is the same.
    """
    taken: set[str] = set()
    out = []
    for name in names:
        plain = re.sub(r"[^A-Za-z0-9_]+", "_", name).strip("_") or "part"
        plain = plain if plain[0].isalpha() else f"part_{plain}"
        unique, count = plain, 1
        while unique.lower() in taken:
            count += 1
            unique = f"{plain}_{count}"
        taken.add(unique.lower())
        out.append(unique)
    return tuple(out)


def joint_name(link: str) -> str:
    """Name of the joint between a link and its parent."""
    return f"{link}_joint"

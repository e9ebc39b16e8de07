"""Write the sideboard of the bundled data as URDF: `python scripts/export_sideboard.py FOLDER`.

Runs in an environment of its own, as scene-synthesizer does not work with the trimesh that this project uses:

    python -m venv furniture
    furniture/bin/pip install scene-synthesizer==1.15.0 "trimesh[easy]==4.6.8"
    furniture/bin/python scripts/export_sideboard.py furniture/sideboard
"""

from __future__ import annotations

import sys
from pathlib import Path

from scene_synthesizer.procedural_assets import CabinetAsset  # pyright: ignore[reportMissingImports]


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    sideboard = CabinetAsset(
        width=1.2,
        depth=0.45,
        height=0.8,
        compartment_mask=[[0, 0, 1], [2, 3, 1]],
        compartment_types=["drawer", "door_left", "door_right", "door_left"],
        compartment_heights=[0.35, 0.65],
        outer_wall_thickness=0.02,
        inner_wall_thickness=0.02,
        drawer_wall_thickness=0.01,
    )
    sideboard.scene("sideboard").export(str(folder / "sideboard.urdf"))


if __name__ == "__main__":
    main(Path(sys.argv[1]))

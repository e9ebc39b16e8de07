"""The page of exports in motion."""

from __future__ import annotations

from rearticulate.bench.cases import BUNDLED, HOUSEHOLD, ROBOTS, Case
from rearticulate.bench.dynamics import ENGINES, passes
from rearticulate.bench.markdown import head, table
from rearticulate.bench.referees import PACKAGES
from rearticulate.bench.runner import Answer, Job

JOBS = [Job(Case(name), use=True) for name in (*ROBOTS, *HOUSEHOLD, *BUNDLED)]
MEASURES = ("moved", "depth_mm", "sweep_mm", "random_mm", "holds")
TEXT = (
    "Every object fitted by the default preset and exported, then loaded into the simulators that are installed, root "
    "fixed; in PyBullet parents and children collide, too. Each cell: largest change of a joint in a second without "
    "any force (rad or m) / deepest contact at rest / while each joint alone moves over its whole range / at 100 "
    "random postures (mm), and where the format has drives, the largest change in a second under gravity (rad or m). "
    "Contacts of links that are no neighbours do not count where the surfaces themselves meet. Passed: below 0.01 rad "
    "or m, and 1 mm at rest and in the sweeps. simcheck, urdf_validator: errors / warnings of these packages. Cut: the "
    "largest share of a link's convex pieces that was taken away so that the others can move. Touching: pairs of links "
    "that meet somewhere in the range of a joint. All simulators: `pip install rearticulate[dev]`."
)


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page."""
    rows = [[job.case.name, *_cells(answers.get(job.name, {}).get("use", {}))] for job in JOBS]
    columns = ["object", "passed", *ENGINES, *PACKAGES, "pieces", "cut", "touching"]
    return "\n\n".join([head("Exports in motion", stamp), TEXT, table(columns, rows)]) + "\n"


def _cells(measured: dict[str, float]) -> list[str]:
    if not measured:
        return ["-"] * (len(ENGINES) + len(PACKAGES) + 4)
    found = {engine: _of(engine, measured) for engine in ENGINES}
    told = [" / ".join(f"{value:.2g}" for value in own.values()) or "-" for own in found.values()]
    count = f"{sum(passes(own) for own in found.values() if own)} of {sum(map(bool, found.values()))}"
    judged = [_judgement(name, measured) for name in PACKAGES]
    return [count, *told, *judged, f"{measured['pieces']:.0f}", f"{measured['cut']:.2f}", f"{measured['touches']:.0f}"]


def _judgement(name: str, measured: dict[str, float]) -> str:
    keys = (f"{name}.errors", f"{name}.warnings")
    return " / ".join(f"{measured[key]:.0f}" for key in keys) if keys[0] in measured else "-"


def _of(engine: str, measured: dict[str, float]) -> dict[str, float]:
    keys = {key: f"{engine}.{key}" for key in MEASURES}
    return {key: measured[name] for key, name in keys.items() if name in measured}

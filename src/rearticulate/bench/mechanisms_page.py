"""The page of the default's mechanisms: what each is worth, by leaving it out."""

from __future__ import annotations

from statistics import mean

from rearticulate.bench.cases import Case
from rearticulate.bench.columns import COLUMNS, mean_metrics
from rearticulate.bench.markdown import head, table
from rearticulate.bench.runner import Answer, Job
from rearticulate.bench.variants import WITHOUT

DEFAULT = "direct"
ROBOTS = ("kinova", "reachy", "icub", "solo", "nao")
HOUSEHOLD = ("cabinet", "dishwasher", "microwave", "refrigerator")
EVERYDAY = ("cutter", "folding_rule", "lite6", "scissors", "ss_wardrobe", "telescope_arm")
OBJECTS = (*ROBOTS, *HOUSEHOLD, *EVERYDAY)
KEYS = ("recon_cm", "rand_index", "tree_edit_distance_best_root", "exact")
JOBS = [Job(Case(name), variant) for variant in (DEFAULT, *WITHOUT) for name in OBJECTS]
TEXT = (
    "The default, and what leaving out one mechanism at a time adds to its means: over the robots "
    f"{', '.join(ROBOTS)}, the household objects {', '.join(HOUSEHOLD)} and the everyday ones {', '.join(EVERYDAY)}. "
    "Changed: objects with any other number than the default's; the rest is the same to the last bit."
)


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page. answers: those there are, by the names of the jobs."""
    pairs = {variant: _pairs(variant, answers) for variant in WITHOUT}
    default = [answers[key] for name in OBJECTS if (key := f"{DEFAULT}/{name}") in answers]
    rows = [["default", *_cells(_means(default), ""), f"of {len(default)}"]] if default else []
    for variant, found in pairs.items():
        if found:
            before, now = (_means([pair[i] for pair in found]) for i in (0, 1))
            changed = sum(a["metrics"] != b["metrics"] for a, b in found)
            change = {key: now[key] - before[key] for key in now.keys() & before.keys()}
            rows.append([variant, *_cells(change, "+"), f"{changed} of {len(found)}"])
    columns = ["", *(COLUMNS[key][0] for key in KEYS), "s", "changed"]
    return "\n\n".join([head("Mechanisms", stamp), TEXT, table(columns, rows)]) + "\n"


def _pairs(variant: str, answers: dict[str, Answer]) -> list[tuple[Answer, Answer]]:
    """The answers with and without, of the objects that have both."""
    keys = [(f"{DEFAULT}/{name}", f"{variant}/{name}") for name in OBJECTS]
    return [(answers[a], answers[b]) for a, b in keys if a in answers and b in answers]


def _means(answers: list[Answer]) -> dict[str, float]:
    return {**mean_metrics(a["metrics"] for a in answers), "seconds": mean(a["seconds"] for a in answers)}


def _cells(means: dict[str, float], sign: str) -> list[str]:
    forms = {**{key: f"{sign}.{COLUMNS[key][1]}f" for key in KEYS}, "seconds": f"{sign}.1f"}
    return [format(means[key], form) if key in means else "-" for key, form in forms.items()]

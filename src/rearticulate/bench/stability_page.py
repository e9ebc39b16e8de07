"""The page of what should change nothing: other seeds, another world frame."""

from __future__ import annotations

from rearticulate.bench.cases import Case
from rearticulate.bench.columns import parts_cell
from rearticulate.bench.markdown import head, table
from rearticulate.bench.runner import Answer, Job

ROBOTS = ("kinova", "nao", "reachy", "solo")
HOUSEHOLD = ("cabinet", "dishwasher", "refrigerator")
EVERYDAY = ("cutter", "folding_rule", "lite6", "ss_range", "stapler")
OBJECTS = (*ROBOTS, *HOUSEHOLD, *EVERYDAY)
RUNS = {  # a column: perturbation, seed
    "seed 0": ("", 0),
    "seed 1": ("", 1),
    "seed 2": ("", 2),
    "other world": ("other_world", 0),
}
SEEDS = ("seed 0", "seed 1", "seed 2")
TEXT = (
    "Every object fitted with three seeds, and once more with the whole recording turned at random and shifted by its "
    "diagonal. Each cell: parts found, tree edit distance (under the best root where the root moves), and error of the "
    "reconstruction in cm. Kept: all trees have one shape with the same types of joints (under any root where the root "
    "moves), right or wrong."
)


def job(name: str, run: str) -> Job:
    """The fit of an object in one of `RUNS`."""
    perturbation, seed = RUNS[run]
    return Job(Case(name, perturbation), seed=seed)


JOBS = [job(name, run) for name in OBJECTS for run in RUNS]


def report(stamp: dict[str, str], answers: dict[str, Answer]) -> str:
    """The whole page. answers: those there are, by the names of the jobs."""
    rows, kept = [], []
    for name in OBJECTS:
        found = {run: answers[job(name, run).name] for run in RUNS if job(name, run).name in answers}
        if found:
            same = [_same(found, SEEDS), _same(found, ("seed 0", "other world"))]
            kept.append(same)
            words = {True: "yes", False: "no", None: "-"}
            rows.append([name, *(_cell(found.get(run)) for run in RUNS), *(words[answer] for answer in same)])
    shares = [[same for same in column if same is not None] for column in zip(*kept, strict=True)]
    told = [f"{sum(column)} of {len(column)}" for column in shares]
    rows += [["**share that keeps it**", *len(RUNS) * ["-"], *told]] if told else []
    columns = ["object", *RUNS, "kept by seeds", "kept in the other world"]
    return "\n\n".join([head("Stability", stamp), TEXT, table(columns, rows)]) + "\n"


def _same(found: dict[str, Answer], runs: tuple[str, ...]) -> bool | None:
    """Whether these runs have one structure; None where one is missing."""
    if not all(run in found for run in runs):
        return None
    return len({found[run]["structure"] for run in runs}) == 1


def _cell(answer: Answer | None) -> str:
    if answer is None:
        return "-"
    metrics = answer["metrics"]
    return f"{parts_cell(metrics)}, {metrics['tree_edit_distance_best_root']:.0f}, {metrics['recon_cm']:.3f}"

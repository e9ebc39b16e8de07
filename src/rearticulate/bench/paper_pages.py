"""The paper's tables with ours beside them: robots, ablations, household objects, run time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from statistics import mean

from rearticulate.bench import published
from rearticulate.bench.cases import HOUSEHOLD, PAPER_TEST, PAPER_VALIDATION, Case
from rearticulate.bench.columns import COLUMNS, answers_of, mean_metrics, number_cell, parts_cell
from rearticulate.bench.markdown import head, seconds_cell, table
from rearticulate.bench.published import SIX
from rearticulate.bench.runner import Answer, Job
from rearticulate.bench.variants import energies

Answers = dict[str, Answer]
Row = list[str]

COMPARED = ("paper", "paper-fast", "direct")
ROBOTS = (*PAPER_VALIDATION, *PAPER_TEST)
FIRST = (*PAPER_VALIDATION, "kinova", "solo", "jvrc", "allegro")  # chosen before the first run: arm, dog, human, hand
ROBOT_JOBS = [Job(Case(name), preset) for preset in COMPARED for name in dict.fromkeys((*FIRST, *ROBOTS))]
ENERGY_SUBSETS = [used for used in product((True, False), repeat=3) if any(used)]
ENERGY_JOBS = [Job(Case(name), energies(used)) for used in ENERGY_SUBSETS for name in PAPER_VALIDATION]
OURS = ("random start", "plain matches")  # without what we added to the paper's method
DESIGN_VARIANTS = ("without field", "without Gumbel", "without canonical choice", "paper", *OURS)
DESIGN_JOBS = [Job(Case(name), v) for v in DESIGN_VARIANTS for name in PAPER_VALIDATION]
HOUSEHOLD_JOBS = [Job(Case(name), preset) for preset in COMPARED for name in HOUSEHOLD]
HOUSEHOLD_KEYS = ("flow_epe_cm", "rand_index_multi_scan", "rand_index_per_scan")
PRISMATIC = ("base_cabinet", "cabinet", "dishwasher", "kitchen_island")  # those with a drawer or a rack

NOTE = (
    "Published numbers are of the paper's own sequences, ours of sequences recorded by its protocol; Nao's is the "
    "published one. Of the paper's validation robots Panda and Nao are here, Cassie and Spot are not."
)


def robots(stamp: dict[str, str], answers: Answers) -> str:
    """Table 1: every robot under every preset, and the means."""
    rows = []
    for name in ROBOTS:
        rows += [
            [name, preset, *_six(found["metrics"]), parts_cell(found["metrics"]), seconds_cell(found["seconds"])]
            for preset in COMPARED
            if (found := answers.get(f"{preset}/{name}"))
        ]
        if name == "nao":
            rows.append([name, "authors' released model", *_six(published.RELEASED_NAO), "10 of 14", "-"])
    several_of = {"validation robots": PAPER_VALIDATION, "robots chosen beforehand": FIRST, "test robots": PAPER_TEST}
    for label, names in several_of.items():
        for preset in COMPARED:
            have = answers_of(preset, names, answers)
            if have:
                several = f"**mean of {len(have)} {label}**"
                time = seconds_cell(mean(a["seconds"] for a in have))
                rows.append([several, preset, *_six(mean_metrics(a["metrics"] for a in have)), "", time])
    rows.append(["**published mean of 10 test robots**", "", *_six(published.TEST_ROBOTS), "", "2700"])
    heads = ["robot", "preset", *(COLUMNS[key][0] for key in SIX), "parts", "s"]
    return "\n\n".join([head("Robots: the paper's method and the default", stamp), NOTE, table(heads, rows)]) + "\n"


def energy_ablation(stamp: dict[str, str], answers: Answers) -> str:
    """Table 3: the energy terms, from the middle frame, without the final fit."""
    rows = []
    for used in ENERGY_SUBSETS:
        marks = ["x" if on else "" for on in (used[0], used[1], used[2])]
        ours = _validation_mean(answers, energies(used), "metrics")
        rows.append([*marks, *_beside(ours, published.ENERGIES[used])])
    heads = ["E_CD", "E_flow", "E_EMD", *(f"{COLUMNS[key][0]} (published)" for key in SIX[:5])]
    text = "Mean over the validation robots; the published one in brackets. Middle frame, no final fit."
    return "\n\n".join([head("Energy terms", stamp), NOTE, text, table(heads, rows)]) + "\n"


def design_ablation(stamp: dict[str, str], answers: Answers) -> str:
    """Table 4: field, Gumbel-softmax, projection, choice of the canonical frame."""
    rows = []
    for label, values in published.DESIGNS.items():
        if label == "without projection":
            ours = _validation_mean(answers, "paper", "relaxed")
            joined = _validation_mean(answers, "paper", "metrics")
            ours |= {key: value for key, value in joined.items() if key == "tree_edit_distance"}
        else:
            ours = _validation_mean(answers, label, "metrics")
        rows.append([label, *_beside(ours, values)])
    rows += [[label, *_six(_validation_mean(answers, label, "metrics"))] for label in OURS]
    heads = ["design", *(f"{COLUMNS[key][0]} (published)" for key in SIX)]
    text = (
        "Mean over the validation robots; the published one in brackets. Without projection every part moves freely: "
        "its tree is the projected one, and reanimation shifts each part by its own click. The last rows leave out "
        "what is ours: parts that start as cells around farthest points, and matches that registration refines."
    )
    return "\n\n".join([head("Design choices", stamp), NOTE, text, table(heads, rows)]) + "\n"


def household(stamp: dict[str, str], answers: Answers) -> str:
    """Tables 2, 5 and 6: flow error and Rand indices, by object and by joint type."""
    groups = [(name, (name,)) for name in HOUSEHOLD]
    revolute = tuple(name for name in HOUSEHOLD if name not in PRISMATIC)
    groups += [("**only hinges**", revolute), ("**with drawers**", PRISMATIC), ("**all**", HOUSEHOLD)]
    rows = []
    for label, names in groups:
        cells = [label]
        for preset in COMPARED:
            have = answers_of(preset, names, answers)
            found = mean_metrics(a["metrics"] for a in have) if len(have) == len(names) else {}
            cells += [number_cell(found.get(key), key) for key in HOUSEHOLD_KEYS]
        rows.append(cells)
    heads = ["object", *(f"{preset}: {COLUMNS[key][0]}" for preset in COMPARED for key in HOUSEHOLD_KEYS)]
    theirs = [
        *([label, *(f"{v:.2f}" for v in values)] for label, values in published.HOUSEHOLD.items()),
        *([label, *(f"{v:.2f}" for v in values), "-"] for label, values in published.CATEGORIES.items()),
    ]
    text = (
        "Four frames of 4096 points; the root moves. Published: 720 sequences of 20 categories (flow error in units of "
        "1/100 of the object's size there, centimetres here)."
    )
    return (
        "\n\n".join(
            [
                head("Household objects", stamp),
                text,
                table(heads, rows),
                "Published:",
                table(["", "flow error", "Rand multi", "Rand per scan"], theirs),
            ]
        )
        + "\n"
    )


def run_time(stamp: dict[str, str], answers: Answers) -> str:
    """Seconds by stage of every preset, means over the robots and over the household objects."""
    rows = []
    for label, names in (("RoboArt", ROBOTS), ("household", HOUSEHOLD)):
        for preset in COMPARED:
            have = answers_of(preset, names, answers)
            stages = {stage: mean(a["stages"].get(stage, 0.0) for a in have) for a in have[:1] for stage in a["stages"]}
            text = ", ".join(f"{stage} {value:.1f}" for stage, value in stages.items())
            if have:
                time = seconds_cell(mean(a["seconds"] for a in have))
                rows.append([label, preset, str(len(have)), time, text])
        minutes = published.MINUTES[label]
        rows.append([label, "published, RTX 3090", "", seconds_cell(60 * minutes), ""])
    return "\n\n".join([head("Run time", stamp), table(["set", "preset", "objects", "mean s", "stages"], rows)]) + "\n"


def _validation_mean(answers: Answers, variant: str, part: str) -> dict[str, float]:
    """Mean over the validation robots; empty where one is missing."""
    have = answers_of(variant, PAPER_VALIDATION, answers)
    return mean_metrics(a[part] for a in have) if len(have) == len(PAPER_VALIDATION) else {}


def _six(metrics: dict[str, float]) -> Row:
    return [number_cell(metrics.get(key), key) for key in SIX]


def _beside(ours: dict[str, float], theirs: Sequence[float]) -> Row:
    return [f"{number_cell(ours.get(key), key)} ({value:.2f})" for key, value in zip(SIX, theirs, strict=False)]

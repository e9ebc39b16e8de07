"""The command `rearticulate`: arguments and help only. What a command does is in `rearticulate.commands`,
imported when it runs, so that help is instant.
"""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core

from rearticulate.commands.outcome import BAD_INPUT, INTERRUPTED, reported, say


class OneLineUsage(typer.core.TyperGroup):
    """Wrong usage is bad input like any other: one line on stderr, exit code 2."""

    def main(self, *args: Any, **rest: Any) -> Any:
        try:
            code = super().main(*args, **{**rest, "standalone_mode": False})
        except Exception as error:
            message = error.format_message() if hasattr(error, "format_message") else None  # type: ignore[attr-defined]
            if message is None:
                raise
            if "\n" in message:  # the help
                print(message, file=sys.stderr)
            else:
                say(f"error: {message}")
            raise SystemExit(BAD_INPUT) from None
        raise SystemExit(code or 0)


app = typer.Typer(
    cls=OneLineUsage,
    help="4D point clouds of any articulated object become rearticulable kinematic models.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Json = Annotated[bool, typer.Option("--json", help="Print JSON, and nothing else, on stdout.")]
Scale = Annotated[float, typer.Option(help="Metres in one unit of the input (0.001 for millimetres).")]
MaxPoints = Annotated[int, typer.Option(help="Larger frames are subsampled.")]
MaxBytes = Annotated[int, typer.Option(help="What one file of points may take in memory, unpacked.")]
Seed = Annotated[int, typer.Option(help="Seed; the same seed gives the same result.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace an earlier result.")]
ResultFolder = Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a result.")]
Frame = Annotated[int | None, typer.Option(help="Start from the posture of a frame. [default: the canonical one]")]
Start = Annotated[Path | None, typer.Option("--from", metavar="POSTURE.json", help="Start from this posture.")]
Up = Annotated[str, typer.Option(metavar="[-]x|y|z", help="Axis that points up, against gravity.")]
OutFolder = Annotated[Path, typer.Option("-o", "--output", help="Folder of the result.")]


def main() -> None:
    """Entry point. Being asked to end (SIGTERM) is what Ctrl-C is."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        app()
    except KeyboardInterrupt:
        say("interrupted")
        raise SystemExit(INTERRUPTED) from None


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"rearticulate {version('rearticulate')}")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """4D point clouds of any articulated object become rearticulable kinematic models."""


@app.command()
@reported
def fit(
    source: Annotated[
        str, typer.Argument(metavar="INPUT", help="An .npz, a folder of frames, or a quoted pattern ('scan_*.ply').")
    ],
    output: OutFolder,
    preset: Annotated[str, typer.Option(help="Named configuration.")] = "direct",
    config: Annotated[
        Path | None, typer.Option(help="File of settings that differ from the preset (keys as in config.json).")
    ] = None,
    canonical: Annotated[str, typer.Option(metavar="auto|K", help="Frame of the rest pose.")] = "auto",
    seed: Seed = 0,
    device: Annotated[str, typer.Option(metavar="auto|cpu|cuda", help="Where to compute.")] = "auto",
    resume: Annotated[bool, typer.Option("--resume", help="Go on from a stopped fit.")] = False,
    overwrite: Overwrite = False,
    scale: Scale = 1.0,
    max_points: MaxPoints = 20_000,
    max_bytes: MaxBytes = 2 * 2**30,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html and no pictures.")] = False,
    json: Json = False,
) -> None:
    """Fit a model to a sequence of point clouds."""
    from rearticulate.commands.fitting import FitOptions, run_fit
    from rearticulate.commands.options import InputOptions

    options = FitOptions(preset, config, canonical, seed, device, resume, overwrite, not no_report)
    run_fit(source, output, options, InputOptions(scale, max_points, max_bytes), json)


@app.command()
@reported
def export(
    result: ResultFolder,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder. [default: OUT/export]")] = None,
    formats: Annotated[str, typer.Option("--format", help="Which, separated by commas.")] = "urdf,mjcf,usd,gltf,ply",
    name: Annotated[str | None, typer.Option(help="Of the robot and its files. [default: that of OUT]")] = None,
    margin: Annotated[float, typer.Option(help="What joints may do beyond their observed range, a share of it.")] = 0.1,
    density: Annotated[float, typer.Option(help="kg/m^3.")] = 500.0,
    floating: Annotated[bool, typer.Option("--floating", help="The root may move freely.")] = False,
    up: Up = "z",
    collision: Annotated[
        str, typer.Option(metavar="pieces|hull", help="Convex pieces, or one hull a part.")
    ] = "pieces",
    max_faces: Annotated[int, typer.Option(help="Triangles of one part.")] = 4000,
    effort: Annotated[float, typer.Option(help="Limit of a joint in the URDF, N m or N.")] = 100.0,
    velocity: Annotated[float, typer.Option(help="Limit of a joint in the URDF, rad/s or m/s.")] = 10.0,
    friction: Annotated[
        float | None, typer.Option(help="Of a joint, N m or N. [default: 1% of what it carries]")
    ] = None,
    damping: Annotated[
        float | None, typer.Option(help="Of a joint, N m s/rad or N s/m. [default: a swing loses its speed in 1 s]")
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier export.")] = False,
    json: Json = False,
) -> None:
    """Write a result for simulators and viewers: URDF, MJCF, USD, glTF, PLY."""
    from rearticulate.commands.exporting import ExportOptions, export_config, run_export

    config = export_config(margin, density, floating, up, collision, max_faces, effort, velocity, friction, damping)
    run_export(result, output, ExportOptions(formats, name, overwrite), config, json)


@app.command()
@reported
def pose(
    result: ResultFolder,
    output: Annotated[Path, typer.Option("-o", "--output", help="A coloured .ply, or the posture as .json.")],
    joint: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="rad or m; or with a unit: 30deg, 5cm, 50% of its range; repeatable."),
    ] = None,
    frame: Frame = None,
    start: Start = None,
    dense: Annotated[bool, typer.Option("--dense", help="With the points of all frames.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier file.")] = False,
    json: Json = False,
) -> None:
    """The object in any posture, from joint values."""
    from rearticulate.commands.posing import run_pose

    run_pose(result, output, joint or [], frame, start, dense, overwrite, json)


@app.command()
@reported
def retarget(
    result: ResultFolder,
    clicks: Annotated[
        Path, typer.Argument(metavar="CLICKS.json", help='{"clicks": [{"source": [x,y,z], "target": [x,y,z]}, ...]}')
    ],
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder: posture, cloud, motion, animation.")],
    frame: Frame = None,
    start: Start = None,
    fixed_root: Annotated[bool, typer.Option("--fixed-root", help="The root stays where it is.")] = False,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """The object in the posture that brings some of its points where they should be."""
    from rearticulate.commands.retargeting import run_retarget

    run_retarget(result, clicks, output, frame, start, fixed_root, overwrite, json)


@app.command()
@reported
def track(
    result: ResultFolder,
    scans: Annotated[str, typer.Argument(metavar="SCANS", help="New scans: a file, a folder, a quoted pattern.")],
    output: OutFolder,
    scale: Scale = 1.0,
    max_points: MaxPoints = 20_000,
    max_bytes: MaxBytes = 2 * 2**30,
    overwrite: Overwrite = False,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html and no pictures.")] = False,
    json: Json = False,
) -> None:
    """Joint values, root pose and labels of new scans of the same object."""
    from rearticulate.commands.options import InputOptions
    from rearticulate.commands.tracking import run_track

    run_track(result, scans, output, InputOptions(scale, max_points, max_bytes), overwrite, not no_report, json)


@app.command()
@reported
def render(
    result: ResultFolder,
    output: Annotated[Path, typer.Option("-o", "--output", help="A .gif or an .mp4.")],
    panels: Annotated[str, typer.Option(help="Which, separated by commas.")] = "input,parts,skeleton,flow,pose",
    posture: Annotated[
        Path | None, typer.Option("--posture", help="Of the last panel, a .json. [default: one never measured]")
    ] = None,
    size: Annotated[int, typer.Option(help="Pixels of a panel.")] = 300,
    view: Annotated[str, typer.Option(metavar="auto|AZIMUTH,ELEVATION", help="Of the eye, degrees.")] = "auto",
    up: Up = "z",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier file.")] = False,
) -> None:
    """A clip of a result: what was measured, parts, joints, flow, a new posture."""
    from rearticulate.commands.rendering import run_render

    run_render(result, output, panels, posture, size, view, up, overwrite)


@app.command()
@reported
def view(
    result: ResultFolder,
    other: Annotated[Path | None, typer.Argument(metavar="[OTHER]", help="A second result, shown beside it.")] = None,
    host: Annotated[str, typer.Option(help="Address to listen at; 0.0.0.0 for the whole network.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0 for any that is free.")] = 8080,
    up: Up = "z",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="The page may replace an earlier export.")] = False,
    browser: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """See and move a result in the browser: play, slide joints, drag points, save, export."""
    from rearticulate.commands.viewing import run_view

    run_view(result, other, host, port, up, overwrite, browser)


@app.command("eval")
@reported
def evaluate(
    result: ResultFolder,
    truth: Annotated[Path, typer.Argument(metavar="TRUTH", help="Its ground truth, a .truth.npz.")],
    report: Annotated[bool, typer.Option("--report", help="Write report.html anew, with the comparison.")] = False,
    json: Json = False,
) -> None:
    """Compare a result with ground truth."""
    from rearticulate.commands.inspect import run_eval

    run_eval(result, truth, report, json)


@app.command()
@reported
def simulate(
    model: Annotated[Path, typer.Argument(metavar="MODEL.urdf", help="Any URDF with visual geometry.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="SEQ.npz; the truth goes to SEQ.truth.npz.")],
    frames: Annotated[int, typer.Option(help="Number of frames.")] = 10,
    points: Annotated[int, typer.Option(help="Points a frame.")] = 4096,
    step_deg: Annotated[float, typer.Option(help="What a hinge turns a frame, degrees.")] = 10.0,
    step_m: Annotated[
        float | None, typer.Option(help="What a slide moves a frame, metres. [default: step-deg/180 of its range]")
    ] = None,
    start: Annotated[str, typer.Option(metavar="random|middle|zero", help="First posture.")] = "random",
    noise: Annotated[float, typer.Option(help="Standard deviation of each coordinate, metres.")] = 0.0,
    one_sided: Annotated[bool, typer.Option("--one-sided", help="Keep what one camera sees.")] = False,
    moving_root: Annotated[bool, typer.Option("--moving-root", help="Let the root wander.")] = False,
    novel: Annotated[int, typer.Option(help="Novel postures in the ground truth.")] = 3,
    merge_below: Annotated[
        float, typer.Option(help="Links with less than this share of the surface join their parent.")
    ] = 0.015,
    package_dir: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of packages or meshes beyond the URDF's own package; repeatable."),
    ] = None,
    seed: Seed = 0,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier files.")] = False,
    json: Json = False,
) -> None:
    """Make a sequence with ground truth from a URDF."""
    from rearticulate.commands.simulating import run_simulate

    settings = {
        "frames": frames,
        "points": points,
        "step_deg": step_deg,
        "step_m": step_m,
        "start": start,
        "noise": noise,
        "one_sided": one_sided,
        "moving_root": moving_root,
        "novel": novel,
        "merge_below": merge_below,
        "package_dirs": tuple(package_dir or ()),
        "seed": seed,
    }
    run_simulate(model, output, overwrite, json, settings)


@app.command()
@reported
def demo(
    name: Annotated[str | None, typer.Argument(help="Which bundled sequence. [default: the first]")] = None,
    output: OutFolder = Path("demo-out"),
    json: Json = False,
) -> None:
    """Fit a bundled sequence and compare with ground truth; replaces an earlier demo."""
    from rearticulate.commands.fitting import run_demo

    run_demo(name, output, json)


@app.command()
@reported
def bench(
    table: Annotated[str, typer.Argument(help="Which page of tables; a wrong name lists them.")] = "results",
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the pages and of finished fits.")] = Path(
        "benchmarks"
    ),
    only: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="An object, a case or a configuration; repeatable.")
    ] = None,
    jobs: Annotated[int, typer.Option(help="Fits at the same time; they share the cores.")] = 1,
    seed: Seed = 0,
    gate: Annotated[
        bool, typer.Option("--gate", help="Exit with 1 where a number got worse than in the page as it was.")
    ] = False,
    baseline: Annotated[
        Path | None, typer.Option(metavar="FILE", help="--gate against the .json of another page.")
    ] = None,
    fresh: Annotated[bool, typer.Option("--fresh", help="Run finished fits again.")] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="A fraction of the paper's iterations; the page says so.")
    ] = False,
    json: Json = False,
) -> None:
    """Fit the sequences with ground truth and write a page of tables; a stopped run goes on where it was."""
    from rearticulate.commands.benching import BenchOptions, run_bench

    run_bench(table, output, BenchOptions(frozenset(only or ()), seed, jobs, fresh, quick, gate, baseline, json))


@app.command("train-flow")
@reported
def train_flow(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder of the run.")],
    steps: Annotated[int, typer.Option(help="Batches to train on, those before a --resume counted in.")] = 40_000,
    seed: Seed = 0,
    device: Annotated[str, typer.Option(metavar="auto|cpu|cuda", help="Where to compute.")] = "auto",
    mixed: Annotated[
        bool | None, typer.Option("--mixed/--full", help="Compute in bfloat16 where that is safe. [default: on a GPU]")
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes that make pairs of clouds.")] = 1,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the last checkpoint.")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Start again in a folder that exists.")] = False,
) -> None:
    """Train the correspondence network; several GPUs: torchrun --nproc-per-node N -m rearticulate.cli train-flow ..."""
    from rearticulate.commands.training import TrainOptions, run_train

    run_train(output, TrainOptions(steps, seed, device, mixed, workers, resume, overwrite))


@app.command()
@reported
def info(
    source: Annotated[
        str, typer.Argument(metavar="FILE", help="A sequence, a ground truth or the folder of a result.")
    ],
    scale: Scale = 1.0,
    max_bytes: MaxBytes = 2 * 2**30,
    json: Json = False,
) -> None:
    """What is in a sequence or a model."""
    from rearticulate.commands.inspect import run_info
    from rearticulate.commands.options import InputOptions

    run_info(source, InputOptions(scale, max_bytes=max_bytes), json)


if __name__ == "__main__":
    main()

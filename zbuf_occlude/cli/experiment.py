"""`zbuf-occlude paper elevation|augmentation|table3|realism`: experiments with classifiers; old name `experiment`."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.paper import derived, refuse_unused, replaced
from zbuf_occlude.cli.shared_options import OutFolder
from zbuf_occlude.cli.shell import SOME_FAILED, Command, Name, counted, echo, progress_bar
from zbuf_occlude.learn.models import MODELS, require_torch
from zbuf_occlude.paper.design import AUGMENTATION, BUDGETS, CLOUDS, ELEVATION, FULL, QUICK, REALISM, Progress, changed
from zbuf_occlude.paper.real_scans import UPS
from zbuf_occlude.paper.results import read_results, read_study
from zbuf_occlude.paper.study_report import answers, write_study

BOTH, ALL = "table3", "all"
"""The paper's experiments together, and what `experiment` called them."""
UNUSED = {
    ELEVATION: {"scans", "scans_up", "real", "budgets"},
    AUGMENTATION: {"real"},
    BOTH: {"real", "epochs"},
    REALISM: {"scans", "scans_up", "budgets"},
}
"""Options that an experiment does not use; the two of `BOTH` differ in epochs."""
TEXTS = {
    ELEVATION: """Repeat 4.2, Table 3A: accuracy against the camera's elevation.

    VoxNet, PointNet and 3DmFV are trained on clouds seen from some elevations of the camera and tested on others; and
    why accuracy falls where the camera sees little of an object (Fig. 12).""",
    AUGMENTATION: """Repeat 4.3 and 4.4, Table 3B: training sets.

    Classifiers are trained on occluded clouds, on complete ones, on both; tested on complete ones, on occluded ones, on
    real scans. And: does the method of hidden-surface removal matter?""",
    BOTH: """Repeat Table 3A and 3B: `paper elevation` and `paper augmentation` in one study.""",
    REALISM: """Ask what a LiDAR, a street and a depth camera do to a classifier; not in the paper.

    Classifiers are trained on uniform occluded clouds, on a LiDAR's scans of single objects and in streets, and on
    scans by the two eyes of a depth camera; each is tested on all four, and on real objects.""",
}
TEXT = """

    \b
    Writes into --out:
      study.html, study.md   the answers, tables beside the paper's, plots
      *.png                  the plots
      results/*.json         one file a classifier: how it labelled each test set, how it was trained
      classifiers/           the trained models, for `zbuf-occlude evaluate`
      clouds/                the datasets, as of `zbuf-occlude generate`

    The same command again does only what is missing; also after a kill, after another experiment in the same folder, or
    with scans or a budget given for the first time. Without a GPU take --quick; --models to --epochs change one thing
    of it, or of the full size. Exit code 3: done, but some meshes failed (they are named).

    \b
    Examples:
      zbuf-occlude paper table3 --quick --out study
      zbuf-occlude paper augmentation --quick --budget clouds --budget epochs --models voxnet --out budgets
      zbuf-occlude paper elevation --quick --voxels 30 --seeds 3 --out voxels
      zbuf-occlude paper augmentation --modelnet ModelNet40 --sydney sydney-urban-objects-dataset --out study
"""


@click.command(cls=Command)
@click.argument("name", type=Name([ELEVATION, AUGMENTATION, REALISM, ALL]))
@click.option("--out", type=OutFolder(), required=True, help="Folder of the study.")
@click.option("--quick", is_flag=True, help=f"{QUICK.summary[0].upper()}{QUICK.summary[1:]}; else {FULL.summary}.")
@click.option(
    "--modelnet",
    type=click.Path(path_type=Path),
    metavar="ROOT",
    help="ModelNet40's folder, or ModelNet10's for elevation.  [default: the built-in shapes]",
)
@click.option(
    "--sydney",
    "scans",
    type=click.Path(path_type=Path),
    metavar="ROOT",
    help="Sydney Urban Objects, unpacked: Test 3, on real scans.",
)
@click.option(
    "--sydney-up", "scans_up", type=Name(UPS), help="Up direction of the scans.  [default: found from the scans]"
)
@click.option(
    "--real",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Labelled sweeps of real drives, of KITTI or Argoverse 2: one more test.",
)
@click.option("--voxels", type=int, metavar="N", help="Take each object as the surface of N^3 voxels; 30 is usual.")
@click.option(
    "--budget",
    "budgets",
    type=Name(list(BUDGETS)),
    multiple=True,
    help=f"Training of 4.3: as many clouds each, or each cloud as often; repeatable.  [default: {CLOUDS}]",
)
@click.option("--models", metavar="NAME,...", help=f"Of {', '.join(model.name for model in MODELS)}.")
@click.option("--seeds", type=click.IntRange(1), metavar="N", help="Train each classifier with the seeds 0 to N - 1.")
@click.option(
    "--objects", type=int, metavar="N", help="Objects of each class to train; in 4.3 also 1/4 to validate, 5/8 to test."
)
@click.option("--points", metavar="N[,N]", help="Points of a cloud; 4.3 takes all of several, 4.2 the last.")
@click.option(
    "--epochs",
    type=click.IntRange(1),
    metavar="N",
    help="Epochs at most; under --budget clouds of the classifier with the fewest clouds.",
)
def experiment_command(name: str, **options: Any) -> None:
    """Repeat the paper's experiments with classifiers; now `zbuf-occlude paper NAME` (`table3` for `all`).

    `zbuf-occlude paper NAME --help` says what an experiment does and writes.
    """
    new = BOTH if name == ALL else name
    replaced(f"experiment {name}", f"paper {new}")
    refuse_unused(name, UNUSED[new])
    run_experiment(new, **options)


def experiment_named(name: str) -> click.Command:
    """Return the command of an experiment."""
    options = {str(parameter.name) for parameter in experiment_command.params} - {"name"} - UNUSED[name]
    return derived(experiment_command, name, options, run_experiment, TEXTS[name] + TEXT)


def run_experiment(
    name: str,
    out: Path,
    quick: bool,
    models: str | None,
    seeds: int | None,
    objects: int | None,
    points: str | None,
    epochs: int | None = None,
    scans: Path | None = None,
    scans_up: str | None = None,
    budgets: tuple[str, ...] = (),
    **options: Any,
) -> None:
    """Run an experiment, write its report, and print its answers."""
    if scans_up is not None and scans is None:
        raise click.UsageError("--sydney-up must go with --sydney, whose scans it is about.")
    try:
        numbers = None if points is None else [int(each) for each in points.split(",")]
    except ValueError:
        raise click.BadParameter(f"it must be N or N,N; got {points!r}.", param_hint="--points") from None
    names = None if models is None else [each.strip() for each in models.split(",") if each.strip()]
    size = QUICK if quick else FULL
    size = changed(size, models=names, seeds=seeds, objects=objects, points=numbers, epochs=epochs)
    require_torch()
    from zbuf_occlude.paper.study import EXPERIMENTS, run_study  # late: imports PyTorch

    options |= {"scans": scans, "scans_up": scans_up, "budgets": tuple(dict.fromkeys(budgets)) or (CLOUDS,)}
    bars = Bars()
    try:
        n_worked = run_study(out, size, experiments=EXPERIMENTS if name == BOTH else (name,), progress=bars, **options)
    finally:
        bars.close()
    written = write_study(out)
    for sentence in answers(read_results(out)):
        echo(sentence.replace("`", "").replace("**", ""))
    echo(f"{counted(n_worked, 'classifier')} trained or tested now; report: {written[0]}")
    if failed := read_study(out)["failed_meshes"]:
        head = f"{counted(len(failed), 'mesh', 'meshes')} failed:"
        echo("\n".join([head, *(f"  {key}: {why}" for key, why in failed.items())]))
        raise SystemExit(SOME_FAILED)


class Bars(Progress):
    """Progress as two bars on stderr, one after the other: clouds, then classifiers."""

    def __init__(self) -> None:
        self._bar: Any = None
        self._n_trials = 0
        self._shares: dict[str, float] = {}

    def plan(self, n_clouds: int, n_trials: int) -> None:
        """Begin the bar of the clouds."""
        self._n_trials = n_trials
        self._bar = progress_bar(n_clouds, "clouds", "clouds")

    def clouds(self, n: int) -> None:
        """Move the bar of the clouds."""
        self._bar.update(n)

    def trial(self, key: str, share: float) -> None:
        """Move the bar of the classifiers, which is begun by the first."""
        if self._n_trials:
            self._bar.close()
            self._bar = progress_bar(self._n_trials, "classifiers", "classifiers", bar_format=_FORMAT)
            self._n_trials = 0
        self._bar.set_postfix_str(key, refresh=False)
        self._bar.update(max(0.0, share - self._shares.get(key, 0.0)))
        self._shares[key] = share

    def close(self) -> None:
        """End the bar."""
        if self._bar is not None:
            self._bar.close()


_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total_fmt} [{elapsed}<{remaining}{postfix}]"

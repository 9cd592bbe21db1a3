"""Commands `paper elevation|augmentation|table3|realism|real` (old name `experiment`): experiments with classifiers."""

from math import inf
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.cli.paper import derived, refuse_unused, replaced
from zbuf_occlude.cli.shared_options import OutFolder, finite
from zbuf_occlude.cli.shell import SOME_FAILED, UNFINISHED, Command, Name, counted, echo, progress_bar
from zbuf_occlude.datasets.real.sydney import UPS
from zbuf_occlude.studies.learn.models import MODELS, require_torch
from zbuf_occlude.studies.paper.design import (
    AUGMENTATION,
    BUDGETS,
    CLOUDS,
    ELEVATION,
    FULL,
    QUICK,
    REAL,
    REALISM,
    Progress,
    changed,
)
from zbuf_occlude.studies.paper.results import read_results, read_study
from zbuf_occlude.studies.paper.study_report import tables_of_answers, write_study

BOTH, ALL = "table3", "all"
"""Name of the paper's experiments together, in `paper` and in `experiment`."""
UNUSED = {
    ELEVATION: {"scans", "scans_up", "real", "budgets"},
    AUGMENTATION: {"real"},
    BOTH: {"real", "epochs"},
    REALISM: {"scans", "scans_up", "budgets"},
    REAL: {"scans", "scans_up", "budgets", "modelnet", "voxels", "real"},
}
"""Options that an experiment does not use; those of `BOTH` have different epochs."""
TEXTS = {
    ELEVATION: """Repeat 4.2, Table 3A: accuracy against the camera's elevation.

    VoxNet, PointNet and 3DmFV are trained on clouds from some elevations of the camera and tested on others. The
    report also has the projected areas of the visible parts (Fig. 12).""",
    AUGMENTATION: """Repeat 4.3 and 4.4, Table 3B: training sets.

    Classifiers are trained on occluded clouds, on complete ones, and on both; they are tested on complete clouds, on
    occluded ones, and on real scans. Methods of hidden-surface removal are compared by their training clouds.""",
    BOTH: """Repeat Tables 3A and 3B: `paper elevation` and `paper augmentation` in one study.""",
    REALISM: """Train and test classifiers on scans by a LiDAR, in streets, and by a depth camera; not in the paper.

    Classifiers are trained on uniform occluded clouds, on LiDAR scans of single objects, on LiDAR scans in streets, or
    on scans by a depth camera with two eyes. Each is tested on all four kinds, and on real objects.""",
    REAL: """Train classifiers on generated clouds and test them on the objects of a real drive (4.4, Test 3).

    DIR: labelled sweeps in the layout of KITTI, Argoverse 2 or nuScenes. Road users of the built-in shapes become
    complete clouds, occluded clouds, and scans by an HDL-64E in streets. Classifiers are trained on each, on complete
    and occluded clouds, and on complete clouds and scans; on scans also with the azimuths of traffic, and with clouds
    in metres. They are tested on the labelled objects of the drive, and on simulated scans held out. KITTI's sweeps on
    which the sensor's model was fitted are told apart. --quick takes up to half an hour on two processor cores.""",
}
TEXT = """

    \b
    Writes into --out:
      study.html, study.md   tables beside the paper's, plots
      *.png                  the plots
      results/*.json         one file per classifier: confusion matrices of its tests, its training
      classifiers/           the trained models, for `zbuf-occlude evaluate`
      clouds/                the datasets, as `zbuf-occlude generate` writes them

    The same command again makes only missing results: after an interruption, after another experiment in the same
    folder, or with new scans or a new budget. Without a GPU use --quick; --models to --epochs change single values of
    it or of the full size. --minutes X stops after X minutes, when the current shard of clouds or epoch ends; the same
    command continues, also on another machine with a copy of the folder. Exit code 3: done, but some meshes
    failed (they are listed). Exit code 4: the time was up before all was done.

    \b
    Examples:
      zbuf-occlude paper table3 --quick --out study
      zbuf-occlude paper table3 --minutes 6 --out study
      zbuf-occlude paper augmentation --quick --budget clouds --budget epochs --models voxnet --out budgets
      zbuf-occlude paper elevation --quick --voxels 30 --seeds 3 --out voxels
      zbuf-occlude paper real kitti/training --quick --out real
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
    help="Sydney Urban Objects, unpacked, for Test 3 on real scans.",
)
@click.option(
    "--sydney-up", "scans_up", type=Name(UPS), help="Up direction of the scans.  [default: found from the scans]"
)
@click.option(
    "--real",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Labelled sweeps of real drives (KITTI, Argoverse 2) for one more test.",
)
@click.option("--voxels", type=int, metavar="N", help="Replace each object by the surface of N^3 voxels; 30 is usual.")
@click.option(
    "--budget",
    "budgets",
    type=Name(list(BUDGETS)),
    multiple=True,
    help=f"Budget of trainings of 4.3: equal clouds shown, or equal epochs; repeatable.  [default: {CLOUDS}]",
)
@click.option("--models", metavar="NAME,...", help=f"Models: {', '.join(model.name for model in MODELS)}.")
@click.option("--seeds", type=click.IntRange(1), metavar="N", help="Train each classifier with seeds 0 to N - 1.")
@click.option(
    "--objects",
    type=int,
    metavar="N",
    help="Training objects per class; in 4.3 also 1/4 for validation and 5/8 for the test.",
)
@click.option("--points", metavar="N[,N]", help="Points per cloud; of several numbers, 4.3 uses all and 4.2 the last.")
@click.option(
    "--epochs",
    type=click.IntRange(1),
    metavar="N",
    help="Maximum epochs; under --budget clouds, for the classifier with the fewest clouds.",
)
@click.option(
    "--minutes",
    type=click.FloatRange(0, min_open=True),
    callback=finite,
    metavar="X",
    help="Stop after X minutes; the same command continues.  [default: when all is done]",
)
def experiment_command(name: str, **options: Any) -> None:
    """Repeat the paper's experiments with classifiers; replaced by `zbuf-occlude paper NAME` (`table3` for `all`).

    `zbuf-occlude paper NAME --help` describes an experiment and its files.
    """
    new = BOTH if name == ALL else name
    replaced(f"experiment {name}", f"paper {new}")
    refuse_unused(name, UNUSED[new])
    run_experiment(new, **options)


def experiment_named(name: str) -> click.Command:
    """Return the command that runs an experiment."""
    options = {str(parameter.name) for parameter in experiment_command.params} - {"name"} - UNUSED[name]
    command = derived(experiment_command, name, options, run_experiment, TEXTS[name] + TEXT)
    if name == REAL:
        command.params.insert(0, click.Argument(["real"], type=click.Path(path_type=Path), metavar="DIR"))
    return command


def run_experiment(
    name: str,
    out: Path,
    quick: bool,
    models: str | None,
    seeds: int | None,
    objects: int | None,
    points: str | None,
    epochs: int | None = None,
    minutes: float | None = None,
    scans: Path | None = None,
    scans_up: str | None = None,
    budgets: tuple[str, ...] = (),
    **options: Any,
) -> None:
    """Run an experiment, write its report, and print its main tables."""
    if scans_up is not None and scans is None:
        raise click.UsageError("--sydney-up must go with --sydney.")
    try:
        numbers = None if points is None else [int(each) for each in points.split(",")]
    except ValueError:
        raise click.BadParameter(f"it must be N or N,N; got {points!r}.", param_hint="--points") from None
    names = None if models is None else [each.strip() for each in models.split(",") if each.strip()]
    size = QUICK if quick else FULL
    size = changed(size, models=names, seeds=seeds, objects=objects, points=numbers, epochs=epochs)
    require_torch()
    from zbuf_occlude.studies.paper.study import EXPERIMENTS, run_study  # late: imports PyTorch

    options |= {"scans": scans, "scans_up": scans_up, "budgets": tuple(dict.fromkeys(budgets)) or (CLOUDS,)}
    options |= {"minutes": minutes or inf}
    bars = Bars()
    try:
        work = run_study(out, size, experiments=EXPERIMENTS if name == BOTH else (name,), progress=bars, **options)
    finally:
        bars.close()
    report = ""
    if read_results(out):
        report = f"; report: {write_study(out)[0]}"
        for table in tables_of_answers(out):
            echo(table.as_markdown(aligned=True))
    echo(f"{counted(work.n_now, 'classifier')} trained or tested now{report}")
    if failed := read_study(out)["failed_meshes"]:
        head = f"{counted(len(failed), 'mesh', 'meshes')} failed:"
        echo("\n".join([head, *(f"  {key}: {why}" for key, why in failed.items())]))
    if work.n_done < work.n_planned:
        done = f"{bars.n_made:,} of {bars.n_clouds:,} clouds and {work.n_done} of {work.n_planned} classifiers"
        echo(f"The time is up: {done} are done. The same command continues.")
        raise SystemExit(UNFINISHED)
    if failed:
        raise SystemExit(SOME_FAILED)


class Bars(Progress):
    """Two progress bars on stderr: first of clouds, then of classifiers."""

    def __init__(self) -> None:
        self._bar: Any = None
        self.n_clouds, self.n_made, self._n_trials = 0, 0, 0
        self._shares: dict[str, float] = {}

    def set_totals(self, n_clouds: int, n_trials: int) -> None:
        """Begin the bar of clouds."""
        self.n_clouds, self._n_trials = n_clouds, n_trials
        self._bar = progress_bar(n_clouds, "clouds", "clouds")

    def add_clouds(self, n: int) -> None:
        """Advance the bar of clouds."""
        self.n_made += n
        self._bar.update(n)

    def update_trial(self, key: str, share: float) -> None:
        """Advance the bar of classifiers, which the first call begins."""
        if self._n_trials:
            self._bar.close()
            self._bar = progress_bar(self._n_trials, "classifiers", "classifiers", bar_format=_FORMAT)
            self._n_trials = 0
        self._bar.set_postfix_str(key, refresh=False)
        self._bar.update(max(0.0, share - self._shares.get(key, 0.0)))
        self._shares[key] = share

    def close(self) -> None:
        """Close the bar."""
        if self._bar is not None:
            self._bar.close()


_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total_fmt} [{elapsed}<{remaining}{postfix}]"

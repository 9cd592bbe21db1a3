"""Commands `train` and `evaluate`: classifiers trained and tested on datasets, crops and folders of clouds by class."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.cli.shared_options import OutFolder
from zbuf_occlude.cli.shell import Command, Name, counted, echo, progress_bar
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.studies.learn.data import RAGGED, load_datasets, shared_objects
from zbuf_occlude.studies.learn.models import MODELS, require_torch

if TYPE_CHECKING:
    from zbuf_occlude.studies.learn.breakdown import Answers

HELD_OUT = 0.1
"""Fraction of the objects or sweeps held out for validation where a dataset has no split val."""


@click.command(cls=Command)
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DIR...")
@click.option("--out", type=OutFolder(), required=True, help="Folder of the model.")
@click.option("--model", type=Name([row.name for row in MODELS]), default="voxnet", help="Network architecture.")
@click.option("--epochs", type=click.IntRange(1), default=100, help="Maximum number of epochs.")
@click.option(
    "--patience",
    type=click.IntRange(1),
    default=20,
    help="Epochs without a better validation after which training stops.",
)
@click.option("--batch-size", type=click.IntRange(2), default=32, help="Clouds per training step.")
@click.option("--learning-rate", type=float, default=0.001, help="Initial learning rate of Adam.")
@click.option(
    "--points", "n_points", type=click.IntRange(1), help="Points of each cloud that are used.  [default: all]"
)
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@click.option("--rotate/--no-rotate", default=True, help="Augment by rotation about the z axis.")
@click.option("--rescale/--no-rescale", default=True, help="Augment by scaling by 0.8 to 1.25.")
@click.option("--jitter/--no-jitter", default=True, help="Augment by noise on each coordinate.")
@click.option("--device", default="auto", help="cpu, cuda, cuda:N; auto: CUDA if available.")
@click.option("--mixed-precision/--full-precision", default=True, help="Automatic mixed precision on CUDA.")
def train_command(folders: tuple[Path, ...], out: Path, **options: Any) -> None:
    """Train a classifier on the clouds of DIR, one or more datasets.

    A DIR is a dataset of `generate` in any format, crops of real scans (`crop`), or a folder of clouds by class:
    CLASS/FILE or SPLIT/CLASS/FILE (.ply, .pcd, .bin, .npy, .npz). The classes of several DIRs are joined by name.

    The split train is used for training. The split val decides which epoch is best and when to stop; without it, 10 %
    of the objects of train, or of the sweeps of real scans, are held out. All clouds have the least number of points
    of the datasets; where all datasets have clouds of unequal size, --points or 1,024.

    \b
    Writes into --out:
      model.pt        weights of the best epoch, the classes, the options
      history.json    loss and validation of each epoch
      checkpoint.pt   during training; the same command again resumes from it

    \b
    Examples:
      zbuf-occlude generate --sample-size 1024 --out clouds
      zbuf-occlude train clouds --model pointnet --out pointnet
      zbuf-occlude evaluate pointnet clouds
    """
    require_torch()
    from zbuf_occlude.studies.learn.training import TrainConfig, hold_out, train  # late: imports PyTorch

    config = TrainConfig(**options)
    config.find_device()  # raises before any file is read
    ragged = config.n_points or RAGGED
    training = load_datasets(folders, "train", ragged)
    if all("val" in open_dataset(folder).order for folder in folders):
        validation = load_datasets(folders, "val", ragged)
    else:
        training, validation = hold_out(training, HELD_OUT, config.seed)
    echo(f"{len(training)} clouds to train on, {len(validation)} to validate with", err=True)
    for split, n_shared, n_objects in shared_objects(folders):
        echo(
            f"warning: {n_shared} of {counted(n_objects, 'object')} of {split} are also in train of another DIR: "
            "scores will be too high. Generate both with the same --split and --seed.",
            err=True,
        )
    meshes = [entry for folder in folders for entry in open_dataset(folder).plan.meshes]
    tested = {"val": validation.labelled, "test": sorted({e.label for e in meshes if e.split == "test"})}
    for split, labels in tested.items():
        unknown = [label for label in labels if label not in training.labelled]
        if unknown and len(unknown) == len(labels):
            raise DatasetError(
                f"train and {split} must share a class; train has {', '.join(training.labelled)}, {split} "
                f"{', '.join(labels)}. Generate more objects: raise --limit or leave it out."
            )
        if unknown:
            echo(f"warning: {split} has classes without training clouds: {', '.join(unknown)}", err=True)
    with progress_bar(config.epochs, "epochs", "train") as bar:

        def progress(epoch: Any) -> None:
            bar.update(epoch.number - bar.n)
            bar.set_postfix_str(f"loss {epoch.loss:.3f}, validation {epoch.validation_accuracy:.1%}")

        trained = train(config, training, validation, out, progress=progress)
    n_parameters = sum(parameter.numel() for parameter in trained.model.parameters())
    best, n_epochs = trained.best, len(trained.history)
    echo(
        f"{config.model}, {n_parameters:,} parameters, {len(trained.classes)} classes: "
        f"{best.validation_accuracy:.1%} of the validation after epoch {best.number} of {n_epochs} "
        f"({trained.seconds:.0f} s)\nmodel    {out / 'model.pt'}\nhistory  {out / 'history.json'}"
    )


@click.command(cls=Command)
@click.argument("model", type=click.Path(path_type=Path), metavar="MODEL")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DIR...")
@click.option("--split", type=Name(SPLITS), default="test", help="Split of DIR to test on.")
@click.option("--out", type=OutFolder(), help="Folder of the results.  [default: MODEL]")
@click.option("--device", default="auto", help="cpu, cuda, cuda:N; auto: CUDA if available.")
def evaluate_command(model: Path, folders: tuple[Path, ...], split: str, out: Path | None, device: str) -> None:
    """Test the classifier that `train` wrote to the folder MODEL on the clouds of DIR, one or more datasets.

    A DIR is a dataset of `generate`, crops of real scans (`crop`), or a folder of clouds by class: CLASS/FILE or
    SPLIT/CLASS/FILE (.ply, .pcd, .bin, .npy, .npz). A folder without splits is tested whole. Its classes must be among
    those of the training. The same number of points per cloud is used as in training.

    Scores have 95 % intervals by bootstrap: whole sweeps of real scans, or whole objects, are resampled.

    \b
    Writes into --out:
      evaluation.json   accuracy; precision, recall and F1 of each class; confusion matrix; scores by range and points
      evaluation.png    the confusion matrix

    \b
    Examples:
      zbuf-occlude evaluate pointnet clouds --split test
      zbuf-occlude evaluate pointnet crops --out real
    """
    require_torch()
    from zbuf_occlude.studies.learn.breakdown import Answers  # late: imports PyTorch
    from zbuf_occlude.studies.learn.training import load_trained

    trained = load_trained(model, device)
    n_points, seed = trained.n_points, trained.config.seed
    test = load_datasets(folders, split, n_points)
    if n_points > test.n_points:
        raise DatasetError(
            f"clouds must have at least the {n_points} points that the model was trained with; those of DIR have "
            f"{test.n_points}. Generate them with --sample-size {n_points}."
        )
    if unknown := [label for label in test.labelled if label not in trained.classes]:
        raise DatasetError(
            f"the datasets must have the classes of the model, {', '.join(trained.classes)}; "
            f"they have {', '.join(test.classes)}, with {', '.join(unknown)}. Choose another model, or train one on "
            "these datasets."
        )
    test = test.with_classes(trained.classes)
    answers = Answers.of_model(trained.model, test.select_points(n_points, seed))
    out = model if out is None else out
    answers.write(out)
    for line in format_answers(answers):
        echo(line)
    echo(f"figures  {out / 'evaluation.json'}\npicture  {out / 'evaluation.png'}")


def format_answers(answers: "Answers") -> list[str]:
    """Return the scores of a test as lines: of each class, in all, by range and by number of points."""
    confusion, scores = answers.confusion, answers.scores()
    width = max(len("class"), *map(len, answers.classes))
    lines = [f"{'class':{width}}  clouds  precision  recall      F1"]
    columns = zip(confusion.precision, confusion.recall, confusion.f1, strict=True)
    for label, n_clouds, figures in zip(answers.classes, confusion.counts.sum(axis=1), columns, strict=True):
        precision, recall, f1 = (f"{value:.1%}" if math.isfinite(value) else "-" for value in figures)
        lines.append(f"{label:{width}}  {n_clouds:6}  {precision:>9}  {recall:>6}  {f1:>6}")
    lines.append(
        f"accuracy {scores['accuracy']} of {confusion.n_clouds} clouds, mean recall {scores['recall']}, "
        f"macro F1 {scores['f1']}; "
        f"95 % by bootstrap over {counted(answers.n_groups, 'sweep or object', 'sweeps or objects')}"
    )
    for unit, rows in (("metres", answers.by_range), ("points", answers.by_points)):
        if len(rows) > 1:
            lines.append(f"{unit:>11}  clouds  {'accuracy':24}{'mean recall':24}macro F1")
        for row in rows if len(rows) > 1 else ():
            bounds = f"{row.low:g}-{row.high:g}" if math.isfinite(row.high) else f"{row.low:g}-"
            cells = "".join(f"{score!s:24}" for score in row.scores.values())
            lines.append(f"{bounds:>11}  {row.n_clouds:6}  {cells}".rstrip())
    return lines

"""Commands `train` and `evaluate`: classifiers trained and tested on datasets of `generate`."""

import math
from functools import reduce
from pathlib import Path
from typing import Any

import click

from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.cli.shared_options import OutFolder
from zbuf_occlude.cli.shell import Command, Name, echo, progress_bar
from zbuf_occlude.datasets.source import open_dataset
from zbuf_occlude.meshes.collection import SPLITS
from zbuf_occlude.studies.learn.data import CloudSet, load_clouds
from zbuf_occlude.studies.learn.models import MODELS, require_torch

HELD_OUT = 0.1
"""Fraction of the objects held out for validation where a dataset has no split val."""


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
    """Train a classifier on the clouds of DIR, one or more datasets of `generate`, in any format.

    The split train is used for training. The split val decides which epoch is best and when to stop; without it, 10 %
    of the objects of train are held out. Several DIRs must have the same classes, such as a dataset and the complete
    clouds of its preset.

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
    training = load_split(folders, "train")
    if all("val" in open_dataset(folder).order for folder in folders):
        validation = load_split(folders, "val")
    else:
        training, validation = hold_out(training, HELD_OUT, config.seed)
    echo(f"{len(training)} clouds to train on, {len(validation)} to validate with", err=True)
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


def load_split(folders: tuple[Path, ...], split: str) -> CloudSet:
    """Return a split of all datasets; raises DatasetError or ArgumentError where classes or sizes differ."""
    return reduce(CloudSet.concatenate, (load_clouds(folder, split) for folder in folders))


@click.command(cls=Command)
@click.argument("model", type=click.Path(path_type=Path), metavar="MODEL")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DIR...")
@click.option("--split", type=Name(SPLITS), default="test", help="Split of DIR to test on.")
@click.option("--out", type=OutFolder(), help="Folder of the results.  [default: MODEL]")
@click.option("--device", default="auto", help="cpu, cuda, cuda:N; auto: CUDA if available.")
def evaluate_command(model: Path, folders: tuple[Path, ...], split: str, out: Path | None, device: str) -> None:
    """Test the classifier that `train` wrote to the folder MODEL on the clouds of DIR, datasets of `generate`.

    DIR must have the classes of the training. The same number of points per cloud is used as in training.

    \b
    Writes into --out:
      evaluation.json   accuracy; precision, recall and F1 of each class; confusion matrix
      evaluation.png    the confusion matrix

    \b
    Example:
      zbuf-occlude evaluate pointnet clouds --split test
    """
    require_torch()
    from zbuf_occlude.studies.learn.evaluation import evaluate  # late: imports PyTorch
    from zbuf_occlude.studies.learn.training import load_trained

    trained = load_trained(model, device)
    test = load_split(folders, split)
    n_points = trained.config.n_points
    if n_points is not None and n_points > test.n_points:
        raise DatasetError(
            f"clouds must have at least the {n_points} points that the model was trained with; those of DIR have "
            f"{test.n_points}. Generate them with --sample-size {n_points}."
        )
    if n_points is not None:
        test = test.select_points(n_points, trained.config.seed)
    if test.classes != trained.classes:
        raise DatasetError(
            f"the datasets must have the classes of the model, {', '.join(trained.classes)}; "
            f"they have {', '.join(test.classes)}. Choose another model, or train one on these datasets."
        )
    evaluation = evaluate(trained.model, test)
    out = model if out is None else out
    evaluation.write(out)
    n_clouds_of = evaluation.counts.sum(axis=1)
    columns = zip(evaluation.precision, evaluation.recall, evaluation.f1, strict=True)
    width = max(len("class"), *map(len, test.classes))
    echo(f"{'class':{width}}  clouds  precision  recall      F1")
    for label, n_clouds, figures in zip(test.classes, n_clouds_of, columns, strict=True):
        precision, recall, f1 = (f"{value:.1%}" if math.isfinite(value) else "-" for value in figures)
        echo(f"{label:{width}}  {n_clouds:6}  {precision:>9}  {recall:>6}  {f1:>6}")
    echo(
        f"accuracy {evaluation.accuracy:.1%} of {evaluation.n_clouds} clouds\n"
        f"figures  {out / 'evaluation.json'}\npicture  {out / 'evaluation.png'}"
    )

"""`zbuf-occlude evaluate`: how good a trained classifier is on a dataset."""

import math
from pathlib import Path

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import OutFolder
from zbuf_occlude.cli.panels import Command, Name
from zbuf_occlude.cli.train import load
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.learn.models import require_torch
from zbuf_occlude.meshes.collection import SPLITS


@click.command(cls=Command)
@click.argument("model", type=click.Path(path_type=Path), metavar="MODEL")
@click.argument("folders", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DIR...")
@click.option("--split", type=Name(SPLITS), default="test", show_default=True, help="Which clouds of DIR.")
@click.option("--out", type=OutFolder(), help="Folder of the figures.  [default: MODEL]")
@click.option("--device", default="auto", show_default=True, help="cpu, cuda, cuda:N; auto takes CUDA if it is there.")
def command(model: Path, folders: tuple[Path, ...], split: str, out: Path | None, device: str) -> None:
    """Test the classifier that `train` left in the folder MODEL on the clouds of DIR, datasets of `generate`.

    DIR must have the classes that the classifier was trained on. As many points of each cloud are looked at as in
    training.

    \b
    Writes into --out:
      evaluation.json   accuracy; precision, recall and F1 of each class; confusion matrix
      evaluation.png    the confusion matrix

    \b
    Example:
      zbuf-occlude evaluate pointnet clouds --split test
    """
    require_torch()
    from zbuf_occlude.learn.evaluation import evaluate  # late: these need torch
    from zbuf_occlude.learn.training import load_trained

    trained = load_trained(model, device)
    test = load(folders, split)
    n_points = trained.config.n_points
    if n_points is not None and n_points > test.n_points:
        raise DatasetError(
            f"the datasets must have clouds of the {n_points} points that the model was trained with, at least; "
            f"theirs have {test.n_points}. Generate them with --sample-size {n_points}."
        )
    if n_points is not None:
        test = test.select_points(n_points, trained.config.seed)
    if test.classes != trained.classes:
        raise DatasetError(
            f"the datasets must have the classes of the model, {', '.join(trained.classes)}; "
            f"they have {', '.join(test.classes)}. Choose another model, or train one on them."
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

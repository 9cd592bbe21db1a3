"""Commands `compare` and `report`: error and time of methods, and their report."""

from pathlib import Path
from typing import Any

import click

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.cli.paper import derived, replaced
from zbuf_occlude.cli.shared_options import (
    AUTO_ELSEWHERE,
    VIEWS,
    MeshPlace,
    OutFolder,
    Setting,
    choice_options,
    collect,
    distance_option,
    explicitly_set,
    parse_settings,
    up_option,
)
from zbuf_occlude.cli.shell import SOME_FAILED, Command, Name, counted, echo, progress_bar
from zbuf_occlude.datasets.auto import AUTO
from zbuf_occlude.datasets.plan import DatasetConfig
from zbuf_occlude.studies.compare.cases import (
    MAX_VIEWS,
    SCALING,
    Case,
    Subject,
    default_subjects,
    mesh_cases,
    scaling_cases,
)
from zbuf_occlude.studies.compare.metrics import format_milliseconds, format_percent, rank_subjects, representatives
from zbuf_occlude.studies.compare.run import ROW_SECONDS, ComparisonFolder, run
from zbuf_occlude.studies.paper.tables import CASES, paper_tables
from zbuf_occlude.visibility.interface import EYES_INSIDE

BUILT_IN_MESHES = 8
DEFAULT_SECONDS = 3.0
OF_MESHES = ("methods", "views", "distance", "most_views", "points", "limit", "up", "labels", "classes", "splits")
"""Options of comparisons of meshes; a preset has its own meshes, methods and views."""


@click.command(cls=Command)
@click.argument("meshes", nargs=-1, type=MeshPlace(), metavar="[MESH_OR_DIR]...")
@click.option("--out", type=OutFolder(), required=True, help="Folder of the rows and the report.")
@click.option(
    "--method",
    "methods",
    metavar="NAME[:KEY=VALUE,...]",
    multiple=True,
    help="Method and its options; repeatable.  [default: all, with a sweep of options]",
)
@click.option(
    "--preset",
    "presets",
    type=Name([*CASES, SCALING]),
    multiple=True,
    help=f"{SCALING}: time against points and faces; {', '.join(CASES)}: see `zbuf-occlude paper`.",
)
@click.option(
    "--modelnet",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    help="ModelNet40's folder, for table1a and table1b.",
)
@click.option("--views", default="paper100", help=VIEWS)
@distance_option
@click.option(
    "--most-views", type=click.IntRange(1), default=MAX_VIEWS, help="Maximum number of views compared, evenly chosen."
)
@click.option("--points", type=click.IntRange(1), default=10_000, help="Points sampled on each mesh.")
@click.option(
    "--judge-points",
    "reference_points",
    type=click.IntRange(1),
    metavar="N",
    help="Points compared with the reference.  [default: half a minute per mesh]",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.01),
    help="Seconds of timed calls per row.  [default: 3; 30 in table1a and table1b]",
)
@click.option("--row-seconds", type=click.FloatRange(1), default=ROW_SECONDS, help="Timeout of a row in seconds.")
@click.option("--seed", type=click.IntRange(0), default=0, help="Seed of all random draws.")
@click.option("--limit", type=click.IntRange(1), metavar="N", help="Only the first N meshes (classes interleaved).")
@up_option
@choice_options
@click.pass_context
def compare_command(
    context: click.Context,
    /,
    meshes: tuple[Path, ...],
    out: Path,
    methods: tuple[str, ...],
    presets: tuple[str, ...],
    modelnet: Path | None,
    views: str,
    distance: tuple[float, float | None],
    most_views: int,
    points: int,
    reference_points: int | None,
    seconds: float | None,
    row_seconds: float,
    seed: int,
    limit: int | None,
    up: str | None,
    **choice: Any,
) -> None:
    """Compare methods of hidden-surface removal with the exact reference (oracle) and with each other.

    MESH_OR_DIR: as for `generate`. Without any, and without a preset, one built-in shape of each class is used.

    \b
    Writes into --out:
      rows.jsonl               a row for each mesh and method: errors, times, memory, versions
      report.html, report.md   tables, plots, and the worst views in 3D
      *.png                    the plots

    The same command again resumes; failed rows are tried again. Exit code 3: done, but some rows failed.

    \b
    Examples:
      zbuf-occlude compare ModelNet40/chair --limit 5 --out comparison
      zbuf-occlude compare chair.off --method exact --method depth_buffer:resolution=1024 --out comparison
      zbuf-occlude compare --preset scaling --out scaling
    """
    refuse_idle(context, presets, alone=bool(presets) and not meshes)
    subjects = [parse_subject(text) for text in methods] or default_subjects()
    cases: list[Case] = []
    if meshes or not presets:
        collection = collect(meshes, up, limit if meshes or limit else BUILT_IN_MESHES, **choice)
        config = DatasetConfig(views=views, distance=distance[0], farthest=distance[1], seed=seed)
        config.make_views()  # raises for wrong --views
        cases += mesh_cases(collection, subjects, config.make_views, n_points=points, seed=seed, most_views=most_views)
    for name in presets:
        if name in CASES:
            replaced(f"compare --preset {name}", f"paper {name}")
        cases += CASES[name](modelnet, seed, seconds) if name in CASES else scaling_cases(seed, seconds)
    run_cases(cases, out, reference_points, seconds, row_seconds)


def table1_command(name: str) -> click.Command:
    """Return the command that repeats Table 1A or 1B."""

    def repeat(name: str, modelnet: Path | None, seed: int, seconds: float | None, **options: Any) -> None:
        run_cases(CASES[name](modelnet, seed, seconds), seconds=seconds, **options)

    options = {"out", "modelnet", "reference_points", "seconds", "row_seconds", "seed"}
    text = (
        f"Repeat the paper's Table {name[5:].upper()}; writes rows.jsonl and a report, as `compare` does.\n\n"
        "The same command again resumes; failed rows are tried again. Exit code 3: done, but some rows failed."
    )
    return derived(compare_command, name, options, repeat, text)


def run_cases(
    cases: list[Case], out: Path, reference_points: int | None, seconds: float | None, row_seconds: float
) -> None:
    """Make the missing rows and write the report."""
    timed, total = DEFAULT_SECONDS if seconds is None else seconds, sum(len(case.subjects) for case in cases)
    with progress_bar(total, "rows", "compare") as bar:

        def progress(text: str) -> None:
            n_done = 1 if bar.postfix else 0  # the row announced before is done
            bar.set_postfix_str(text, refresh=False)
            bar.update(n_done)

        counts = run(cases, out, budget=timed, limit=row_seconds, reference_points=reference_points, progress=progress)
        bar.update(total - bar.n)
    page = write_and_summarise(out)
    echo(f"{counts.made} rows made, {counts.found} found, {counts.failed} failed; report: {page}")
    if counts.failed:
        raise SystemExit(SOME_FAILED)


def refuse_idle(context: click.Context, presets: tuple[str, ...], *, alone: bool) -> None:
    """Raise UsageError for options that neither the meshes nor the presets use."""
    if alone and (idle := explicitly_set(context, OF_MESHES)):
        raise click.UsageError(
            f"{', '.join(idle)} must go with MESH_OR_DIR; {', '.join(presets)} alone has its own methods, points and "
            "views. Give meshes, or leave it out."
        )
    if explicitly_set(context, ("modelnet",)) and not set(presets) & set(CASES):
        raise click.UsageError(
            f"--modelnet must go with --preset {' or '.join(CASES)}. "
            "To compare the meshes of ModelNet40, give its folder as MESH_OR_DIR."
        )


def parse_subject(text: str) -> Subject:
    """Parse ``NAME[:KEY=VALUE,...]``; raises OptionError for an unknown method or option."""
    name, colon, settings = text.partition(":")
    if name == AUTO:
        raise OptionError(f"--method: {AUTO_ELSEWHERE}; `zbuf-occlude methods` lists them.")
    if colon and not settings:
        raise OptionError(f"--method must be NAME or NAME:KEY=VALUE,...; got {text!r}.")
    pairs = [Setting().convert(each, None, None) for each in settings.split(",") if settings]
    return Subject(name, parse_settings(name, tuple(pairs)))


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False), metavar="DIR")
def report_command(folder: Path) -> None:
    """Write report.html, report.md and the plots from the rows in DIR; no visibility is computed."""
    echo(f"report: {write_and_summarise(folder)}")


def write_and_summarise(folder: Path) -> Path:
    """Write the report, print its first table, and return its page."""
    from zbuf_occlude.studies.compare.comparison_report import write_report  # late: imports Matplotlib

    written = write_report(folder, paper_tables)
    echo(first_screen(folder))
    return written[0]


def first_screen(folder: Path) -> str:
    """Return the first table of the report as text."""
    rows = [row for row in ComparisonFolder(folder).rows().values() if row["suite"] == "meshes"]
    ranking = rank_subjects(rows)
    if not ranking:
        return "no meshes were compared; the report has the tables of the presets"
    lines = [f"{'method':44} {'wrong':>9} {'ms per view':>11}"]
    for one in representatives(ranking):
        time = ("~" if one.extrapolated else "") + format_milliseconds(one.seconds)
        lines.append(f"{one.subject:44} {format_percent(one.wrong):>9} {time:>11}")
    if n := sum(EYES_INSIDE in row.get("timed", {}).get("warnings", ()) for row in rows):
        lines.append(f"warning: cameras inside the mesh's bounding box in {counted(n, 'row')}. Raise --distance?")
    return "\n".join(lines)

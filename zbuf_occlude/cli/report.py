"""`zbuf-occlude report`: write the report of a comparison's folder again, from its rows."""

from pathlib import Path

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.cli.summary import counted
from zbuf_occlude.compare.comparison_report import write_report
from zbuf_occlude.compare.metrics import milliseconds, representatives, share, standings
from zbuf_occlude.compare.run import ComparisonFolder
from zbuf_occlude.paper.tables import paper_tables
from zbuf_occlude.visibility.interface import EYES_INSIDE


@click.command(cls=Command)
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False), metavar="DIR")
def command(folder: Path) -> None:
    """Write report.html, report.md and the plots from the rows in DIR; computes no visibility."""
    echo(f"report: {write_and_summarise(folder)}")


def write_and_summarise(folder: Path) -> Path:
    """Write the report, print its first screen, and return its page."""
    written = write_report(folder, paper_tables)
    echo(summary(folder))
    return written[0]


def summary(folder: Path) -> str:
    """Return the first screen's table as text; empty when the rows have no meshes."""
    rows = [row for row in ComparisonFolder(folder).rows().values() if row["suite"] == "meshes"]
    ranking = standings(rows)
    if not ranking:
        return "no meshes were compared; the report has the presets' tables"
    lines = [f"{'method':44} {'wrong':>9} {'ms per view':>11}"]
    for one in representatives(ranking):
        time = ("~" if one.extrapolated else "") + milliseconds(one.seconds)
        lines.append(f"{one.subject:44} {share(one.wrong):>9} {time:>11}")
    if n := sum(EYES_INSIDE in row.get("timed", {}).get("warnings", ()) for row in rows):
        lines.append(f"warning: cameras inside the mesh's bounding box in {counted(n, 'row')}. Raise --distance?")
    return "\n".join(lines)

"""`zbuf-occlude methods`: the table of methods, with their options and defaults."""

import json
from typing import Any

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.errors import UnavailableError
from zbuf_occlude.visibility import METHODS


@click.command(cls=Command)
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def command(as_json: bool) -> None:
    """List the methods of hidden-surface removal.

    An exact method equals the oracle on every point outside the boundary band (docs/conventions.md).
    """
    rows: list[dict[str, Any]] = []
    for method in METHODS:
        try:
            options = method.options()
        except UnavailableError:
            options = {}
        rows.append(
            {
                "name": method.name,
                "summary": method.summary,
                "exact": method.exact,
                "needs_gl": method.needs_gl,
                "extra": method.extra,
                "missing": method.missing(),
                "no_first_hits": method.no_first_hits,
                "options": options,
            }
        )
    if as_json:
        echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        flags = (("exact", row["exact"]), ("GL", row["needs_gl"]), ("first hits", not row["no_first_hits"]))
        tags = ", ".join(tag for tag, on in flags if on)
        echo(f"{row['name']}{f'  [{tags}]' if tags else ''}\n    {row['summary']}")
        if row["options"]:
            echo("    --set " + " ".join(f"{name}={default}" for name, default in row["options"].items()))
        if row["missing"]:
            echo(f"    cannot run here: {row['missing']}")

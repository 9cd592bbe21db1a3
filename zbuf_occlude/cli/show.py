"""`zbuf-occlude show`: look at a dataset; and the paper's Table 2 with its row."""

from pathlib import Path

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import OutFolder
from zbuf_occlude.cli.paper import derived, replaced
from zbuf_occlude.cli.summary import picture
from zbuf_occlude.dataset.folder import CONTACT_SHEET, GALLERY, read_finished
from zbuf_occlude.dataset.gallery import write_contact_sheet, write_gallery
from zbuf_occlude.dataset.source import open_dataset
from zbuf_occlude.paper.table2 import table_2


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--out", type=OutFolder(), help="Folder of the pictures.  [default: DIR]")
@click.option("--table2", is_flag=True, help="Now `zbuf-occlude paper table2 DIR`.")
def command(folder: Path, out: Path | None, table2: bool) -> None:
    """Draw the complete dataset in DIR.

    \b
    Writes into --out:
      gallery.html        classes x views, every cloud to be turned by hand; one file, needs nothing else
      contact_sheet.png   a cloud of each class, from a fixed viewpoint and from its camera's
    """
    if table2:
        replaced("show DIR --table2", "paper table2 DIR")
        print_table_2("table2", folder)
        return
    out = folder if out is None else out
    _, manifest = read_finished(folder)
    out.mkdir(parents=True, exist_ok=True)
    source = open_dataset(folder)
    write_gallery(out / GALLERY, source, manifest, folder)
    write_contact_sheet(out / CONTACT_SHEET, source)
    echo(f"gallery  {out / GALLERY}\npicture  {picture(out / CONTACT_SHEET)}")


def paper_command(name: str) -> click.Command:
    """Return the command that prints Table 2."""
    return derived(command, name, {"folder"}, print_table_2, "Print the paper's Table 2 with the row of a dataset.")


def print_table_2(name: str, folder: Path) -> None:
    """Print Table 2 as Markdown that also reads as plain text."""
    echo(table_2(folder).as_markdown(aligned=True).rstrip("\n"))

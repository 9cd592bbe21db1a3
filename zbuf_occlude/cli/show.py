"""`zbuf-occlude show`: look at a dataset; the paper's Table 2 with its row."""

from pathlib import Path

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import OutFolder
from zbuf_occlude.cli.summary import picture
from zbuf_occlude.dataset.convert import open_dataset
from zbuf_occlude.dataset.folder import CONTACT_SHEET, GALLERY, read_finished
from zbuf_occlude.dataset.gallery import write_gallery
from zbuf_occlude.dataset.sheet import write_contact_sheet
from zbuf_occlude.paper.table2 import PAPER, as_markdown, row_of


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option("--out", type=OutFolder(), help="Folder of the pictures.  [default: DIR]")
@click.option("--table2", is_flag=True, help="Print the paper's Table 2 with this dataset's row, and draw nothing.")
def command(folder: Path, out: Path | None, table2: bool) -> None:
    """Draw the complete dataset in DIR.

    \b
    Writes into --out:
      gallery.html        classes x views, every cloud to be turned by hand; one file, needs nothing else
      contact_sheet.png   a cloud of each class, from a fixed viewpoint and from its camera's
    """
    if table2:
        echo(as_markdown([*PAPER, row_of(folder)]))
        return
    out = folder if out is None else out
    _, manifest = read_finished(folder)
    out.mkdir(parents=True, exist_ok=True)
    source = open_dataset(folder)
    write_gallery(out / GALLERY, source, manifest, folder)
    write_contact_sheet(out / CONTACT_SHEET, source)
    echo(f"gallery  {out / GALLERY}\npicture  {picture(out / CONTACT_SHEET)}")

"""Table 2 of the paper, datasets for 3D object classification by samples and size, with a row for one made here."""

from pathlib import Path
from typing import NamedTuple

from zbuf_occlude.dataset.folder import CONTACT_SHEET, GALLERY, GROUPS, read_finished, sorted_out
from zbuf_occlude.drawing.pages import Table


class Row(NamedTuple):
    """One dataset; `megabytes` of 10^6 bytes."""

    name: str
    n_samples: int
    n_classes: int
    type: str
    representation: str
    megabytes: float

    @property
    def samples_per_megabyte(self) -> float:
        """The paper's last column."""
        return self.n_samples / self.megabytes


PAPER = (
    Row("McGill Benchmark", 427, 19, "Synthesized", "Mesh", 412),
    Row("Sydney Urban Objects", 631, 14, "Real-World", "Point Cloud", 9.66),
    Row("ModelNet10", 4_899, 10, "Synthesized", "Mesh", 2_170),
    Row("ModelNet40", 12_311, 40, "Synthesized", "Mesh", 9_100),
    Row("ShapeNet", 57_454, 55, "Synthesized", "Mesh", 92_900),
    Row("The paper's dataset", 200_000, 40, "Synthesized", "Point Cloud", 6_940),
)
"""The rows of the paper, as printed there; its last column is the quotient of two others."""


def row_of(folder: Path) -> Row:
    """Return the row of a complete dataset: its clouds, and the size of all files that are needed to read them.

    Raises DatasetError where there is no complete dataset in the folder.
    """
    plan, manifest = read_finished(folder)
    own, _ = sorted_out(folder, plan)
    files = [folder / name for name in own if name not in (CONTACT_SHEET, GALLERY) and not name.startswith(GROUPS)]
    megabytes = sum(path.stat().st_size for path in files) / 1e6
    n_clouds, name = manifest["counts"]["clouds"], f"This one ({plan.format})"
    return Row(name, n_clouds, len(plan.classes), "Synthesized", "Point Cloud", megabytes)


def table_2(folder: Path) -> Table:
    """Return the table with the row of a dataset; raises as `row_of`."""
    body = []
    for row in (*PAPER, row_of(folder)):
        megabytes = f"{row.megabytes:,.2f}" if row.megabytes < 100 else f"{row.megabytes:,.0f}"
        counts, share = (f"{row.n_samples:,}", f"{row.n_classes}"), f"{row.samples_per_megabyte:,.2f}"
        body.append([row.name, *counts, row.type, row.representation, megabytes, share])
    header = ["Dataset name", "#Samples", "#Classes", "Type", "Representation", "Size (MB)", "#Samples / 1 MB"]
    return Table("", header, body, texts=(0, 3, 4))

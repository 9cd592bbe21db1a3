"""Table 2 of the paper, datasets for 3D object classification by samples and size, with a row for one made here."""

from pathlib import Path
from typing import NamedTuple

from zbuf_occlude.dataset.claim import own_names
from zbuf_occlude.dataset.folder import CONTACT_SHEET, GALLERY, read_finished


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
HEADINGS = ("Dataset name", "#Samples", "#Classes", "Type", "Representation", "Size (MB)", "#Samples / 1 MB")


def row_of(folder: Path) -> Row:
    """Return the row of a complete dataset: its clouds, and the size of all files that are needed to read them.

    Raises
    ------
    DatasetError
        There is no complete dataset in the folder.
    """
    plan, manifest = read_finished(folder)
    files = [path for name in own_names(plan) - {CONTACT_SHEET, GALLERY} if (path := folder / name).exists()]
    return Row(
        f"This one ({plan.format})",
        manifest["counts"]["clouds"],
        len(plan.meshes.classes),
        "Synthesized",
        "Point Cloud",
        sum(path.stat().st_size for path in files) / 1e6,
    )


def cells(row: Row) -> list[str]:
    """Return a row as text, under `HEADINGS`."""
    megabytes = f"{row.megabytes:,.2f}" if row.megabytes < 100 else f"{row.megabytes:,.0f}"
    name, samples, classes = row.name, f"{row.n_samples:,}", str(row.n_classes)
    return [name, samples, classes, row.type, row.representation, megabytes, f"{row.samples_per_megabyte:,.2f}"]


def as_markdown(rows: list[Row]) -> str:
    """Return the table in Markdown, in columns that also line up as plain text."""
    table = [list(HEADINGS), *map(cells, rows)]
    widths = [max(len(line[column]) for line in table) for column in range(len(HEADINGS))]
    numbers = {1, 2, 5, 6}
    lines = [
        "| "
        + " | ".join(
            text.rjust(width) if column in numbers else text.ljust(width)
            for column, (text, width) in enumerate(zip(line, widths, strict=True))
        )
        + " |"
        for line in table
    ]
    rule = ["-" * (width - 1) + (":" if column in numbers else "-") for column, width in enumerate(widths)]
    return "\n".join([lines[0], "| " + " | ".join(rule) + " |", *lines[1:]])

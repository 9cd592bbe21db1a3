"""HTML and Markdown pages: tables, reports, and point clouds for the interactive viewer."""

import base64
import html
import io
import json
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base import atomic
from zbuf_occlude.base.arrays import as_vectors
from zbuf_occlude.base.errors import escape_control

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 110
NONE = "–"
"""Text of a table's cell where there is no value."""
_MARKUP = re.compile(r"[\\`*\[\]]|(?<![^\W_])_|_(?![^\W_])")
_REFERENCE = re.compile(r"&amp;(#\d+|lt|gt|amp);")


@dataclass(frozen=True)
class Table:
    """A table of texts; ```code``` and ``**bold**`` in a cell are Markdown, unless they are `verbatim`."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""  # below the table
    texts: Collection[int] = (0,)  # columns of text, aligned left; the others are numbers, aligned right

    def as_markdown(self, *, aligned: bool = False) -> str:
        """Return the table as Markdown under its title; `aligned` pads the cells so that columns line up."""
        cells = [[escape_control(cell).replace("|", "\\|") for cell in row] for row in (self.header, *self.rows)]
        widths = [max(map(len, column)) if aligned else 4 for column in zip(*cells, strict=True)]
        rule = ["-" * (width - 1) + ("-" if i in self.texts else ":") for i, width in enumerate(widths)]
        if aligned:
            cells = [
                [cell.ljust(widths[i]) if i in self.texts else cell.rjust(widths[i]) for i, cell in enumerate(row)]
                for row in cells
            ]
        lines = [f"## {self.title}", ""] if self.title else []
        lines += ["| " + " | ".join(row) + " |" for row in (cells[0], rule, *cells[1:])]
        return "\n".join(lines + (["", self.note] if self.note else [])) + "\n"


@dataclass(frozen=True)
class Picture:
    """A picture of a report, with its heading above and its caption below."""

    name: str  # of its PNG file, without the suffix
    png: bytes
    heading: str = ""
    caption: str = ""


Section = Table | Picture


def verbatim(name: str) -> str:
    """Return a text that neither Markdown nor HTML reads as markup: special characters become character references."""
    return _MARKUP.sub(lambda match: f"&#{ord(match[0])};", html.escape(escape_control(name), quote=False))


def marked_up(text: str) -> str:
    """Return a text as HTML: backticks and double asterisks become tags, all else is escaped, once only."""
    text = _REFERENCE.sub(r"&\1;", html.escape(escape_control(text)))
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", text)
    return re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", text)


def as_png(figure: "Figure") -> bytes:
    """Return a figure as the bytes of a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return buffer.getvalue()


def write_pages(
    folder: Path,
    name: str,
    title: str,
    *,
    answers: list[str],
    facts: list[str],
    sections: list[Section],
    first: Sequence[Section] = (),
    page: str = "page.html.j2",
    **more: Any,
) -> list[Path]:
    """Write a report as a self-contained HTML page and as Markdown, with its pictures as PNG files; return all paths.

    `answers` and `facts` are the first paragraphs, `facts` in small type; `first` are sections before the others. The
    template `page` (in ``zbuf_occlude/drawing/assets``) also gets `more`. Needs the package jinja2.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined  # here: pages of datasets do not need it
    from markupsafe import Markup

    def is_html(template: str | None) -> bool:
        return template is not None and template.endswith(".html.j2")

    loader = PackageLoader("zbuf_occlude.drawing", "assets")
    templates = Environment(
        loader=loader, undefined=StrictUndefined, autoescape=is_html, trim_blocks=True, lstrip_blocks=True
    )
    templates.filters |= {
        "marked_up": lambda text: Markup(marked_up(text)),
        "base64": lambda data: base64.b64encode(data).decode(),
    }
    templates.globals |= {
        "asset": lambda file: Markup(asset(file)),
        "json_for_page": lambda document: Markup(json_for_page(document)),
    }
    content = {"title": title, "answers": answers, "facts": facts, "first": list(first), "sections": sections, **more}
    contents = {}
    for template, suffix in ((page, "html"), ("page.md.j2", "md")):
        contents[folder / f"{name}.{suffix}"] = (
            templates.get_template(template).render(content).strip() + "\n"
        ).encode()
    pictures = (each for each in (*first, *sections) if isinstance(each, Picture))
    contents |= {folder / f"{picture.name}.png": picture.png for picture in pictures}
    for path, whole in contents.items():
        atomic.write(path, lambda file, whole=whole: file.write(whole), synced=False)  # type: ignore[misc]
    return list(contents)


def asset(name: str) -> str:
    """Return the text of a file of ``zbuf_occlude/drawing/assets``."""
    return (files("zbuf_occlude.drawing") / "assets" / name).read_text(encoding="utf-8")


def pack_cloud(
    positions: ArrayLike,
    *,
    centre: ArrayLike,
    longest: float,
    normals: ArrayLike | None = None,
    codes: ArrayLike | None = None,
    palette: list[tuple[int, int, int]] | None = None,
) -> dict[str, Any]:
    """Return a cloud in the format of the viewer; `json_for_page` embeds it in a page.

    Arrays are base64. Positions (n, 3) must lie within `longest`, the object's longest side, of the centre; they become
    int16 in steps of ``longest / 32767``. Unit normals (n, 3) become int8. Codes (m,) become uint8: indices of
    `palette` (r, g, b in 0..255). If m < n, only the first m points are shown.
    """
    positions = as_vectors(positions, "positions")
    shorts = np.clip(np.round((positions - np.asarray(centre)) / longest * 32767.0), -32767, 32767).astype("<i2")
    return {
        "n": len(positions),
        "positions": _base64(shorts),
        "normals": None if normals is None else _base64(np.round(np.asarray(normals) * 127.0).astype(np.int8)),
        "codes": None if codes is None else _base64(np.asarray(codes).astype(np.uint8)),
        "palette": [(61, 111, 180)] if palette is None else palette,
    }


def coloured(codes: ArrayLike, palette: Sequence[Sequence[int]]) -> dict[str, Any]:
    """Return codes (n,) and their palette in the format of the viewer, to replace those of a packed cloud."""
    return {"codes": _base64(np.asarray(codes).astype(np.uint8)), "palette": [list(colour) for colour in palette]}


def json_for_page(document: Any) -> str:
    """Return JSON that is safe inside a ``<script>`` element."""
    return json.dumps(document, separators=(",", ":")).replace("<", "\\u003c")


def _base64(array: NDArray[Any]) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()

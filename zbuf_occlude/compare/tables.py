"""Tables as data, written as HTML or Markdown; and the report's tables of subjects, meshes and failures."""

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass

from zbuf_occlude.compare.summary import (
    Row,
    Standing,
    advice,
    front,
    milliseconds,
    representatives,
    seconds_for_all_points,
    share,
    standings,
)
from zbuf_occlude.errors import printable


@dataclass(frozen=True)
class Table:
    """A table of texts; ```code``` and ``**bold**`` in a cell mean what they mean in Markdown, unless it is `verbatim`.

    Parameters
    ----------
    title : str
    header : sequence of str
    rows : sequence of sequences of str
    note : str
        Below the table.
    texts : int
        How many of the first columns are text; the others are numbers, to the right.
    last_is_text : bool
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    texts: int = 1
    last_is_text: bool = False

    def _is_text(self, column: int) -> bool:
        return column < self.texts or (self.last_is_text and column == len(self.header) - 1)

    def as_markdown(self, level: int = 2) -> str:
        """Return the table as Markdown, its title a heading of a level."""
        rule = ["---" if self._is_text(i) else "---:" for i in range(len(self.header))]
        lines = [f"{'#' * level} {self.title}", ""] if self.title else []
        lines += [
            "| " + " | ".join(printable(cell).replace("|", "\\|") for cell in row) + " |"
            for row in (self.header, rule, *self.rows)
        ]
        return "\n".join(lines + (["", self.note] if self.note else [])) + "\n"

    def as_html(self) -> str:
        """Return the table as HTML, its title a heading."""

        def line(cells: Sequence[str], tag: str) -> str:
            inner = (
                f"<{tag}{'' if self._is_text(i) else ' class=number'}>{marked_up(cell)}</{tag}>"
                for i, cell in enumerate(cells)
            )
            return f"<tr>{''.join(inner)}</tr>"

        title = f"<h2>{marked_up(self.title)}</h2>" if self.title else ""
        body = "".join(line(row, "td") for row in self.rows)
        note = f"<p class=note>{marked_up(self.note)}</p>" if self.note else ""
        head = line(self.header, "th")
        return f"{title}<div class=wide><table><thead>{head}</thead><tbody>{body}</tbody></table></div>{note}"


_MARKUP = re.compile(r"[\\`*\[\]]|(?<![^\W_])_|_(?![^\W_])")
_REFERENCE = re.compile(r"&amp;(#\d+|lt|gt|amp);")


def verbatim(name: str) -> str:
    """Return a name, or a text with names in it, so that none of it is taken for markup, in Markdown and in HTML.

    What could be is written as character references, which no dialect of Markdown takes for markup.
    """
    return _MARKUP.sub(lambda match: f"&#{ord(match[0])};", html.escape(printable(name), quote=False))


def marked_up(text: str) -> str:
    """Turn backticks and double asterisks into HTML; everything else is escaped, but for what `verbatim` wrote."""
    text = _REFERENCE.sub(r"&\1;", html.escape(printable(text)))
    text = re.sub(r"`([^`]+)`", r"<code>\1</code>", text)
    return re.sub(r"\*\*([^*]+)\*\*", r"<b>\1</b>", text)


def answer(ranking: Sequence[Standing]) -> Table:
    """Return the first screen's table: which method is how wrong, how fast, and when to use which."""
    words, best = advice(ranking), front(ranking)
    rows = [
        [
            f"**`{one.subject}`**" if one.subject in best else f"`{one.subject}`",
            share(one.wrong),
            approximately(one),
            words[one.subject],
        ]
        for one in representatives(ranking)
    ]
    return Table("", ["method", "wrong", "ms per view", "use it"], rows, last_is_text=True)


def approximately(one: Standing) -> str:
    """Write a standing's time, marked when it was scaled up from fewer points."""
    return ("≈ " if one.extrapolated else "") + milliseconds(one.seconds)


def all_subjects(ranking: Sequence[Standing]) -> Table:
    """Return the table of every subject with every measure, means over the meshes."""
    rows = [
        [
            f"`{one.subject}`",
            share(one.wrong),
            share(one.false_visible),
            share(one.false_hidden),
            share(one.band),
            "–" if one.chamfer is None else f"{one.chamfer:.2g}",
            approximately(one),
            milliseconds(one.build),
            f"{one.points_per_second / 1e6:.3g}",
            "–" if one.memory is None else f"{one.memory / 2**20:,.0f}",
            f"{one.n_meshes}",
            f"{one.pairs:,}",
        ]
        for one in ranking
    ]
    header = [
        "subject",
        "wrong",
        "false visible",
        "false hidden",
        "in the band",
        "Chamfer",
        "ms per view",
        "ms to prepare",
    ]
    return Table(
        "Every subject",
        [*header, "M points/s", "peak MiB", "meshes", "pairs"],
        rows,
        "Wrong, false visible, false hidden: shares of the judged pairs of view and point outside the boundary band, "
        "as many as the last column says (a slow method is asked from fewer of the views), "
        "mean over the meshes. Chamfer: between the method's cloud and the judge's, in longest sides. Times: geometric "
        "means; ≈ marks times scaled up linearly from fewer points. Peak: growth of the process while preparing and "
        "asking, the largest over the meshes.",
    )


def by_mesh(rows: Sequence[Row]) -> Table:
    """Return the table of error and time of each subject on each mesh."""
    ranking = standings(rows)
    cases = list(dict.fromkeys(row["case"] for row in rows))
    cell = {(row["case"], row["subject"]): row for row in rows}

    def text(row: Row | None) -> str:
        if row is None or row["status"] != "ok":
            return "–"
        wrong = 1.0 - row["judged"]["outside"]["agreement"]
        return f"{share(wrong)} · {milliseconds(seconds_for_all_points(row))} ms"

    heads = []
    for case in cases:
        faces = next((row["mesh"]["faces"] for row in rows if row["case"] == case and "mesh" in row), None)
        heads.append(f"{verbatim(case)} ({faces:,} faces)" if faces else verbatim(case))
    body = [[f"`{one.subject}`", *(text(cell.get((case, one.subject))) for case in cases)] for one in ranking]
    return Table("Mesh by mesh: wrong outside the band · time a view", ["subject", *heads], body)


def failures(rows: Sequence[Row]) -> Table | None:
    """Return the table of what failed or cannot run here, equal reasons together; None when nothing did."""
    reasons: dict[tuple[str, str, str], list[str]] = {}
    for row in rows:
        if row["status"] != "ok":
            reasons.setdefault((row["subject"], row["status"], row["reason"]), []).append(row["case"])
    if not reasons:
        return None
    body = [
        [f"`{subject}`", status, verbatim(", ".join(cases)), verbatim(reason)]
        for (subject, status, reason), cases in reasons.items()
    ]
    return Table("What did not run", ["subject", "", "on", "because"], body, texts=4)

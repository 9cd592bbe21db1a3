"""docs/figures.json, and the blocks of pages that are made of it: what was measured, by which command, when and where.

A page marks a block by two comments, and everything between them is made of the file:

    <!-- figure: NAME -->
    <!-- end of figure -->

NAME is a part's, or NAME/SECTION for one section of a report in Markdown.
"""

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from common import ROOT

FIGURES = ROOT / "docs" / "figures.json"
END = "<!-- end of figure -->"
BLOCK = re.compile(r"<!-- figure: (\S[^\n]*?) -->\n.*?" + re.escape(END), re.DOTALL)


def read() -> dict[str, dict[str, Any]]:
    """Return what was measured, by the names of the parts."""
    return json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.exists() else {}


def write(figures: Mapping[str, Mapping[str, Any]]) -> None:
    """Write it, in the order of the names."""
    text = json.dumps(dict(sorted(figures.items())), indent=1, ensure_ascii=False)
    FIGURES.write_text(text + "\n", encoding="utf-8")


def pages() -> Iterator[Path]:
    """Yield the pages that may have blocks: README and docs/."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").glob("*.md"))


def marked(text: str) -> list[str]:
    """Return the names of a page's blocks."""
    return BLOCK.findall(text)


def rendered(text: str, figures: Mapping[str, Mapping[str, Any]]) -> str:
    """Return a page with its blocks made anew; one of what was not measured yet says so."""

    def anew(match: re.Match[str]) -> str:
        name, _, section = match[1].partition("/")
        if name in figures:
            return block(match[1], figures[name], section)
        return f"<!-- figure: {match[1]} -->\n\n(not measured yet: `python benchmarks/all.py {name}`)\n\n{END}"

    return BLOCK.sub(anew, text)


def block(mark: str, figure: Mapping[str, Any], section: str) -> str:
    """Return a block with its marks: the result, or the table of a section of it, then where it comes from."""
    lines = figure["value"]
    if section:
        lines = [line for line in section_of(lines, section) if line.startswith("|")]
    if figure.get("text"):
        lines = ["```text", *lines, "```"]
    return "\n".join([f"<!-- figure: {mark} -->", "", *lines, "", origin(figure), "", END])


def origin(figure: Mapping[str, Any]) -> str:
    """Return the line that says by which command, when, where and how long it was measured."""
    remark = f"; {figure['remark']}" if figure.get("remark") else ""
    return f"(`{figure['command']}`, {figure['date']}, {figure['seconds']:,} s, {figure['machine']}{remark})"


def section_of(lines: list[str], heading: str) -> list[str]:
    """Return the lines below a heading of Markdown, up to the next, without pictures and empty ends.

    Raises
    ------
    KeyError
        There is no such heading.
    """
    starts = [at for at, line in enumerate(lines) if re.fullmatch(r"#+ " + re.escape(heading) + r".*", line)]
    if not starts:
        raise KeyError(f"no heading begins with {heading!r}")
    body = []
    for line in lines[starts[0] + 1 :]:
        if line.startswith("#"):
            break
        if not line.startswith("!["):
            body.append(line)
    return "\n".join(body).strip().split("\n")

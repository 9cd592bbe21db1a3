"""The words of the code: how docstrings begin, and names that mean one thing."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "zbuf_occlude"
FRAGMENT = re.compile(
    r"(Of|What|Whether|Which|Who|Whose|By|So|At|Its|In which|From which|With which|How|Where|When|Up to|More than"
    r"|No more|For each|As)\b"
)
"""First words of a docstring that names nothing and says nothing: a noun phrase or a verb begins it."""

REFUSED = re.compile(r"\b(coolie|master/slave|blacklist|whitelist)\b", re.IGNORECASE)
"""Words that insult somebody."""


def docstrings(path: Path) -> Iterator[tuple[int, str]]:
    """Yield the line and the text of each docstring of a file, those under constants and fields too."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            for item in node.body:
                if (
                    isinstance(item, ast.Expr)
                    and isinstance(item.value, ast.Constant)
                    and isinstance(item.value.value, str)
                ):
                    yield item.lineno, item.value.value.strip()


@pytest.mark.parametrize(
    ("text", "is_fragment"),
    [
        ("Of a rate.", True),
        ("Whether it is open.", True),
        ("Return whether it is open.", False),
        ("Number of rows.", False),
        ("Assign rows.", False),
    ],
)
def test_fragments_are_told_from_phrases(text: str, is_fragment: bool) -> None:
    assert bool(FRAGMENT.match(text)) == is_fragment


def test_docstrings_begin_with_a_noun_phrase_or_a_verb() -> None:
    fragments = [
        f"{path.relative_to(PACKAGE)}:{line}: {text[:60]}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for line, text in docstrings(path)
        if FRAGMENT.match(text)
    ]
    assert fragments == []


def test_no_word_insults() -> None:
    root = PACKAGE.parent
    texts = [path for folder in ("zbuf_occlude", "shaders", "docs") for path in (root / folder).rglob("*")]
    found = [
        f"{path.name}: {match[0]}"
        for path in [root / "README.md", *texts]
        if path.suffix in {".py", ".md", ".yaml", ".json", ".comp", ".glsl", ".html"}
        for match in REFUSED.finditer(path.read_text())
    ]
    assert found == []

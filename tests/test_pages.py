"""Pages are read twice: by GitHub, and by Python-Markdown for the site, which wants more of a list."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LOST = re.compile(r"^(?![*-] |\d+\. |[ \t]|<)[^\n]+\n(?=(?:[*-]|\d+\.) )", re.MULTILINE)
"""A line of a paragraph that a list follows at once: the site would run the two together."""
PLACE = re.compile(r"`([\w/]+\.py)(?:: ([\w.]+))?(?:\(.*?\))?`")
"""File of the package or of the tests, and a name in it."""


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_an_empty_line_is_before_each_list(page: Path) -> None:
    text = CODE.sub("", page.read_text(encoding="utf-8"))
    assert not LOST.findall(text)


def test_the_first_command_is_the_same_on_all_pages_that_begin() -> None:
    """README's is run by .ci/run, as it stands."""
    _, _, rest = (ROOT / "README.md").read_text(encoding="utf-8").partition("<!-- main command -->\n```bash\n")
    command = rest.partition("\n```")[0]
    assert command.startswith("git clone ")
    assert "\n" not in command
    for page in ("CONTRIBUTING.md", "docs/index.md", "docs/quickstart.md"):
        assert command in (ROOT / page).read_text(encoding="utf-8").splitlines(), page


@pytest.mark.parametrize("page", ["docs/paper.md", "docs/architecture.md"])
def test_files_and_names_that_a_page_mentions_are_there(page: str) -> None:
    places = PLACE.findall((ROOT / page).read_text(encoding="utf-8"))
    assert len(places) > 10
    for file, name in places:
        paths = [ROOT / folder / file for folder in ("zbuf_occlude", "tests", ".")]
        found = next((path for path in paths if path.is_file()), None) or next(
            (ROOT / "zbuf_occlude").rglob(file), None
        )
        assert found, f"{page}: {file}"
        for word in filter(None, name.split(".")):
            assert re.search(
                rf"^\s*(?:def|class) {word}\b|^{word}\b", found.read_text(encoding="utf-8"), re.MULTILINE
            ), name

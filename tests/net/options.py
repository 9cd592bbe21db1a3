"""What every command takes: `python -m tests.net.options > tests/net/options.json`."""

import io
import json
import os
import re
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple
from unittest.mock import patch

from zbuf_occlude.__main__ import main as program


class Outcome(NamedTuple):
    """What a command left."""

    returncode: int
    stdout: str
    stderr: str


def run(*arguments: object) -> Outcome:
    """Run the program to its end, as its entry point does, in this process."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    with redirect_stdout(out), redirect_stderr(err), patch.dict(os.environ):
        try:
            with patch("sys.argv", ["zbuf-occlude", *map(str, arguments)]):
                program()
        except SystemExit as leaving:
            code = int(leaving.code or 0)
    return Outcome(code, out.getvalue(), err.getvalue())


def commands() -> list[str]:
    """Return the commands that the program lists."""
    return re.findall(r"^  ([a-z]+)  ", run("--help").stdout.partition("Commands:")[2], re.MULTILINE)


def shown(page: str) -> dict[str, str | None]:
    """Return the options on a command's page of help, and what stands for their values; None for flags."""
    rows = re.findall(
        r"^  (?:-\w, )?(--[\w-]+)(?: (\S.*?))?(?:  .*)?$", page.partition("\nOptions:\n")[2], re.MULTILINE
    )
    switches = {metavar[2:]: None for _, metavar in rows if metavar.startswith("/ ")}  # --rotate / --no-rotate
    return {name: None if metavar.startswith("/ ") else metavar or None for name, metavar in rows} | switches


def choices(metavar: str | None) -> set[str]:
    """Return the words that an option may be given, where there are but a few."""
    return set(metavar[1:-1].split("|")) if metavar and re.fullmatch(r"[\[{].*\|.*[\]}]", metavar) else set()


def use(name: str, metavar: str | None) -> list[str]:
    """Return how an option is given on a command line, with some value."""
    value = min(choices(metavar), default="1")
    return [name] if metavar is None else [name, *(3 if metavar == "X Y Z" else 1) * [value]]


def argument(page: str) -> str | None:
    """Return what a command's argument may be, {one|of|these}, where that is so."""
    found = re.search(r"\{[\w|]+\}", page.partition("\n\n")[0])
    return found and found.group()


def main() -> None:
    """Print the options of all commands."""
    pages = {name: run(name, "--help").stdout for name in commands()}
    found = {name: {"argument": argument(page), **shown(page)} for name, page in pages.items()}
    print(json.dumps(found, indent=1))  # noqa: T201


if __name__ == "__main__":
    main()

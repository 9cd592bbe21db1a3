"""What every command has: help in panels, a way to print, a bar, one line of an error, a look at the shell."""

import os
import re
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any, ClassVar

import click

from zbuf_occlude.errors import OccludeError, OptionError, did_you_mean, escape_control
from zbuf_occlude.limits import address_space

SOME_FAILED = 3
"""Exit code of a run that was done but for some meshes."""


def echo(text: object, *, err: bool = False) -> None:
    """Print lines, to standard output or standard error.

    Names in them come from files and folders, and from data that others made: what would command a terminal, or is in
    no encoding, is written as in Python; ``\\n`` alone ends a line.
    """
    COMPILING.close()
    click.echo("\n".join(map(escape_control, str(text).split("\n"))), err=err)


def on(renderer: str) -> str:
    """Say which renderer drew; nothing of a method that renders nothing."""
    return "" if renderer == "none" else f" on {renderer}"


def one_line(error: click.ClickException) -> str:
    """Return what click says of a command line, and where its help is."""
    context = error.ctx if isinstance(error, click.UsageError) else None
    said = " ".join(error.format_message().split())
    return f"{said} Help: {context.command_path} --help" if context is not None else said


class Compiling:
    """A line that says how many functions are compiled, while some are; `total` of them are expected, if that is known.

    It goes when anything else is said.
    """

    def __init__(self) -> None:
        self.total: int | None = None
        self._bar: Any = None

    def one_more(self) -> None:
        """Count a function."""
        if self._bar is None:
            from tqdm import tqdm  # late: help needs none

            looks = {"unit": " functions", "desc": "compile", "leave": False, "miniters": 1}
            self._bar = tqdm(total=self.total, disable=None, **looks)  # nothing in logs, which do not move
        self._bar.update()

    def close(self) -> None:
        """Remove the line."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


COMPILING = Compiling()


def progress_bar(total: float, unit: str, what: str, **more: Any) -> Any:
    """Return a tqdm bar, shown with the first progress: after all that may refuse; in a file seldom drawn again."""
    from tqdm import tqdm  # late: help needs none

    COMPILING.close()

    class Bar(tqdm):  # type: ignore[misc]  # it has no types
        def update(self, n: float | None = 1) -> bool | None:
            drawn = super().update(n)
            if drawn:
                self.mininterval = ON_SCREEN if sys.stderr.isatty() else IN_A_FILE
            return drawn

    return Bar(
        total=total,
        unit=f" {unit}",
        desc=what,
        **{"smoothing": 0.05, "delay": 1e-3, "mininterval": 0, "miniters": 0, **more},
    )


ON_SCREEN, IN_A_FILE = 0.1, 5.0
"""Seconds until a bar is drawn again."""
LEAST_MEMORY = 768 * 2**20
"""Bytes of address space: with 500 MB compiling ends in an abort of LLVM's, with 800 MB a small dataset is made."""


def check_surroundings() -> None:
    """Raise OptionError or OccludeError where numba could not be imported, or the current folder is gone."""
    try:
        Path.cwd()
    except FileNotFoundError:
        raise OccludeError("the current folder must be there; it has been removed. Change to another: cd.") from None
    threads = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if threads.lstrip("+-").isdecimal() and int(threads) < 1:
        raise OptionError(f"NUMBA_NUM_THREADS must be 1 or more; it is {threads}. Unset it, or give a number.")
    allowed = address_space()
    if allowed is not None and allowed < LEAST_MEMORY:
        raise OccludeError(
            f"a process must be allowed {LEAST_MEMORY // 1024:,} kB of address space; this one is allowed "
            f"{allowed // 1024:,} kB. Raise the limit, as ulimit -v {LEAST_MEMORY // 1024} does."
        )


def counted(n: int, one: str, many: str = "") -> str:
    """Return a number of things in words: ``1 mesh``, ``2 meshes``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


LONG = 10
"""A command of fewer options has them in one list."""
WIDTH = 118

PANELS = {
    "Input": "shapes preset up unit labels classes splits limit modelnet scans scans_up real voxels mesh_file sydney",
    "Views": "views distance azimuth elevation roll look_at fov cameras index union coverage most_views",
    "Sampling": "refine tolerance slack method methods presets settings points density variations sample_size subset "
    "overlap seed attributes seconds row_seconds judge_points",
    "Sensor": "sensor set_sensor range_ size scene hidden keep keep_clean sensor_height transparent velocity turn "
    "trajectory deskew eye up_axis poses depth_unit",
    "Training": "model epochs patience batch_size learning_rate n_points rotate rescale jitter budgets models seeds "
    "objects quick",
    "Output": "out format resolution scale frame picture overwrite",
    "Execution": "workers engine ray_address ray_gpus mesh_seconds mesh_gigabytes shard require_gpu dry_run device "
    "mixed_precision help",
}
"""Panel to the parameters in it, in the order of the command; what is in none comes last."""


class Command(click.Command):
    """A command whose options come in panels, where they are many."""

    def __init__(self, name: str | None, *, context_settings: dict[str, Any] | None = None, **options: Any) -> None:
        columns = min(WIDTH, shutil.get_terminal_size((WIDTH, 24)).columns)
        settings = {"terminal_width": columns, **(context_settings or {})}
        super().__init__(name, context_settings=settings, **options)

    def format_options(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, panel by panel."""
        rows: dict[str, list[tuple[str, str]]] = {panel: [] for panel in (*PANELS, "")}
        for parameter in self.get_params(context):
            record = parameter.get_help_record(context) if isinstance(parameter, click.Option) else None
            if record:
                panel = next((name for name, names in PANELS.items() if parameter.name in names.split()), "Execution")
                rows[panel].append(_plain(*record))
        with formatter.section("Options"):
            if sum(map(len, rows.values())) < LONG:
                formatter.write_dl([row for of_panel in rows.values() for row in of_panel])
                return
            for panel, of_panel in rows.items():
                if of_panel:
                    with formatter.section(panel):
                        formatter.write_dl(of_panel)


def _plain(names: str, text: str) -> tuple[str, str]:
    """Return an option's row without the names of Python's types and ranges."""
    for kind, letter in (("INTEGER RANGE", "N"), ("FLOAT RANGE", "X"), ("INTEGER", "N"), ("FLOAT", "X")):
        names = names.replace(kind, letter)
    text = re.sub(r"(?:; |\[)[-\d.]*<?=?x[<>]=?[-\d.]+(?=\])", lambda found: "[" * found[0].startswith("["), text)
    return names, text.replace("  []", "").replace("[]", "")


class CommandGroup(click.Group):
    """A group of the commands of a table, imported when they are called; it names the nearest to a mistyped one."""

    table: ClassVar[Mapping[str, str]]
    """Name and one line of each command."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Read the arguments; without any, show the help (as an error it would be one long line)."""
        return super().parse_args(context, args or ["--help"])

    def list_commands(self, context: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(self.table)

    def format_commands(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from the table."""
        with formatter.section("Commands"):
            formatter.write_dl(list(self.table.items()))

    def resolve_command(
        self, context: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command that was called."""
        if not args[0].startswith("-") and self.get_command(context, args[0]) is None:
            context.fail(f"No such command {args[0]!r}.{did_you_mean(args[0], self.table)}")
        return super().resolve_command(context, args)


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def all_of(*options: Decorator) -> Decorator:
    """Return a decorator that gives a command several options, which its help lists in this order."""
    return lambda function: reduce(lambda decorated, option: option(decorated), reversed(options), function)


class Name(click.Choice):  # type: ignore[type-arg]  # takes no parameter before click 8.2
    """A name of a table."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(list(names))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name."""
        if value not in self.choices:
            meant = did_you_mean(value, self.choices)
            self.fail(f"it must be one of {', '.join(self.choices)}; got {value!r}.{meant}", param, ctx)
        return super().convert(value, param, ctx)

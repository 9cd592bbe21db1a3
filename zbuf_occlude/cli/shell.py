"""Base of all commands: help in panels, printing, progress bars, one-line errors, checks of the environment."""

import os
import re
import shutil
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from pathlib import Path
from typing import Any, ClassVar

import click

from zbuf_occlude.base.errors import OccludeError, OptionError, did_you_mean, escape_control
from zbuf_occlude.base.limits import address_space

SOME_FAILED, UNFINISHED = 3, 4
"""Exit codes of a run in which some meshes failed, and of one whose time was up; the same command continues it."""


def echo(text: object, *, err: bool = False) -> None:
    """Print lines to standard output or standard error.

    Control characters and undecodable bytes are escaped as in Python: names of files and data of others may contain
    them. Only ``\\n`` ends a line.
    """
    COMPILING.close()
    click.echo("\n".join(map(escape_control, str(text).split("\n"))), err=err)


def on_renderer(renderer: str) -> str:
    """Return the text " on RENDERER", or "" for a method that does not render."""
    return "" if renderer == "none" else f" on {renderer}"


def one_line(error: click.ClickException) -> str:
    """Return click's message on a command line in one line, with a hint to the help."""
    context = error.ctx if isinstance(error, click.UsageError) else None
    said = " ".join(error.format_message().split())
    return f"{said} Help: {context.command_path} --help" if context is not None else said


class Compiling:
    """Progress bar of functions being compiled; `total` is their expected number, if known.

    The bar is removed before anything else is printed.
    """

    def __init__(self) -> None:
        self.total: int | None = None
        self._bar: Any = None

    def one_more(self) -> None:
        """Count one compiled function."""
        if self._bar is None:
            from tqdm import tqdm  # late: help needs no bar

            looks = {"unit": " functions", "desc": "compile", "leave": False, "miniters": 1}
            self._bar = tqdm(total=self.total, disable=None, **looks)  # no bar in log files
        self._bar.update()

    def close(self) -> None:
        """Remove the bar."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None


COMPILING = Compiling()


def progress_bar(total: float, unit: str, what: str, **more: Any) -> Any:
    """Return a tqdm bar that is shown with the first progress, and seldom redrawn in a log file."""
    from tqdm import tqdm  # late: help needs no bar

    COMPILING.close()

    class Bar(tqdm):  # type: ignore[misc]  # tqdm has no types
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
"""Seconds between two updates of a bar."""
MIN_MEMORY = 768 * 2**20
"""Minimum address space in bytes: LLVM aborts with 500 MB; a small dataset is made with 800 MB."""


def check_surroundings() -> None:
    """Raise OptionError or OccludeError where numba cannot be imported or the current folder no longer exists."""
    try:
        Path.cwd()
    except FileNotFoundError:
        raise OccludeError("The current folder no longer exists. Change to another one.") from None
    threads = os.environ.get("NUMBA_NUM_THREADS", "").strip()
    if threads.lstrip("+-").isdecimal() and int(threads) < 1:
        raise OptionError(f"NUMBA_NUM_THREADS must be 1 or more; it is {threads}. Unset it, or give a number.")
    allowed = address_space()
    if allowed is not None and allowed < MIN_MEMORY:
        raise OccludeError(
            f"the limit of address space must be at least {MIN_MEMORY // 1024:,} kB; it is "
            f"{allowed // 1024:,} kB. Raise it: ulimit -v {MIN_MEMORY // 1024}."
        )


def counted(n: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 mesh``, ``2 meshes``."""
    return f"{n} {one if n == 1 else many or one + 's'}"


LONG = 10
"""Minimum number of options for panels; fewer are shown in one list."""
WIDTH = 118

PANELS = {
    "Input": "config shapes preset up unit labels classes splits split limit modelnet scans scans_up real voxels "
    "mesh_file sydney",
    "Views": "views distance azimuth elevation roll look_at fov cameras index union coverage order most_views",
    "Sampling": "refine tolerance slack method methods presets settings points density variations sample_size complete "
    "subset overlap seed attributes seconds row_seconds reference_points",
    "Sensor": "sensor set_sensor camera range_ size scene hidden keep keep_clean sensor_height transparent "
    "least_points rig velocity turn trajectory deskew sweeps eye target up_axis poses depth_unit min_density",
    "Training": "model epochs patience batch_size learning_rate n_points rotate rescale jitter budgets models seeds "
    "objects quick",
    "Output": "out format layout sequence resolution scale frame axes picture overwrite",
    "Execution": "workers engine ray_address ray_gpus mesh_seconds mesh_gigabytes shard require_gpu retry_failed "
    "dry_run device mixed_precision host port opens help",
}
"""Parameters of each panel of the help; parameters in none go to the last panel."""


class Command(click.Command):
    """Command whose help shows many options in panels."""

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
    """Return an option's row of help without names of types and ranges."""
    for kind, letter in (("INTEGER RANGE", "N"), ("FLOAT RANGE", "X"), ("INTEGER", "N"), ("FLOAT", "X")):
        names = names.replace(kind, letter)
    text = re.sub(r"(?:; |\[)[-\d.]*<?=?x[<>]=?[-\d.]+(?=\])", lambda found: "[" * found[0].startswith("["), text)
    return names, text.replace("  []", "").replace("[]", "")


class CommandGroup(click.Group):
    """Group of commands of a table, imported when called; it suggests the nearest name for a mistyped one."""

    table: ClassVar[Mapping[str, str]]
    """Summary of each command by its name."""

    def parse_args(self, context: click.Context, args: list[str]) -> list[str]:
        """Parse the arguments; without any, show the help."""
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
    """Return a decorator that adds several options to a command, in the order of its help."""
    return lambda function: reduce(lambda decorated, option: option(decorated), reversed(options), function)


class Name(click.Choice):  # type: ignore[type-arg]  # takes no parameter before click 8.2
    """Choice among the names of a table."""

    def __init__(self, names: Sequence[str]) -> None:
        super().__init__(list(names))

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the name."""
        if value not in self.choices:
            meant = did_you_mean(value, self.choices)
            self.fail(f"it must be one of {', '.join(self.choices)}; got {value!r}.{meant}", param, ctx)
        return super().convert(value, param, ctx)

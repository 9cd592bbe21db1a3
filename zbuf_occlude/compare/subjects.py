"""What is compared: a method with options, and the sweep that stands for each method when nobody chose."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from zbuf_occlude.visibility import METHODS, find_method

SWEEP: dict[str, tuple[dict[str, Any], ...]] = {
    "depth_buffer": (
        {"resolution": 256, "refine": "none"},
        {"resolution": 512, "refine": "none"},
        {"resolution": 1024, "refine": "none"},
        {"resolution": 256},
        {"resolution": 512},
        {"resolution": 1024},
    ),
    "pyrender": ({"resolution": 512}, {"resolution": 1024}),
    "vertex_hsr_culled": ({"suggestion": 1}, {"suggestion": 2}),
    "exact_hsr": ({}, {"cull": "second"}),
    "occupancy_grid": ({"n": 16}, {"n": 32}, {"n": 64}, {"n": 128}),
}
"""Options that are tried by default; a method that is not here is tried with its own defaults."""


@dataclass(frozen=True, eq=False)
class Subject:
    """A method and its options.

    Parameters
    ----------
    method : str
        A name of the table of methods.
    options : mapping

    Raises
    ------
    OptionError
        No such method, or not one of its options.
    UnavailableError
        Options were given, and a package that the method needs is missing.
    """

    method: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        row = find_method(self.method)
        if self.options:
            row.check_options(dict(self.options))

    @property
    def label(self) -> str:
        """``name:key=value,...``, as it is typed at the command line."""
        options = ",".join(f"{key}={value}" for key, value in self.options.items())
        return f"{self.method}:{options}" if options else self.method


def default_subjects() -> list[Subject]:
    """Return every method of the table, those of `SWEEP` once for each of their settings.

    Methods that cannot run here are among them, without options: their rows say why.
    """
    subjects = []
    for method in METHODS:
        settings: Iterable[dict[str, Any]] = ({},) if method.missing() else SWEEP.get(method.name, ({},))
        subjects += [Subject(method.name, options) for options in settings]
    return subjects

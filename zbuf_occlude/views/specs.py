"""What a person types for views: a table of specifications, each a pattern and a function.

To add one: a row in `SPECIFICATIONS`, with its function in `positions.py` or `files.py`.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.checks import did_you_mean
from zbuf_occlude.errors import OptionError
from zbuf_occlude.geometry.mesh import MeshLike, as_mesh
from zbuf_occlude.views import files, positions
from zbuf_occlude.views.model import Views
from zbuf_occlude.views.positions import PAPER_DISTANCE, Seed

_NUMBER = r"([-+]?\d+(?:\.\d*)?)"
_RANGE = rf"(?:@{_NUMBER}\.\.{_NUMBER})?"
_COUNT = r"(\d{1,9})"
"""More digits than any number of views has."""

Make = Callable[[Sequence[Any], float, Seed], Views]


@dataclass(frozen=True)
class Specification:
    """One row of the table of view specifications.

    Parameters
    ----------
    form : str
        As it is shown to people.
    pattern : str
        Regular expression of the whole specification.
    make : callable
        Returns the views from what the pattern's groups found, a distance in longest sides, and a seed.
    drawn : bool
        Whether views are drawn at random: a dataset draws them for each object anew.
    """

    form: str
    pattern: str
    make: Make
    drawn: bool = False


SPECIFICATIONS: tuple[Specification, ...] = (
    Specification("paper100", "paper100", lambda found, distance, seed: positions.paper100(distance)),
    Specification("modelnet8", "modelnet8", lambda found, distance, seed: positions.modelnet8(distance)),
    Specification(
        "ring:N@EL",
        rf"ring:{_COUNT}@{_NUMBER}",
        lambda found, distance, seed: positions.ring(int(found[0]), _band(found[1], found[1])[0], distance),
    ),
    Specification(
        "grid:ELxAZ[@EL0..EL1]",
        rf"grid:{_COUNT}x{_COUNT}{_RANGE}",
        lambda found, distance, seed: positions.grid(int(found[0]), int(found[1]), _band(*found[2:]), distance),
    ),
    Specification(
        "fibonacci:N",
        rf"fibonacci:{_COUNT}",
        lambda found, distance, seed: positions.fibonacci(int(found[0]), distance),
    ),
    Specification(
        "random:N[@EL0..EL1]",
        rf"random:{_COUNT}{_RANGE}",
        lambda found, distance, seed: positions.random(int(found[0]), _band(*found[1:]), distance, seed),
        drawn=True,
    ),
    Specification(
        "random-so3:N",
        rf"random-so3:{_COUNT}",
        lambda found, distance, seed: positions.random_so3(int(found[0]), distance, seed),
        drawn=True,
    ),
    Specification(
        "a CSV of views or cameras",
        r"(.+\.(?i:csv))",
        lambda found, distance, seed: files.from_csv(found[0], distance),
    ),
    Specification(
        "cameras as JSON (K, R, t, or transforms.json)",
        r"(.+\.(?i:jsonl?))",
        lambda found, distance, seed: files.from_json(Path(found[0])),
    ),
    Specification(
        "COLMAP's images.txt or images.bin",
        r"(.*images\.(?:txt|bin))",
        lambda found, distance, seed: files.from_colmap(Path(found[0])),
    ),
)


def forms() -> str:
    """Return what may be typed, in words.

    Examples
    --------
    >>> zo.views.forms().startswith("paper100, modelnet8, ring:N@EL")
    True
    """
    *most, last = (row.form for row in SPECIFICATIONS)
    return f"{', '.join(most)}, or {last}"


def parse(spec: str, *, distance: float = PAPER_DISTANCE, seed: Seed = 0, farthest: float | None = None) -> Views:
    """Make views from what a person types: angles in degrees, distances in longest sides.

    Parameters
    ----------
    spec : str
        One of `forms`.
    distance : float
        For all but files that say it themselves.
    seed : int or SeedSequence
        For what is drawn at random.
    farthest : float, optional
        Distances are drawn uniformly between `distance` and this one, for all but files that say them.

    Raises
    ------
    OptionError
        Not understood; the message says what there is.

    Examples
    --------
    >>> zo.views.parse("grid:3x4@0..50")
    Views(12 views about (0, 0, 0))
    """
    row, found = _find(spec)
    views = row.make(found, distance, seed)
    if farthest is None or views.rotations is not None:
        return views
    if not farthest > distance:
        raise OptionError(f"distances must run upwards; got {distance:g}..{farthest:g}.")
    root = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    lengths = np.random.default_rng(root.spawn(1)[0]).uniform(distance, farthest, len(views))
    own = views.distance == row.make(found, farthest, seed).distance  # of a table with a column of distances
    lengths = np.where(own, views.distance, lengths)
    return Views(views.azimuth, views.elevation, lengths, views.target, views.roll)


def for_mesh(
    mesh: MeshLike,
    spec: str | Views,
    *,
    distance: float = PAPER_DISTANCE,
    seed: Seed = 0,
    farthest: float | None = None,
) -> Views:
    """Return views about a mesh, in its own units: what `parse` makes, around its centre.

    Parameters
    ----------
    mesh : Mesh
        Or anything else that is one (`as_mesh`).
    spec : str or Views
        As `parse` takes it; or views about the origin, distances in longest sides.
    distance, seed, farthest
        As in `parse`; distances in multiples of the mesh's longest side.

    Raises
    ------
    OptionError
        As `parse`.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> views = zo.views.for_mesh(mesh, "ring:8@20")
    >>> len(views), bool(mesh.in_box(views.eyes).any())
    (8, False)
    """
    mesh = as_mesh(mesh)
    views = spec if isinstance(spec, Views) else parse(spec, distance=distance, seed=seed, farthest=farthest)
    return views.around(mesh.centre, mesh.longest_side)


def is_drawn(spec: str) -> bool:
    """Return whether views are drawn at random.

    Examples
    --------
    >>> zo.views.is_drawn("random:5"), zo.views.is_drawn("paper100")
    (True, False)
    """
    return _find(spec)[0].drawn


def _find(spec: str) -> tuple[Specification, Sequence[Any]]:
    for row in SPECIFICATIONS if isinstance(spec, str) else ():
        if match := re.fullmatch(row.pattern, spec):
            return row, match.groups()
    raise OptionError(f"views must be {forms()}; got {spec!r:.80}.{_wrong_part(str(spec))}")


def _wrong_part(spec: str) -> str:
    """Return a sentence that says what of a specification is not understood."""
    word, _, rest = spec.partition(":")
    if re.search(r"[/.\\]|^$", word):
        return ""
    by_word = {row.form.partition(":")[0]: row.form for row in SPECIFICATIONS if " " not in row.form}
    if word not in by_word:
        return f" There is no {word!r:.40}.{did_you_mean(word, by_word)}"
    _, colon, form = by_word[word].partition(":")
    return f" After {word}: must come {form}; got {rest!r:.40}." if colon else f" {word} takes nothing after it."


def _band(low: str | None = None, high: str | None = None) -> tuple[float, float]:
    low_degrees, high_degrees = float(low or -90.0), float(high or 90.0)
    if not -90.0 <= low_degrees <= high_degrees <= 90.0:
        raise OptionError(f"elevations must run upwards within -90..90; got {low_degrees:g}..{high_degrees:g}.")
    return np.radians(low_degrees), np.radians(high_degrees)

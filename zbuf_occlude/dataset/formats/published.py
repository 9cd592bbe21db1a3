"""What the layouts of published benchmarks share: names of classes and objects, whole objects, and what they lack.

Such a layout holds points and little else. What a record holds besides them (view, pose, face ids, ...) goes into
further files, a row per cloud in the order of writing: ``clouds_SPLIT.npy`` of a layout whose files hold a split whole,
``clouds_SPLIT0.npy`` and so on, one per part, of others. Published loaders do not look at them; with them a dataset in
such a layout is read back, verified and shown like any other.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.clouds import record_type
from zbuf_occlude.dataset.damage import reading
from zbuf_occlude.dataset.folder import list_of
from zbuf_occlude.dataset.formats import find_format
from zbuf_occlude.dataset.plan import Plan, Recipe
from zbuf_occlude.dataset.shared import Rows, contiguous
from zbuf_occlude.dataset.source import Content, Numbers, Source, check_indices
from zbuf_occlude.errors import DatasetError, OptionError
from zbuf_occlude.meshes.files import SUFFIXES

Records = NDArray[Any]
_REST = re.compile(r"clouds_[a-z]+\d*\.npy")
SYNSETS = "shapenet_synset_dict.json"
"""As PoinTr calls it, which reads its own from ./data when it reports."""


class Names(NamedTuple):
    """What objects are called in a published layout, by mesh index.

    Parameters
    ----------
    classes : list of str
    taxonomies : list of str
        ShapeNet's synset where the key begins with one, else the class's name.
    objects : list of str
        The last part of the key without its ending; unique within its taxonomy.

    Notes
    -----
    Only letters, digits and underscores: loaders split at "-" and ".".
    """

    classes: list[str]
    taxonomies: list[str]
    objects: list[str]


@lru_cache(maxsize=2)
def names_of(plan: Plan) -> Names:
    """Return what the meshes of a plan are called; the same plan gives the same names."""
    taxonomies, objects = [], []
    free = _Free()
    words = {label: free("", label) for label in plan.meshes.classes}
    for entry in plan.meshes:
        path = PurePosixPath(entry.key)
        synset = path.parts[0]
        taxonomy = synset if re.fullmatch(r"\d{8}", synset) and len(path.parts) > 1 else words[entry.label]
        stem = path.stem if path.suffix.lower() in SUFFIXES else path.name
        taxonomies.append(taxonomy)
        objects.append(free(taxonomy, stem))
    return Names([words[entry.label] for entry in plan.meshes], taxonomies, objects)


def check_pairs(plan: Plan, name: str, *, n_complete: int, n_views: int | None = None, size: int | None = None) -> None:
    """Raise OptionError unless a plan makes pairs of partial and complete clouds as a layout's loaders expect them.

    Parameters
    ----------
    plan : Plan
    name : str
        Of the layout.
    n_complete : int
        Points of a complete cloud: as many must be sampled on each object.
    n_views, size : int, optional
        Views per object, and points of a partial cloud, where loaders have a number in their code.
    """
    recipe = plan.recipe
    for what, option, found, wanted in (
        ("views per object", "--views", len(plan.views), n_views),
        ("variation", "--variations", recipe.variations, 1),
        ("points per partial cloud", "--sample-size", recipe.sample_size, size),
    ):
        if wanted is not None and found != wanted:
            raise OptionError(
                f"{name} must have {wanted:,} {what}, for its loaders count on it; got {found:,}. See {option}."
            )
    if recipe.n_points is None or recipe.n_points < n_complete:
        sampled = "a density" if recipe.n_points is None else f"{recipe.n_points:,}"
        raise OptionError(
            f"{name} must have {n_complete:,} points in each complete cloud; got {sampled}. Give --points {n_complete}."
        )
    if recipe.scale == "cloud" or recipe.frame == "camera":
        raise OptionError(
            f"{name} must have partial and complete clouds in one frame; got --scale {recipe.scale} --frame "
            f"{recipe.frame}. Give --scale object --frame object."
        )


def to_theirs(points: NDArray[Any], recipe: Recipe, name: str) -> NDArray[np.float32]:
    """Return points (..., 3) of a recipe's frame in that of the layout of this name."""
    return contiguous(points @ find_format(name).to_frame(recipe).T, "<f4")


def from_theirs(points: NDArray[Any], recipe: Recipe, name: str) -> NDArray[np.float32]:
    """Return points (..., 3) of a layout's frame in that of a recipe: the very numbers that were written."""
    return contiguous(points @ np.linalg.inv(find_format(name).to_frame(recipe)).T, "<f4")


def record_as_theirs(record: Any, plan: Plan, name: str) -> Any:
    """Return a record, positions and normals in the frame of the layout of this name."""
    turned = record.copy()
    for field in {"data", "normal"} & {*record.dtype.names}:
        turned[field] = to_theirs(record[field], plan.recipe, name)
    return turned


def check_version(plan: Plan, since: int) -> None:
    """Raise DatasetError for a dataset of a data version whose files had other names, labels or axes."""
    if (found := plan.document["data_version"]) < since:
        raise DatasetError(
            f"a {plan.format} dataset must be of data version {since} or later; this is of {found}, which named and "
            "numbered its files otherwise. Generate it again."
        )


def by_object(records: Records) -> list[Records]:
    """Return the clouds of each object together."""
    return np.split(records, np.flatnonzero(np.diff(records["mesh_id"])) + 1)


def rest_name(split: str, number: int | None = None) -> str:
    """Return the name of the file of what a published layout lacks: of a whole split, or of this part of it."""
    return f"clouds_{split}{'' if number is None else number}.npy"


def rest_names(plan: Plan) -> Iterator[str]:
    """Yield these names, of a layout of whole objects that has one per part; before data version 6 it had one."""
    for split in plan.splits:
        yield rest_name(split)
        yield from (rest_name(split, part) for part in range(-(-len(plan.shards) // plan.shards_per_part)))


def write_rest(out: Path, content: Content) -> str:
    """Write what the records of a part hold besides their points; return the file's name."""
    name = rest_name(content.split, content.number)
    rest = without_points(content.records, content.plan.recipe)
    atomic.write(out / name, lambda file: np.save(file, rest))
    return name


def rows_of_rest(content: Content) -> Rows:
    """Return what the records of a part hold besides their points, as rows of the split's file of it."""
    return Rows(content.first, content.total, without_points(content.records, content.plan.recipe))


def mesh_ids_of(out: Path, names: list[str]) -> list[int]:
    """Return the objects whose clouds were written, in order, from the names of a split's files."""
    rests = [np.load(out / name, mmap_mode="r")["mesh_id"] for name in names if _REST.fullmatch(name)]
    return list(dict.fromkeys(np.concatenate(rests).tolist())) if rests else []


def read_published(
    out: Path, plan: Plan, files: dict[str, list[str]], points: Callable[[str, Records, Numbers], NDArray[Any]]
) -> Source:
    """Return the clouds of a published layout.

    Parameters
    ----------
    out : Path
    plan : Plan
    files : dict of split to file names
    points : callable
        Returns the points (m, size, 3) of some clouds of a split, from their records without points and their rows in
        the first of these files that the split has.
    """
    rests: list[tuple[str, Records]] = []
    order, begin = {}, 0
    for split, names in files.items():
        for name in names:
            if _REST.fullmatch(name):
                rests.append((split, _read_rest(out / name, plan)))
        order[split] = np.arange(begin, begin := sum(len(rest) for _, rest in rests))
    ends = np.cumsum([len(rest) for _, rest in rests])

    def take(numbers: Numbers) -> Records:
        records = np.empty(len(numbers), record_type(plan.recipe))
        owners = np.searchsorted(ends, numbers, side="right")
        for owner in np.unique(owners):
            mine = np.flatnonzero(owners == owner)
            rows = numbers[mine] - (ends[owner - 1] if owner else 0)
            split, whole = rests[owner]
            rest = whole[rows]
            some: Records = np.empty(len(mine), records.dtype)
            for name in rest.dtype.names or ():
                some[name] = rest[name]
            some["data"] = points(split, rest, rows)
            records[mine] = some
        return records

    return Source(plan, order, take)


def _read_rest(path: Path, plan: Plan) -> Records:
    with reading(path):
        rest: Records = np.load(path, mmap_mode="r")
        if rest.dtype != _rest_type(plan.recipe):
            raise ValueError(f"records of {rest.dtype}")
        check_indices(rest["label"], rest["mesh_id"], plan)
        return rest


def read_cloud_files(
    out: Path,
    plan: Plan,
    files: dict[str, list[str]],
    load: Callable[[Path], NDArray[Any]],
    name_of: Callable[[str, Names, Any], str],
) -> Source:
    """Return the clouds of a published layout that has a file for each, named by `name_of` its split and record."""
    names = names_of(plan)

    def points(split: str, rest: Records, rows: Numbers) -> NDArray[Any]:
        return read_each((out / name_of(split, names, record) for record in rest), load, plan)

    return read_published(out, plan, files, points)


def without_points(records: Records, recipe: Recipe) -> Records:
    """Return what records hold besides their points."""
    rest: Records = np.empty(len(records), _rest_type(recipe))
    for name in rest.dtype.names or ():
        rest[name] = records[name]
    return rest


def read_each(paths: Iterable[Path], load: Callable[[Path], NDArray[Any]], plan: Plan) -> NDArray[Any]:
    """Read clouds that have a file each, (m, size, 3).

    Raises
    ------
    DatasetError
        A file is missing, cannot be read, or holds another number of points.
    """
    shape = (plan.recipe.equal_size, 3)
    clouds = []
    for path in paths:
        with reading(path):
            clouds.append(load(path))
            if clouds[-1].shape != shape:
                raise ValueError(f"points {clouds[-1].shape}, where there are {shape}")
    return np.array(clouds, np.float32).reshape(-1, *shape)


def read_rows(path: Path, name: str, rows: Numbers) -> NDArray[Any]:
    """Read rows of a dataset of an HDF5 file, in the order asked for."""
    ascending, back = np.unique(rows, return_inverse=True)  # as h5py wants them
    with reading(path), h5py.File(path) as h5:
        return np.asarray(h5[name][ascending][back])


def listed(out: Path, names: dict[str, list[str]], *more: str) -> dict[str, list[str]]:
    """Write for each split the list of its clouds' files, in which checksums find them; return what `read` needs."""
    files = {}
    for split, of_split in names.items():
        rests = [name for name in of_split if _REST.fullmatch(name)]
        atomic.write_lines(out / list_of(split), [name for name in of_split if not _REST.fullmatch(name)])
        files[split] = [*rests, list_of(split), *more]
    return files


def write_synsets(out: Path, plan: Plan) -> str:
    """Write what each taxonomy is called; PoinTr's report of a test ends at one that its own list lacks."""
    names = names_of(plan)
    called = {taxonomy: entry.label for taxonomy, entry in zip(names.taxonomies, plan.meshes, strict=True)}
    atomic.write_json(out / SYNSETS, called)
    return SYNSETS


def _rest_type(recipe: Recipe) -> np.dtype[Any]:
    whole = record_type(recipe)
    return np.dtype([(name, whole[name]) for name in whole.names or () if name != "data"])


class _Free:
    """Turns names into words that differ from all given out before in the same place."""

    def __init__(self) -> None:
        self._taken: set[tuple[str, str]] = set()
        self._last: dict[tuple[str, str], int] = {}

    def __call__(self, place: str, name: str) -> str:
        word = free = re.sub(r"\W", "_", name, flags=re.ASCII) or "_"
        while (place, free) in self._taken:
            number = self._last[place, word] = self._last.get((place, word), 1) + 1
            free = f"{word}_{number}"
        self._taken.add((place, free))
        return free

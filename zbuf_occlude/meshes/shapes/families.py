"""The table of the eight families, and the style, split, key and mesh of each member."""

import zlib
from collections.abc import Callable
from functools import partial
from types import MappingProxyType

import numpy as np

from zbuf_occlude.base.arrays import FloatArray, IntArray
from zbuf_occlude.base.errors import OptionError, check_choice, check_int
from zbuf_occlude.base.provenance import MeshSource
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.meshes.shapes import airplane, bed, bookshelf, bottle, car, chair, lamp, table
from zbuf_occlude.meshes.shapes.draw import Draw
from zbuf_occlude.meshes.shapes.kit import MeshPart, quartered

Style = Callable[[Draw], MeshPart]

STYLES: MappingProxyType[str, tuple[Style, ...]] = MappingProxyType(
    {
        "airplane": airplane.STYLES,
        "bed": bed.STYLES,
        "bookshelf": bookshelf.STYLES,
        "bottle": bottle.STYLES,
        "car": car.STYLES,
        "chair": chair.STYLES,
        "lamp": lamp.STYLES,
        "table": table.STYLES,
    }
)
"""Functions that model one member, by class; a function listed twice is twice as common."""

VERSION = 1
"""Version of the shapes, raised with every change: an unfinished dataset of old shapes is then not resumed."""

CLASSES = tuple(STYLES)
"""The paper's ModelNet8 (section 4.3), in alphabetical order."""

MIN_FACES = 200
"""Minimum number of faces of a member."""

TRAIN, VAL, TEST = 40, 10, 25
MEMBERS = TRAIN + VAL + TEST
"""Members of a class in `collection`: 40 to train, 10 to validate, 25 to test, as in section 4.3."""


def make(label: str, index: int, seed: int = 0, *, detail: float | None = None) -> Mesh:
    """Return one member of a family.

    Parameters
    ----------
    label : str
        One of `CLASSES`.
    index : int
        Number of the member, from 0. The first `MEMBERS` are those of `collection`; there is no limit.
    seed : int
        Seed of the family; 0 is the built-in one.
    detail : float, optional
        Factor on the number of segments of round parts; by default the member's own, 0.55 to 2.

    Returns
    -------
    Mesh
        Cleaned, as `load_mesh` returns it, named like its key. z up, front towards -y, resting on z = 0 or centred,
        in any unit. 200 to 20,000 faces at the default detail; closed and open parts that touch and interpenetrate.

    Raises
    ------
    OptionError
        An unknown label, a negative index or seed, a detail that is not positive.

    Notes
    -----
    Randomness comes from ``SeedSequence([seed, crc32(label), index])`` alone. Consecutive members take all styles in a
    random order, drawn separately for each round. Every split therefore has each style in about its share.
    """
    _check(label, index, seed)
    if detail is not None and not 0.0 < detail < np.inf:
        raise OptionError(f"detail must be positive; got {detail}.")
    styles, number = STYLES[label], zlib.crc32(label.encode())
    turn, place = divmod(index, len(styles))
    order = np.random.default_rng(np.random.SeedSequence([seed, number, turn, len(styles)])).permutation(len(styles))
    draw = Draw(np.random.default_rng(np.random.SeedSequence([seed, number, index])), detail)
    vertices, faces = finished(styles[order[place]](draw), draw)
    origin = _origin(label, index, seed, detail)
    return Mesh(vertices, faces, name=f"{label}_{index:04d}", origin=origin).cleaned()


def finished(part: MeshPart, draw: Draw) -> tuple[FloatArray, IntArray]:
    """Return the vertices (v, 3) and faces (f, 3) of a modelled part with the defects of real CAD files.

    Notes
    -----
    Faces are quartered at their edges' midpoints until there are `MIN_FACES`. The winding is reversed for no face,
    for a run of faces or for random ones. Vertices are shared as modelled, or every face has its own three, as in many
    files of ModelNet. Sometimes a run of faces is duplicated. The unit is 0.05 to 500 times the modelled one;
    coordinates are single precision. The shape rests on z = 0 or is centred at the origin. The front stays towards -y.
    """
    # all draws come before anything that depends on the number of faces: `detail` must change nothing else
    winding, start = draw.pick(("modelled", "modelled", "run", "any")), draw.between(0.0, 0.5)
    twice, first = draw.chance(0.15), draw.between(0.0, 1.0)
    unshared, centred = draw.chance(0.35), draw.chance(0.5)
    unit = float(np.exp(draw.between(np.log(0.05), np.log(500.0))))
    points, faces = part.points, part.faces
    while len(faces) < MIN_FACES:
        points, faces = quartered(points, faces)
    n = len(faces)
    if winding == "run":
        run = slice(int(start * n), int(2 * start * n))
        faces = np.concatenate([faces[: run.start], faces[run, ::-1], faces[run.stop :]])
    elif winding == "any":
        faces = np.where(draw.rng.random(n)[:, None] < 0.5, faces[:, ::-1], faces)
    if twice:
        again = int(first * n)
        faces = np.concatenate([faces, faces[again : again + n // 40]])
    if unshared:
        points, faces = points[faces].reshape(-1, 3), np.arange(3 * len(faces), dtype=np.int32).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    middle = (low + high) / 2
    origin = middle if centred else np.array([middle[0], middle[1], low[2]])
    # single precision, as in files; it also makes the last bits equal on all processors
    return ((points - origin) * unit).astype(np.float32).astype(np.float64), faces


def split_of(index: int) -> str:
    """Return the split of a member: in each run of `MEMBERS` the first 40 are "train", 10 "val", 25 "test"."""
    place = index % MEMBERS
    return "train" if place < TRAIN else "val" if place < TRAIN + VAL else "test"


def key_of(label: str, index: int, seed: int = 0) -> str:
    """Return the key of a member, such as ``builtin/chair/train/chair_0007``; it contains a seed other than 0."""
    _check(label, index, seed)
    root = "builtin" if seed == 0 else f"builtin-{seed}"
    return f"{root}/{label}/{split_of(index)}/{label}_{index:04d}"


def collection(*, n_members: int = MEMBERS, seed: int = 0) -> MeshCollection:
    """Return the built-in shapes as a collection; a mesh is built when its entry is loaded.

    Parameters
    ----------
    n_members : int
        Members of each class; by default all 75 of the paper's section 4.3.
    seed : int
        As in `make`.

    Returns
    -------
    MeshCollection
        Class after class, in order of the index. Entries can be pickled.

    Raises
    ------
    OptionError
        `n_members` is less than 1, or the seed negative.
    """
    check_int("n_members", n_members, 1)
    return MeshCollection(
        MeshEntry(
            key_of(label, index, seed),
            label,
            split_of(index),
            partial(make, label, index, seed),
            origin=_origin(label, index, seed, None),
        )
        for label in CLASSES
        for index in range(n_members)
    )


def _origin(label: str, index: int, seed: int, detail: float | None) -> MeshSource:
    return MeshSource.of_recipe("shape", VERSION, label, int(index), int(seed), repr(detail))


def _check(label: str, index: int, seed: int) -> None:
    check_choice("label", label, CLASSES)
    check_int("index", index, 0)
    check_int("seed", seed, 0)

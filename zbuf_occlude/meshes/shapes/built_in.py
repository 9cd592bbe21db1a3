"""The table of built-in collections: their classes, the function that makes a member, and all members."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

from zbuf_occlude.base.errors import OptionError, did_you_mean
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.shapes import families, formulas, traffic


class BuiltIn(NamedTuple):
    """One collection.

    Parameters
    ----------
    name, summary : str
    root : str
        Beginning of all keys.
    classes : tuple of str
    n_members : int
        Members of each class in the collection; `make` of the first two takes any number.
    in_metres : bool
        True where members are in metres; False where they are in any unit.
    make : callable
        Returns a member for a class, number and seed.
    collection : callable
        Returns all members.
    """

    name: str
    summary: str
    root: str
    classes: tuple[str, ...]
    n_members: int
    in_metres: bool
    make: Callable[[str, int, int], Mesh]
    collection: Callable[[], MeshCollection]


def _formula(label: str, index: int, seed: int) -> Mesh:
    """Return the one surface of a formula."""
    if index or seed:
        raise OptionError(f"a formula has one surface, number 0 of seed 0; got {index} of {seed}.")
    return formulas.make(label)


BUILT_IN = (
    BuiltIn(
        "classes",
        "objects of the paper's eight classes",
        root="builtin/",
        classes=families.CLASSES,
        n_members=families.MEMBERS,
        in_metres=False,
        make=families.make,
        collection=families.collection,
    ),
    BuiltIn(
        "road-users",
        "what LiDARs on roads meet, in metres",
        root="road-users/",
        classes=traffic.CLASSES,
        n_members=families.MEMBERS,
        in_metres=True,
        make=traffic.make,
        collection=traffic.collection,
    ),
    BuiltIn(
        "formulas",
        "surfaces of formulas (Fig. 9), longest side 1",
        root="formula/",
        classes=tuple(formulas.FORMULAS),
        n_members=1,
        in_metres=False,
        make=_formula,
        collection=formulas.collection,
    ),
)


def find_shape(name: str) -> tuple[BuiltIn, str]:
    """Return the collection and the class of a shape's name, ``chair``, ``car`` or ``road-users/car``.

    The first collection that has the class is returned.

    Raises
    ------
    OptionError
        No collection has the class.
    """
    of, slash, label = name.rpartition("/")
    for row in BUILT_IN:
        if label in row.classes and of in (("", row.name) if not slash else (row.name,)):
            return row, label
    names = [label for row in BUILT_IN for label in row.classes] + [f"road-users/{each}" for each in traffic.CLASSES]
    raise OptionError(
        f"there must be a shape of that name; there is no {name!r}.{did_you_mean(name, names)} "
        "`zbuf-occlude shapes` lists them."
    )


def collection_of(keys: Iterable[str]) -> MeshCollection | None:
    """Return the built-in collection that contains all keys; None if there is none."""
    asked = list(keys)
    found = (row for row in BUILT_IN if all(key.startswith(row.root) for key in asked))
    row = next(found, None)
    return None if row is None else row.collection()

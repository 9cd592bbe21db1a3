"""Objects of scenes, in metres: those of a JSON file with their poses, or objects of a collection."""

import os
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.documents import Number, parse_bool, parse_document, parse_line, read_limited
from zbuf_occlude.base.errors import DatasetError, MeshError, OptionError, check_choice, escape_control
from zbuf_occlude.geometry.mesh import Mesh, check_frame
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.meshes.load import load_mesh
from zbuf_occlude.meshes.shapes import ROAD_USERS, make, road_user
from zbuf_occlude.sensors.scenes.kinds import SceneRequest
from zbuf_occlude.sensors.scenes.scene import Placed, moved
from zbuf_occlude.sensors.scenes.sizes import MAX_SIZE, MIN_SIZE, SIZES, Sizes, normalize_label, size_beside
from zbuf_occlude.sensors.scenes.table import checked_table, footprint, put_at_rest

FORM = '{"table": {"size": [x, y]}, "objects": [{"mesh": FILE, "position": [x, y, z]}, ...]}'
NUMBERS = {
    "position": Number(-1e6, 1e6, "metres", ((3,),)),
    "yaw": Number(-3600.0, 3600.0, "degrees"),
    "size": Number(MIN_SIZE, MAX_SIZE, "metres"),
    "albedo": Number(0.0, 1.0),
    "velocity": Number(-1e3, 1e3, "metres a second", ((3,),)),
    "turn": Number(-1e4, 1e4, "degrees a second"),
    "count": Number(1, 100, whole=True),
}
KNOWN = ("mesh", "class", "up", "unit", *NUMBERS)

MAX_OBJECTS = 24
"""Maximum objects of a collection in a pool: a worker loads each once."""
MAX_FACES = 30_000
"""Maximum faces of an object in a pool."""
MAX_METRES = {"street": 7.0, "room": 2.2, "table": 0.4}
"""Maximum longest side of an object in a scene's pool."""
BELONGING = {
    "street": (
        *("bicycle", "bus", "car", "motorbike", "motorcycle", "pedestrian", "person", "tractor", "trailer", "truck"),
        "van",
    ),
    "table": (
        *("bottle", "bowl", "camera", "can", "cap", "cup", "helmet", "jar", "mug", "radio", "remote", "remote_control"),
        *("telephone", "vase"),
    ),
    "room": (
        *("ashcan", "basket", "bed", "bench", "bookcase", "bookshelf", "cabinet", "chair", "couch", "desk"),
        *("dishwasher", "dresser", "file_cabinet", "flower_pot", "lamp", "loudspeaker", "mantel", "night_stand"),
        *("piano", "plant", "sofa", "speaker", "stool", "stove", "table", "toilet", "trash_bin", "tv_stand"),
        *("wardrobe", "washer"),
    ),
}
"""Classes of a collection that fit into a scene: road users, things on a table, furniture."""
BUILT_IN = {
    "street": {"car": 4, "pedestrian": 1, "bicycle": 1, "motorcycle": 1},
    "table": {"bottle": 3},
    "room": {"bed": 1, "bookshelf": 2, "chair": 3, "lamp": 2, "table": 2},
}
"""Number of built-in objects of each class that the collection lacks."""


def read_scene(path: Path) -> dict[str, Any]:
    """Read and check a scene's file.

    Parameters
    ----------
    path : Path
        ``{"objects": [{"mesh": FILE, "class": ..., "position": [x, y, z], "yaw": degrees, "size": metres}, ...]}``,
        also with albedo, velocity and turn as of `Placed`, up, unit instead of size, and count. Only mesh and position
        are required; an object whose class is a built-in road user needs no mesh. A position is that of the centre of
        the object's base, metres from the centre of the target's base. Paths are relative to the JSON's folder.
        Beside the objects ``{"table": {"size": [x, y], "height": metres, "albedo": ...}, "ground": false}``: a table
        under the target, and no ground. On a table, objects without a position come to rest at random.

    Returns
    -------
    dict
        The fields objects, table and ground of a `ScanConfig`: plain data with absolute paths, as a plan stores it. An
        object of a count is in it as often.

    Raises
    ------
    OptionError
        The file cannot be read, or is no scene; the message says what is wrong.
    """
    document, where = parse_document("JSON", read_limited(path), path), escape_control(str(path))
    if not isinstance(document, dict) or not isinstance(
        document.get("objects", [] if "table" in document else None), list
    ):
        raise OptionError(f"{where} must be {FORM}; it has no list of objects.")
    found, number = list[dict[str, Any]](), 0
    try:
        for name in document:
            check_choice("a key of a scene", name, ("objects", "table", "ground"))
        table = None if document.get("table") is None else checked_table(document["table"])
        ground = parse_bool("ground", document.get("ground", True))
    except OptionError as error:
        raise OptionError(f"{where}: {error}") from None
    for number, given in enumerate(document.get("objects", [])):
        try:
            each = _checked(given, path.parent, rests=table is not None)
        except OptionError as error:
            raise OptionError(f"{where}: object {number}: {error}") from None
        found += [each] * each.pop("count", 1)
    return {"objects": found, "table": table, "ground": ground}


def _checked(given: Any, folder: Path, *, rests: bool) -> dict[str, Any]:
    """Return an object of a scene's file; with `rests` it may be without a position."""
    builtin = isinstance(given, dict) and "mesh" not in given and str(given.get("class")) in ROAD_USERS
    if isinstance(given, dict) and "mesh" not in given and not builtin and "class" in given:
        raise OptionError(
            f"an object must have a mesh, unless its class is {', '.join(ROAD_USERS)} (in small letters); got the "
            f"class {given['class']!r:.40}. Give a mesh."
        )
    if not isinstance(given, dict) or not (rests or "position" in given) or not (builtin or "mesh" in given):
        raise OptionError(
            f"a scene must be {FORM}; it has no mesh or position. Only a {', '.join(ROAD_USERS)} needs no mesh, and "
            "only an object on a table no position."
        )
    for name in given:
        check_choice("a key of an object", name, KNOWN)
    found = {
        name: (NUMBERS[name].read if name in NUMBERS else parse_line)(name, value) for name, value in given.items()
    }
    check_frame(found.get("up"), found.get("unit"))
    for one, other in (("unit", "size"), ("count", "position")):
        if {one, other} <= set(found):
            raise OptionError(f"an object must have one of {one} and {other}; it has both. Leave one out.")
    if "yaw" in found and "position" not in found:
        raise OptionError(
            "an object with a yaw must have a position; without one it is turned at random. Leave it out."
        )
    found |= {name: list(found[name]) for name in ("position", "velocity") if name in found}
    if builtin:
        return found
    mesh = str((folder / found["mesh"]).absolute())
    if not os.path.isfile(mesh):
        raise OptionError(f"mesh must name a file; {mesh!r} does not exist.")
    return {**found, "mesh": mesh}


def with_checksums(objects: list[dict[str, Any]], *, colors: bool) -> list[dict[str, Any]]:
    """Return a scene's objects with the SHA-256 of each mesh's files, with or without those of its `colors`.

    Raises
    ------
    MeshError
        A mesh cannot be used.
    """
    return [
        {
            **each,
            "sha256": load_mesh(each["mesh"], up=each.get("up"), unit=each.get("unit"), colors=colors).origin.sha256,
        }
        if "mesh" in each
        else each
        for each in objects
    ]


def placed_of(
    objects: Sequence[Mapping[str, Any]], floor: float, transparent: Mapping[str, float | None] | None = None
) -> list[Placed]:
    """Load and place the meshes of a scene that have a position; `transparent` is as of a `ScanConfig`.

    Raises
    ------
    MeshError
        A file cannot be used.
    DatasetError
        A mesh differs from its checksum (`with_checksums`).
    """
    placed = []
    for given in filter(_has_position, objects):
        (x, y, z), (mesh, label) = given["position"], _loaded(given, transparent or {})
        pose = moved(yaw=given.get("yaw", 0.0), to=(x, y, z + floor))
        placed.append(Placed(mesh, label, pose, **_further(given)))
    return placed


def at_rest_of(
    objects: Sequence[Mapping[str, Any]],
    request: SceneRequest,
    placed: Sequence[Placed],
    rng: np.random.Generator,
    transparent: Mapping[str, float | None],
) -> list[Placed]:
    """Load the meshes of a scene without a position, and put them on its table, beside the target and those `placed`.

    Raises
    ------
    MeshError, DatasetError
        As `placed_of`; an object has no stable pose, or no place is free.
    """
    if request.table is None:
        return []
    occupied = [footprint(each.vertices) for each in (request.target, *placed)]
    found = []
    for given in objects:
        if not _has_position(given):
            mesh, label = _loaded(given, transparent)
            place = request.table["size"], request.floor
            found.append(put_at_rest(mesh, label, *place, occupied, rng, **_further(given)))
    return found


def _has_position(given: Mapping[str, Any]) -> bool:
    return "position" in given


def _further(given: Mapping[str, Any]) -> dict[str, Any]:
    return {name: given[name] for name in ("albedo", "velocity", "turn") if name in given}


def _loaded(given: Mapping[str, Any], transparent: Mapping[str, float | None]) -> tuple[Mesh, str]:
    """Return an object of a scene's file: a mesh that stands on z = 0, in metres, and its class."""
    label = str(given.get("class", Path(given.get("mesh", "")).stem))
    if "mesh" not in given:
        mesh = road_user(label)
        return on_ground(mesh, given.get("size", mesh.longest_side)), label
    loaded = load_mesh(given["mesh"], up=given.get("up"), unit=given.get("unit"), colors=bool(transparent))
    if given.get("sha256", loaded.origin.sha256) != loaded.origin.sha256:
        raise DatasetError(
            f"{given['mesh']} changed since the scene was read (sha256 {given['sha256'][:12]}..., now "
            f"{loaded.origin.sha256[:12]}...). Restore it, or generate all clouds again with --overwrite."
        )
    mesh = loaded.transparent(transparent)
    return on_ground(mesh, given.get("size", mesh.longest_side)), label


def on_ground(mesh: Mesh, size: float) -> Mesh:
    """Return a mesh scaled to `size` metres, with the centre of its base at the origin."""
    low, centre = mesh.bounds[0], mesh.centre
    return mesh.transformed(1.0, (-centre[0], -centre[1], -low[2])).transformed(size / mesh.longest_side)


def surroundings(entries: Sequence[MeshEntry], scene: str) -> list[MeshEntry]:
    """Return the objects for a kind of scene: those of a collection that fit, and built-in ones for missing classes.

    `scene` is a name of `zbuf_occlude.sensors.scenes.kinds.KINDS`. The list is empty for a scene without such objects.
    """
    fitting = [entry for entry in entries if normalize_label(entry.label) in BELONGING.get(scene, ())]
    labels = {normalize_label(entry.label) for entry in fitting}
    return fitting + [
        MeshEntry(f"built-in/{label}/{number}", label, "train", partial(_built_in, label, number))
        for label, count in BUILT_IN.get(scene, {}).items()
        if label not in labels
        for number in range(count)
    ]


def _built_in(label: str, number: int) -> Mesh:
    """Return a road user or a member of a family, in metres."""
    return road_user(label) if label in ROAD_USERS else on_ground(make(label, number), SIZES[label])


class Pool:
    """Random objects of a collection, selected by a number in [0, 1).

    Parameters
    ----------
    entries : sequence of MeshEntry
        Entries that cannot be loaded, have no size, or are too long or detailed are skipped. Built-in objects replace
        them where none is left.
    sizes : Sizes
        As `size_beside` takes them.
    scene : str
        A name of `zbuf_occlude.sensors.scenes.kinds.KINDS`.
    seed : SeedSequence
        The same collection and seed give the same objects.
    transparent : mapping of str to float or None
        As of a `ScanConfig`.
    """

    def __init__(
        self,
        entries: Sequence[MeshEntry],
        sizes: Sizes,
        scene: str,
        seed: np.random.SeedSequence,
        transparent: Mapping[str, float | None] | None = None,
    ) -> None:
        order = np.random.default_rng(seed).permutation(len(entries))
        self._entries = [entries[int(i)] for i in order[:MAX_OBJECTS]]
        self._built_in = surroundings((), scene)
        self._sizes, self._most, self._transparent = sizes, MAX_METRES.get(scene, np.inf), transparent or {}
        self._loaded: dict[str, tuple[Mesh, str] | None] = {}

    def __call__(self, number: float) -> tuple[Mesh, str]:
        """Return an object: a mesh that stands on z = 0, in metres, and its class."""
        for entries in (self._entries, self._built_in):
            n = len(entries)
            for i in range(n):
                if (found := self._object(entries[(int(number * n) + i) % n])) is not None:
                    return found
        raise OptionError("The scene has no objects to be filled with. Give some surroundings.")

    def _object(self, entry: MeshEntry) -> tuple[Mesh, str] | None:
        key = entry.key
        if key not in self._loaded:
            self._loaded[key] = None
            try:
                mesh = entry.load().transparent(self._transparent)
                size = size_beside(entry.label, self._sizes, mesh.longest_side)
            except (MeshError, OptionError):
                return None
            if mesh.longest_side > 0 and len(mesh.faces) <= MAX_FACES and size <= self._most:
                self._loaded[key] = on_ground(mesh, size), entry.label
        return self._loaded[key]

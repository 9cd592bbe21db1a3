"""Scenes from a user's JSON: meshes and where they stand around the target."""

import os
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.checks import check_word
from zbuf_occlude.documents import Number, line, parse, read_bytes
from zbuf_occlude.errors import OptionError, printable
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.load import UP, load_mesh
from zbuf_occlude.scenes.scene import Placed, moved
from zbuf_occlude.scenes.sizes import FILE, LEAST, MOST, size_of

FORM = '{"objects": [{"mesh": FILE, "position": [x, y, z]}, ...]}'
NUMBERS = {
    "position": Number(-1e6, 1e6, "metres", ((3,),)),
    "yaw": Number(-3600.0, 3600.0, "degrees"),
    "size": Number(LEAST, MOST, "metres"),
    "albedo": Number(0.0, 1.0),
}
KNOWN = ("mesh", "class", "up", *NUMBERS)


def read_scene(path: Path) -> list[dict[str, Any]]:
    """Read and check a scene's file.

    Parameters
    ----------
    path : Path
        ``{"objects": [{"mesh": FILE, "class": ..., "position": [x, y, z], "yaw": degrees, "size": metres}, ...]}``;
        all but mesh and position may be left out. Positions are metres from the middle of the target's foot; of the
        object it is the middle of the foot too. Files are found from the JSON's folder.

    Returns
    -------
    list of dict
        Plain data, the paths absolute: what a plan keeps.

    Raises
    ------
    OptionError
        Not readable, or not what it should be; the message says what.
    """
    document, where = parse("JSON", read_bytes(path), path), printable(str(path))
    objects = document.get("objects") if isinstance(document, dict) else None
    if not isinstance(objects, list):
        raise OptionError(f"{where} must be {FORM}; it has no list of objects.")
    found = []
    for given in objects:
        try:
            found.append(_checked(given, path.parent))
        except OptionError as error:
            raise OptionError(f"{where}: object {len(found)}: {error}") from None
    return found


def _checked(given: Any, folder: Path) -> dict[str, Any]:
    if not isinstance(given, dict) or not {"mesh", "position"} <= set(given):
        raise OptionError(f"a scene must be {FORM}; this has no mesh or position.")
    for name in given:
        check_word("what is said of an object", name, KNOWN)
    found = {name: (NUMBERS[name].read if name in NUMBERS else line)(name, value) for name, value in given.items()}
    check_word("up", found.get("up", UP[0]), UP)
    mesh = str((folder / found["mesh"]).absolute())
    if not os.path.isfile(mesh):
        raise OptionError(f"mesh must name a file that is there; {mesh!r} is not.")
    return {**found, "mesh": mesh, "position": list(found["position"])}


def placed_of(objects: list[dict[str, Any]], floor: float) -> list[Placed]:
    """Load a scene's meshes and put them in their places.

    Raises
    ------
    MeshError
        A file cannot be used.
    """
    placed = []
    for given in objects:
        mesh = load_mesh(given["mesh"], up=given.get("up"))
        label = str(given.get("class", Path(given["mesh"]).stem))
        size = given.get("size", size_of(label, FILE, mesh.longest_side))
        x, y, z = given["position"]
        pose = moved(yaw=np.radians(given.get("yaw", 0.0)), to=(x, y, z + floor))
        placed.append(Placed(standing(mesh, size), label, pose, given.get("albedo")))
    return placed


def standing(mesh: Mesh, size: float) -> Mesh:
    """Return a mesh scaled to `size` metres, the middle of its foot at the origin."""
    low, centre = mesh.bounds[0], mesh.centre
    return mesh.transformed(1.0, (-centre[0], -centre[1], -low[2])).transformed(size / mesh.longest_side)

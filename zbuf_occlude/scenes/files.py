"""Scenes from a user's JSON: meshes and where they stand around the target."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.errors import OptionError, in_words
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.files import load_mesh
from zbuf_occlude.scenes.scene import Placed, moved
from zbuf_occlude.scenes.sizes import FILE, size_of

KNOWN = {"mesh", "class", "position", "yaw", "size", "up", "albedo"}


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
    form = '{"objects": [{"mesh": FILE, "position": [x, y, z]}, ...]}'
    try:
        document = json.loads(path.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        raise OptionError(f"a scene must be readable JSON; {path}: {in_words(error)}.") from None
    objects = document.get("objects") if isinstance(document, dict) else None
    if not isinstance(objects, list):
        raise OptionError(f"{path} must be {form}; it has no list of objects.")
    found = []
    for number, given in enumerate(objects):
        if not isinstance(given, dict) or not {"mesh", "position"} <= set(given):
            raise OptionError(f"{path} must be {form}; object {number} has no mesh or position.")
        if unknown := set(given) - KNOWN:
            raise OptionError(f"objects of {path} must have {', '.join(sorted(KNOWN))}; {number} has {min(unknown)}.")
        try:
            position = np.asarray(given["position"], dtype=np.float64).reshape(3)
            numbers = [float(given.get(name, 1.0)) for name in ("yaw", "size", "albedo")]
        except (TypeError, ValueError) as error:
            raise OptionError(f"object {number} of {path} must have numbers; {error}.") from None
        if not np.isfinite([*position, *numbers]).all() or numbers[1] <= 0 or not 0 <= numbers[2] <= 1:
            raise OptionError(f"object {number} of {path} must have finite numbers, a size above 0, albedo in [0, 1].")
        file = (path.parent / str(given["mesh"])).absolute()
        if not file.is_file():
            raise OptionError(f"object {number} of {path} must name a file that is there; {file} is not.")
        found.append({**given, "mesh": str(file), "position": position.tolist()})
    return found


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
        size = float(given.get("size", size_of(label, FILE, mesh.longest_side)))
        x, y, z = given["position"]
        pose = moved(yaw=np.radians(given.get("yaw", 0.0)), to=(x, y, z + floor))
        albedo = float(given["albedo"]) if "albedo" in given else None
        placed.append(Placed(standing(mesh, size), label, pose, albedo))
    return placed


def standing(mesh: Mesh, size: float) -> Mesh:
    """Return a mesh scaled to `size` metres, the middle of its foot at the origin."""
    low, centre = mesh.bounds[0], mesh.centre
    return mesh.transformed(1.0, (-centre[0], -centre[1], -low[2])).transformed(size / mesh.longest_side)

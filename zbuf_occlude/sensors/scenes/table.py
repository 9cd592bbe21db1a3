"""Tables, and objects at rest on them: stable poses by trimesh, at places where footprints do not overlap."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.base.documents import Number
from zbuf_occlude.base.errors import MeshError, OptionError, check_choice, shown
from zbuf_occlude.base.extras import importing
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.sensors.scenes.scene import Placed, upright_pose
from zbuf_occlude.views import fibonacci

NUMBERS = {
    "size": Number(0.01, 100.0, "metres", ((2,),)),
    "height": Number(0.01, 100.0, "metres"),
    "albedo": Number(0.0, 1.0),
}
DEFAULTS = {"size": [1.2, 0.8], "height": 0.75}
"""Length and width of a table, and the height of its top, metres: assumed, as of an office desk."""
GAP = 0.005
"""Least distance of the footprints of objects, metres."""
MAX_CORNERS = 500
"""Corners of a convex hull from which on only those outermost in twice as many directions are taken."""
MIN_VOLUME = 1e-9
"""Least volume of a solid, over the cube of its diagonal."""
PLACES = 2_000
"""Places that are tried for an object."""

Footprint = tuple[FloatArray, FloatArray]
"""Centre (2,) and half sides (2,) of the box about an object, seen from above, metres."""


def checked_table(given: Any) -> dict[str, Any]:
    """Return a table's numbers, with defaults for those that are missing; raise OptionError for wrong ones."""
    if not isinstance(given, Mapping):
        raise OptionError(f"a table must be given as {{size: [x, y], height, albedo}}; got {shown(given)}.")
    for name in given:
        check_choice("a key of a table", name, NUMBERS)
    return {**DEFAULTS, **{name: NUMBERS[name].read(f"{name} of a table", value) for name, value in given.items()}}


def footprint(vertices: FloatArray) -> Footprint:
    """Return the footprint of vertices (n, 3)."""
    low, high = vertices[:, :2].min(axis=0), vertices[:, :2].max(axis=0)
    return (low + high) / 2.0, (high - low) / 2.0


def stable_poses(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """Return the rotations (m, 3, 3) in which a solid rests on a plane, and the probability (m,) of each.

    The centre of mass is that of the solid, or of the convex hull where the mesh is not closed.

    Raises
    ------
    MeshError
        A mesh without volume.
    UnavailableError
        SciPy or networkx is not installed.

    References
    ----------
    ``trimesh.poses.compute_stable_poses``: the probabilities of an object dropped in a random orientation.
    """
    with importing("networkx", "an object at rest"):
        import networkx  # noqa: F401  # trimesh needs it
    with importing("scipy", "an object at rest"):
        from scipy.spatial import QhullError
    solid = mesh.to_trimesh()
    solid.merge_vertices()
    with np.errstate(all="ignore"):
        try:
            hull = solid.convex_hull
            if len(hull.vertices) > MAX_CORNERS:
                extremes = (hull.vertices @ fibonacci(2 * MAX_CORNERS).eyes.T).argmax(axis=0)
                corners = Mesh(hull.vertices[np.unique(extremes)], np.array([[0, 1, 2]], np.int32))
                hull = corners.to_trimesh().convex_hull  # of all vertices, whatever the faces
            flat = not hull.volume > MIN_VOLUME * mesh.diagonal**3
        except QhullError:
            flat = True
        centre = solid.center_mass if flat or solid.is_volume else hull.center_mass
    # trimesh seeks for ever where the centre is outside the hull
    if flat or not (np.einsum("ij,ij->i", centre - hull.triangles_center, hull.face_normals) < 0.0).all():
        raise MeshError(f"{mesh.name} has no volume, and so no stable pose. Give it a position.")
    poses, shares = hull.compute_stable_poses(center_mass=centre)
    return poses[:, :3, :3], shares / shares.sum()


def put_at_rest(
    mesh: Mesh,
    label: str,
    size: Sequence[float],
    floor: float,
    occupied: list[Footprint],
    rng: np.random.Generator,
    **given: Any,
) -> Placed:
    """Return an object in a random stable pose at a random free place of a table; its footprint becomes occupied.

    Parameters
    ----------
    mesh : Mesh
        Metres.
    label : str
    size : (float, float)
        Sides of the table about the origin, metres.
    floor : float
        Height z of the table's top.
    occupied : list of Footprint
    rng : Generator
    **given
        Further arguments of `Placed`.

    Raises
    ------
    MeshError
        The object has no stable pose, or no place is free.
    """
    rotations, shares = stable_poses(mesh)
    pose = upright_pose(float(rng.uniform(0.0, 2.0 * np.pi)))
    pose[:3, :3] = pose[:3, :3] @ rotations[rng.choice(len(shares), p=shares)]
    turned = mesh.vertices @ pose[:3, :3].T
    centre, half = footprint(turned)
    places, free = rng.uniform(-1.0, 1.0, (PLACES, 2)) * (np.asarray(size) / 2.0 - half), np.ones(PLACES, dtype=bool)
    for other, its_half in occupied:
        free &= (np.abs(places - other) > half + its_half + GAP).any(axis=1)
    if not free.any() or (2.0 * half > size).any():
        raise MeshError(
            f"{label} has no free place on the table of {size[0]:g} x {size[1]:g} m; its footprint is "
            f"{2 * half[0]:.3g} x {2 * half[1]:.3g} m. Give a larger table, or fewer objects."
        )
    place = places[free.argmax()]
    occupied.append((place, half))
    pose[:3, 3] = [*(place - centre), floor - turned[:, 2].min()]
    return Placed(mesh, label, pose, **given)

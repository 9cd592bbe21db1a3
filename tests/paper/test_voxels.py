"""Objects as the surfaces of voxels: which faces they have, and that collections keep their keys."""

import numpy as np
import pytest

from zbuf_occlude import shapes
from zbuf_occlude.errors import OptionError
from zbuf_occlude.paper.objects import as_voxels, voxel_surface
from zbuf_occlude.shapes.solids import box


def test_a_cube_is_its_shell() -> None:
    mesh = voxel_surface(box, 6)
    assert np.count_nonzero(mesh.face_normals, axis=1).max() == 1, "all faces lie across an axis"
    assert mesh.longest_side == pytest.approx(1.0)
    assert mesh.areas.sum() == pytest.approx(6 * (1 + (4 / 6) ** 2)), "the outside, and the inside of a shell of cells"


def test_a_collection_keeps_keys_and_splits() -> None:
    meshes = shapes.collection(n_members=2)
    voxels = as_voxels(meshes, 8)
    assert [(e.key, e.label, e.split) for e in voxels] == [(e.key, e.label, e.split) for e in meshes]
    assert voxels[0].origin != meshes[0].origin
    assert voxels[0].origin != as_voxels(meshes, 9)[0].origin
    extent = np.ptp(voxels[0].load().bounds, axis=0) - np.ptp(meshes[0].load().normalized().bounds, axis=0)
    assert np.abs(extent).max() <= 2 / 8 + 1e-9, "a cell at either end"


@pytest.mark.parametrize("n", [1, 129])
def test_how_many_voxels(n: int) -> None:
    with pytest.raises(OptionError, match=f"voxels must lie in 2..128.*got {n}"):
        as_voxels(shapes.collection(n_members=1), n)

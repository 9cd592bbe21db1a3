"""Sizes of studies, and objects as surfaces of voxels."""

from dataclasses import replace

import numpy as np
import pytest

from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes.solids import box
from zbuf_occlude.studies.paper.design import FULL, QUICK, changed
from zbuf_occlude.studies.paper.experiments import as_voxels, voxel_surface


def test_what_a_size_has_already_changes_nothing_but_its_name() -> None:
    same = changed(QUICK, models=QUICK.models, seeds=3, objects=24, points=[256], epochs=30)
    expected = replace(
        QUICK,
        name="quick, voxnet pointnet threedmfv5-small, 3 seeds, 24 objects of a class, 256 points, 30 epochs",
        summary=same.summary,
        shares=(24, 6, 15),
        elevation_each=24,
        elevation_seeds=(0, 1, 2),
        augmentation_models=QUICK.models,
        elevation_epochs=30,
    )
    assert same == expected


def test_objects_keep_the_papers_shares_and_how_often_a_cloud_is_shown() -> None:
    assert changed(FULL, objects=40).shares == FULL.shares == (40, 10, 25)
    half = changed(FULL, objects=20)
    assert half.shares == (20, 5, 12)
    assert half.passes == FULL.passes // 2
    assert changed(QUICK, objects=5).shares == (5, 1, 3)


def test_points_keep_the_density() -> None:
    more = changed(QUICK, points=[512, 128])
    assert (more.n_points, more.sampled) == ((512, 128), 3000)
    assert (more.elevation_points, more.elevation_sampled) == (128, 750)


@pytest.mark.parametrize(
    ("change", "argument", "message"),
    [
        ("objects", 4, r"objects must lie in 5\.\.40.*got 4"),
        ("objects", 41, "got 41"),
        ("points", [], "points must be numbers of at least 1; got none"),
        ("points", [256, 0], "got 256, 0"),
        ("models", ["alexnet"], "model must be one of voxnet.*got 'alexnet'"),
        ("models", [], "models must name at least one"),
    ],
)
def test_what_no_study_can_have(change: str, argument: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        changed(QUICK, **{change: argument})


# ---- voxels ---------------------------------------------------------------------------------------------------------


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

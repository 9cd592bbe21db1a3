"""The paper's two datasets as options and meshes: counts, splits, what takes precedence."""

import numpy as np
import pytest

from tests.scenes import box
from zbuf_occlude import OptionError
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.presets import MODELNET8, find_preset, plan_of_originals
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.sensors import make


def modelnet(n_train: int, n_test: int, classes: tuple[str, ...] = MODELNET8) -> MeshCollection:
    """As ModelNet40's folders give it: "train" and "test" only."""
    return MeshCollection(
        MeshEntry(f"{label}/{split}/{label}_{i:04d}.off", label, split, box)
        for label in classes
        for split, n in (("train", n_train), ("test", n_test))
        for i in range(n)
    )


def counts(meshes: MeshCollection) -> dict[tuple[str, str], int]:
    found: dict[tuple[str, str], int] = {}
    for entry in meshes:
        found[entry.label, entry.split] = found.get((entry.label, entry.split), 0) + 1
    return found


def test_two_hundred_objects_as_many_of_each_class_as_can_be() -> None:
    choose = find_preset("paper-modelnet40").choose
    forty = tuple(f"class_{i:02d}" for i in range(40))
    chosen = choose(modelnet(60, 20, forty))
    assert len(chosen) == 200
    assert {sum(n for (c, _), n in counts(chosen).items() if c == label) for label in forty} == {5}
    builtin = choose(shapes.collection())
    assert [sum(e.label == label for e in builtin) for label in MODELNET8] == [25] * 8


def test_the_built_in_shapes_keep_their_splits() -> None:
    chosen = find_preset("paper-modelnet8").choose(shapes.collection())
    assert len(chosen) == 600
    for label in MODELNET8:
        assert [counts(chosen)[label, split] for split in ("train", "val", "test")] == [40, 10, 25]
    assert {e.key: e.split for e in chosen} == {e.key: e.split for e in shapes.collection()}


@pytest.mark.parametrize("n_test", [100, 20])
def test_modelnets_missing_splits_are_filled_from_train(n_test: int) -> None:
    chosen = find_preset("paper-modelnet8").choose(modelnet(124, n_test, (*MODELNET8, "sofa")))
    assert {label for label, _ in counts(chosen)} == set(MODELNET8)
    for label in MODELNET8:
        assert [counts(chosen)[label, split] for split in ("train", "val", "test")] == [40, 10, 25]
    assert len({entry.key for entry in chosen}) == 600, "no object in two splits"
    from_test = sum("/test/" in e.key for e in chosen if e.split == "test")
    assert from_test == 8 * min(25, n_test)


def test_too_few_objects_of_a_class_are_an_error() -> None:
    with pytest.raises(OptionError, match=r"must find 75 meshes of each of airplane, .*; there are 60 of airplane"):
        find_preset("paper-modelnet8").choose(modelnet(40, 20))


@pytest.mark.parametrize(
    ("preset", "width", "height", "focal_length"),
    [("modelnet40-c-occlusion", 1080, 720, 365.0), ("pcn", 160, 120, 100.0)],
)
def test_presets_have_the_cameras_of_their_generators(
    preset: str, width: int, height: int, focal_length: float
) -> None:
    sensor = make(find_preset(preset).options["sensor"])
    directions = sensor.rays().directions
    assert len(directions) == width * height
    across, upwards = directions[:, 1] / directions[:, 0], directions[:, 2] / directions[:, 0]
    assert np.abs(across).max() * focal_length == pytest.approx((width - 1) / 2, abs=0.05)
    assert np.abs(upwards).max() * focal_length == pytest.approx((height - 1) / 2, abs=0.05)


@pytest.mark.parametrize(("preset", "away"), [("modelnet40-c-occlusion", 3.0), ("modelnet40-c-lidar", 5.0)])
def test_modelnet40_cs_sensors_stand_as_far_from_an_object_of_longest_side_two(preset: str, away: float) -> None:
    """data/occlusion.py, random_pose and lidar_pose; data/util.py, normalize."""
    options = find_preset(preset).options
    assert float(options["size"]) == 2.0
    assert float(options["distance"]) * 2.0 == away


def test_originals_are_the_same_points_without_hsr() -> None:
    plan = Plan(
        modelnet(1, 0), DatasetConfig(n_points=77, sample_size=50, seed=4, method="oracle", variations=3), "npz"
    )
    originals = plan_of_originals(plan)
    assert originals.n_clouds == 8
    assert originals.config.complete
    assert (originals.config.n_points, originals.config.seed, originals.format) == (77, 4, "npz")
    assert originals.fingerprint != plan.fingerprint

"""Road users: as large as stated, in metres, on the ground, unlike each other, the same everywhere."""

import hashlib

import numpy as np
import pytest

import zbuf_occlude as zo
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import traffic
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN, collection_of, find_shape

FINGERPRINT = "5ae265e27001f4e3"
"""Of the first five members of each class: whoever changes one raises `traffic.VERSION`."""


@pytest.fixture(scope="module")
def members() -> dict[str, list[zo.Mesh]]:
    return {label: [traffic.make(label, i) for i in range(shapes.MEMBERS)] for label in traffic.CLASSES}


def sides(meshes: list[zo.Mesh]) -> np.ndarray:
    """Length, width, height of each: the front is towards -y."""
    return np.array([np.ptp(mesh.bounds, axis=0)[[1, 0, 2]] for mesh in meshes])


@pytest.mark.parametrize("label", traffic.CLASSES)
def test_each_stands_on_the_ground_and_is_sound(members: dict[str, list[zo.Mesh]], label: str) -> None:
    for mesh in members[label]:
        assert abs(mesh.bounds[0, 2]) < 1e-6
        assert abs(mesh.centre[:2]).max() < 1e-6
        assert len(mesh.faces) >= 200
    digests = {hashlib.sha256(mesh.vertices.tobytes()).hexdigest() for mesh in members[label]}
    assert len(digests) == shapes.MEMBERS


@pytest.mark.parametrize("label", traffic.SIZES)
def test_vehicles_have_the_stated_sizes(members: dict[str, list[zo.Mesh]], label: str) -> None:
    found, (means, shares) = sides(members[label]), map(np.array, traffic.SIZES[label])
    deviations = means * shares
    assert (abs(found - means) <= 2 * deviations + 1e-5).all()
    error = deviations / np.sqrt(len(found))
    assert (abs(found.mean(axis=0) - means) < 3.5 * error).all()
    cut = 0.88  # a normal number that is cut at two deviations deviates by so much less; within a chi-squared's bounds
    assert (found.std(axis=0) / deviations < 1.3).all()
    assert (found.std(axis=0) / deviations > 0.7 * cut).all()


def test_people_have_the_stated_statures(members: dict[str, list[zo.Mesh]]) -> None:
    """Standing people are as high as their stature; who walks, runs or leans is lower, a hat is higher."""
    heights = sides(members["pedestrian"])[:, 2]
    tallest = max(mean + 2 * deviation for mean, deviation in traffic.STATURES)
    assert heights.max() < tallest + 0.12
    assert heights.min() > traffic.CHILD[0] - 2 * traffic.CHILD[1] - 0.2
    assert 1.55 < np.median(heights) < 1.75
    riders = sides(members["cyclist"])
    np.testing.assert_allclose(riders[:, 0].mean(), 1.76, atol=0.05)  # KITTI's mean, and that of their height
    np.testing.assert_allclose(riders[:, 2].mean(), 1.737, atol=0.08)


def test_people_take_several_poses(members: dict[str, list[zo.Mesh]]) -> None:
    strides = sides(members["pedestrian"])[:, 0]
    assert (strides < 0.45).sum() > 8  # standing
    assert ((strides > 0.6) & (strides < 1.0)).sum() > 15  # walking
    assert (strides > 1.05).sum() > 5  # running


def test_they_are_the_same_everywhere_and_other_seeds_are_others() -> None:
    found = hashlib.sha256()
    for label in traffic.CLASSES:
        for i in range(5):
            mesh = traffic.make(label, i)
            found.update(mesh.vertices.tobytes() + mesh.faces.tobytes())
    assert found.hexdigest()[:16] == FINGERPRINT
    assert traffic.make("car", 0, 1).bounds.tolist() != traffic.make("car", 0).bounds.tolist()


def test_the_collection_has_the_splits_of_the_families() -> None:
    found = traffic.collection()
    assert len(found) == 6 * shapes.MEMBERS
    assert {entry.unit for entry in found} == {"m"}
    entry = found[41]
    assert (entry.key, entry.split) == ("road-users/bus/val/bus_0041", "val")
    assert entry.load().name == "bus_0041"
    np.testing.assert_array_equal(entry.load().vertices, traffic.make("bus", 41).vertices)


@pytest.mark.parametrize(("label", "index", "seed"), [("tram", 0, 0), ("car", -1, 0), ("car", 0, -1)])
def test_what_there_is_not_is_refused(label: str, index: int, seed: int) -> None:
    with pytest.raises(OptionError):
        traffic.make(label, index, seed)


def test_names_lead_to_collections() -> None:
    assert [(row.name, label) for row, label in map(find_shape, ("car", "road-users/car", "truck", "torus"))] == [
        ("classes", "car"),
        ("road-users", "car"),
        ("road-users", "truck"),
        ("formulas", "torus"),
    ]
    for name in ("chiar", "formulas/car", "/car", "road-users/"):
        with pytest.raises(OptionError, match="there is no"):
            find_shape(name)
    for row in BUILT_IN:
        found = collection_of(entry.key for entry in row.collection())
        assert found is not None
        assert found.classes == row.collection().classes
    assert collection_of(["builtin/chair/train/chair_0000", "a/b.off"]) is None

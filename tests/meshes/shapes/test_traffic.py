"""Road users: as large as stated, in metres, on the ground, unlike each other, the same everywhere."""

import hashlib

import numpy as np
import pytest

import zbuf_occlude as zo
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.shapes import people, traffic
from zbuf_occlude.meshes.shapes.built_in import BUILT_IN, collection_of, find_shape
from zbuf_occlude.meshes.shapes.draw import Draw

FINGERPRINT = "3fb366f9de0384b6"
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
    assert (strides < 0.55).sum() > 8  # standing
    assert ((strides > 0.6) & (strides < 1.0)).sum() > 15  # walking
    assert (strides > 1.05).sum() > 5  # running, or with luggage behind


def test_people_are_as_large_as_those_that_kitti_labels(members: dict[str, list[zo.Mesh]]) -> None:
    """Means of KITTI's training boxes (Qi et al. 2018); boxes of people include what they carry."""
    for label, box in (("pedestrian", (0.84, 0.66, 1.76)), ("cyclist", (1.76, 0.60, 1.74))):
        assert sides(members[label]).mean(axis=0) == pytest.approx(box, rel=0.1)


@pytest.mark.parametrize("label", ["pedestrian", "cyclist"])
def test_parts_of_people_are_closed(members: dict[str, list[zo.Mesh]], label: str) -> None:
    """Each edge is met an even number of times: twice, or more where parts touch."""
    for mesh in members[label][:20]:
        _, same = np.unique(mesh.vertices, axis=0, return_inverse=True)
        corners = same[mesh.faces]
        edges = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
        assert (np.unique(edges, axis=0, return_counts=True)[1] % 2 == 0).all()


@pytest.mark.parametrize("label", traffic.CLASSES)
def test_no_two_are_alike(members: dict[str, list[zo.Mesh]], label: str) -> None:
    """Length, width, height or surface differ by half a percent at least, in any pair."""
    numbers = np.log(np.column_stack([sides(members[label]), [mesh.areas.sum() for mesh in members[label]]]))
    apart = np.abs(numbers[:, None] - numbers[None]).max(axis=2)[~np.eye(len(numbers), dtype=bool)]
    assert apart.min() > 0.005


def test_legs_of_walkers_are_in_opposite_phases() -> None:
    """The hip swings by twice the amplitude; the knee bends further only while the leg swings forward."""
    phases = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    hips, knees = np.array([people._leg(phase, amplitude=22.0, knee=8.0, flex=55.0) for phase in phases]).T
    assert np.ptp(hips) == pytest.approx(44.0, rel=1e-3)
    assert knees.min() == pytest.approx(-63.0)
    forward = np.cos(phases) > 1e-9
    assert (knees[~forward] == -8.0).all()
    assert (knees[forward] < -8.0).all()
    (left, _), (right, _), (arm, _), _ = people._stride(Draw(np.random.default_rng(0)), 22.0, 8.0, 55.0, 20.0, 10.0)
    assert left + right == pytest.approx(2 * 0.2 * 22.0)
    assert (left - 0.2 * 22.0) / 22.0 == pytest.approx(-arm / 20.0)  # the arm swings against the leg beside it


def test_vehicles_have_windows_of_drawn_glass(members: dict[str, list[zo.Mesh]]) -> None:
    factors = []
    for label in traffic.SIZES:
        for mesh in members[label]:
            assert mesh.colors is not None
            scattering = mesh.colors.scattering
            factors.append(scattering.min())
            glass = scattering < 1.0
            share = mesh.areas[glass].sum() / mesh.areas.sum()
            assert 0.003 < share < 0.35
            rising = (mesh.face_normals[glass][:, 2] ** 2 / (mesh.face_normals[glass] ** 2).sum(axis=1)) > 0.99
            assert mesh.areas[glass][rising].sum() < 0.05 * mesh.areas[glass].sum()  # roofs are no windows
    low, high = traffic.GLASS
    ranks = np.sort(np.log(np.array(factors) / low) / np.log(high / low))
    assert abs(ranks - (np.arange(len(ranks)) + 0.5) / len(ranks)).max() < 1.63 / np.sqrt(len(ranks))  # KS, 1 %
    assert all(mesh.colors is None for label in ("pedestrian", "cyclist") for mesh in members[label])


def test_some_vans_are_closed_behind(members: dict[str, list[zo.Mesh]]) -> None:
    ends = []
    for mesh in members["van"]:
        assert mesh.colors is not None
        ends.append(mesh.corners[mesh.colors.scattering < 1.0][..., 1].max() / mesh.bounds[1, 1])
    assert 20 < (np.array(ends) < 0.2).sum() < 55


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

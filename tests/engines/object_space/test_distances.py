"""Both suggestions' distances against the true distance from the eye to the face (trimesh's closest point)."""

import numpy as np
import pytest
import trimesh

from tests.scenes import sphere
from zbuf_occlude.engines.object_space.distances import PlaneDistances, SampleDistances
from zbuf_occlude.engines.object_space.planes import FacePlanes

MESH = sphere(12).transformed(2.0, (5.0, -3.0, 1.0))
EYES = np.array([[9.0, 0.0, 4.0], [5.0, -3.0, 1.5]])  # outside and inside


def true_distances(eye: np.ndarray) -> np.ndarray:
    closest = trimesh.triangles.closest_point(MESH.corners, np.broadcast_to(eye, (len(MESH.faces), 3)))
    return np.asarray(np.linalg.norm(closest - eye, axis=1))


@pytest.mark.parametrize("eye", EYES)
def test_first_suggestion_never_exceeds_the_true_distance(eye: np.ndarray) -> None:
    planes = PlaneDistances(FacePlanes.from_mesh(MESH)).from_eye(eye)
    true = true_distances(eye)
    assert (planes <= true + 1e-12).all()
    if (eye == EYES[0]).all():
        assert (planes < 0.5 * true).any()  # far below it, too: why it excludes little


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("n_samples", [1, 1000, 200_000])
def test_second_suggestion_never_falls_below_the_true_distance(eye: np.ndarray, n_samples: int) -> None:
    samples = SampleDistances(MESH, n_samples)
    distances, true = samples.from_eye(eye), true_distances(eye)
    assert (distances >= true - 1e-12).all()
    if n_samples == 200_000:
        assert (distances - true).max() < 0.2 * np.sqrt(MESH.areas.max())


def test_every_face_has_a_sample_even_where_algorithm_1_gives_none() -> None:
    assert len(SampleDistances(MESH, 1).positions) == len(MESH.faces)
    assert 4800 < len(SampleDistances(MESH, 5000).positions) < 5200 + len(MESH.faces)  # Algorithm 1's total is random


def test_same_seed_same_samples() -> None:
    one, two = SampleDistances(MESH, 100, seed=3), SampleDistances(MESH, 100, seed=3)
    assert one.positions.tobytes() == two.positions.tobytes()
    assert one.positions.tobytes() != SampleDistances(MESH, 100, seed=4).positions.tobytes()

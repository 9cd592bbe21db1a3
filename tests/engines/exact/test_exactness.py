"""The engine of `exact` over random scenes, and the same answers from any processor and any number of threads."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import CONTACTS, KINDS, scene, wrong_answers, wrong_answers_of
from tests.scenes import row_in_a_plane
from zbuf_occlude import Mesh, sample_surface
from zbuf_occlude.meshes.shapes import solids
from zbuf_occlude.visibility.interface import VisibilityQuery

ROOT = Path(__file__).parents[3]


def test_random_scenes_are_answered_as_by_rational_arithmetic(monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = set()
    for index in range(130):
        if index == len(KINDS) * len(CONTACTS):  # once more, as few points of large meshes are asked
            monkeypatch.setattr("zbuf_occlude.engines.exact.MIN_POINTS_PER_LEAF", 1 << 40)
        contact = CONTACTS[index % len(CONTACTS)]
        wrong, _ = wrong_answers_of("exact", 1, index, contact)
        kind = scene(1, index)[3]
        assert wrong == 0, f"scene {index} ({kind}, contact {contact:g})"
        kinds.add((kind, contact))
    assert len(kinds) == len(KINDS) * len(CONTACTS)


def test_random_scenes_notice_a_method_that_errs() -> None:
    class Blind(VisibilityQuery):
        def _visible(self, points: zo.SurfacePoints, eyes: np.ndarray) -> np.ndarray:
            return np.ones((len(eyes), len(points)), dtype=bool)

    assert wrong_answers(lambda mesh, contact: Blind(mesh), 1, 5)[0] > 0


@pytest.mark.parametrize("seed", range(20))
def test_no_face_hides_what_is_seen_past_it_in_its_own_plane(seed: int) -> None:
    mesh, points, eyes = row_in_a_plane(seed)
    with zo.prepare(mesh, method="exact") as occluder:
        assert occluder.visible(points, eyes).all()


def crowd() -> tuple[Mesh, zo.SurfacePoints, np.ndarray]:
    """A sphere behind a cloud of triangles, seen from far, near and inside."""
    rng = np.random.default_rng(0)
    corners = rng.uniform(-1, 1, (1500, 1, 3)) + rng.normal(0, 0.05, (1500, 3, 3))
    sphere = solids.icosphere(4)
    mesh = Mesh(
        np.concatenate([sphere.vertices, corners.reshape(-1, 3)]),
        np.concatenate([sphere.faces, np.arange(4500).reshape(-1, 3) + len(sphere.vertices)]),
    )
    directions = rng.normal(size=(9, 3))
    distances = np.repeat([20.0, 3.0, 0.9], 3)[:, None]
    eyes = distances * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return mesh, sample_surface(mesh, n_points=9000, seed=0), eyes


def digest() -> str:
    mesh, points, eyes = crowd()
    with zo.prepare(mesh, method="exact") as occluder:
        return hashlib.sha256(np.packbits(occluder.visible(points, eyes)).tobytes()).hexdigest()


@pytest.mark.parametrize("n_threads", range(1, numba.config.NUMBA_NUM_THREADS + 1))
def test_any_number_of_threads_gives_the_same_answers(n_threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    expected = digest()
    monkeypatch.setattr("zbuf_occlude.base.jit.threads._most", n_threads)
    assert digest() == expected
    mesh, points, eyes = crowd()
    with zo.prepare(mesh, method="exact") as occluder:  # one eye: the points are shared out instead
        alone = [occluder.visible(points, eyes[i : i + 1])[0] for i in range(len(eyes))]
        np.testing.assert_array_equal(np.stack(alone), occluder.visible(points, eyes))


@pytest.mark.long
@pytest.mark.parametrize("processor", ["haswell", "x86-64"])
def test_a_processor_without_wide_vectors_gives_the_same_answers(processor: str) -> None:
    """haswell has AVX2 and fused multiply-add but no AVX-512, x86-64 neither of the three."""
    if os.uname().machine != "x86_64":
        pytest.skip(f"these processors' code does not run on {os.uname().machine}")
    environment = dict(os.environ, NUMBA_CPU_NAME=processor, NUMBA_CPU_FEATURES="")
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_exactness as t; print(t.digest())"
    )
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split()[-1] == digest()

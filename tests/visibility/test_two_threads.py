"""Two threads of one process, on one occluder and on two: every method on the CPU gives each its own answer."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from zbuf_occlude import METHODS, Mesh, prepare, sample_surface, shapes

METHODS_ON_CPU = [row for row in METHODS if not row.needs_gl and row.name != "pyrender"]
"""Those that render have their own story (tests/gl); pyrender renders in a process of its own."""
N_CALLS = 6


def questions(mesh: Mesh) -> list[tuple[object, np.ndarray]]:
    rng = np.random.default_rng(0)
    eyes = rng.normal(size=(N_CALLS, 2, 3))
    eyes *= 3.0 * mesh.longest_side / np.linalg.norm(eyes, axis=-1, keepdims=True)
    return [(sample_surface(mesh, n_points=150 + 40 * i, seed=i), eyes[i] + mesh.centre) for i in range(N_CALLS)]


@pytest.mark.parametrize("row", METHODS_ON_CPU, ids=lambda row: row.name)
def test_threads_at_a_time_give_what_one_gives(row: object) -> None:
    if reason := row.missing():  # type: ignore[attr-defined]
        pytest.skip(reason)
    meshes = [shapes.make("chair", 1, detail=0.3), shapes.make("lamp", 2, detail=0.3)]
    asked = [questions(mesh) for mesh in meshes]
    with prepare(meshes[0], row.name) as one, prepare(meshes[1], row.name) as other:  # type: ignore[attr-defined]
        occluders = (one, other)
        alone = [[occluders[m].visible(*question) for question in asked[m]] for m in range(2)]  # type: ignore[arg-type]

        def ask(m: int, order: Callable[[range], object]) -> list[tuple[int, np.ndarray]]:
            return [(i, occluders[m].visible(*asked[m][i])) for i in order(range(N_CALLS))]  # type: ignore[arg-type, attr-defined]

        with ThreadPoolExecutor(4) as pool:
            running = [(m, pool.submit(ask, m, order)) for m in range(2) for order in (list, reversed)]
            for m, future in running:
                for i, mask in future.result(timeout=120):
                    assert np.array_equal(mask, alone[m][i]), (m, i)

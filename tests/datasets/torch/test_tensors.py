"""Visibility of tensors: the oracle's answers, nothing copied to the host, meshes prepared once; Warp on the CPU."""

import doctest
import gc
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.random_scenes import rays_of, scene
from tests.scenes import sphere
from zbuf_occlude.visibility.methods.oracle import prepare as prepare_oracle

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")
pytest.importorskip("warp", reason="Warp is not installed: pip install 'zbuf-occlude[warp]'")

from zbuf_occlude.datasets.torch import tensors  # noqa: E402

BALL = sphere(16)
POINTS = zo.sample_surface(BALL, n_points=300, seed=0)
EYES = np.array([[3.0, 0.5, 1.0], [-2.0, 4.0, 0.3]])


def as_tensors(*arrays: np.ndarray) -> list[Any]:
    return [torch.tensor(array) for array in arrays]


def asked() -> list[Any]:
    return as_tensors(BALL.vertices, BALL.faces, POINTS.positions, POINTS.face_ids, EYES)


@pytest.mark.parametrize("index", range(9))
def test_answers_are_the_oracles(index: int) -> None:
    mesh, points, eyes, _ = scene(3, index)
    oracle = prepare_oracle(mesh)
    mask = zo.torch.visible(*as_tensors(mesh.vertices, mesh.faces, points.positions, points.face_ids, eyes))
    assert (mask.numpy() == oracle.visible(points, eyes)).all()
    _, origins, directions = rays_of(3, index)
    found = zo.torch.first_hits(*as_tensors(mesh.vertices, mesh.faces, origins, directions))
    truth = oracle.first_hits(origins, directions)
    assert (found.face_ids.numpy() == truth.face_ids).all()
    assert np.allclose(found.distances.numpy(), truth.distances, rtol=1e-8, atol=0.0)


def test_shapes_and_types() -> None:
    vertices, faces, points, face_ids, eyes = asked()
    mask = zo.torch.visible(vertices, faces, points, face_ids, eyes)
    assert (mask.shape, mask.dtype, mask.device) == ((2, 300), torch.bool, vertices.device)
    other = zo.torch.visible(vertices.float(), faces.long(), points.float(), face_ids.short(), eyes.float())
    assert (mask == other).float().mean() > 0.99, "float32 positions lie off their faces, most by less than tolerated"
    assert torch.equal(zo.torch.visible(vertices, faces, points, face_ids, eyes[1]), mask[1])
    assert zo.torch.visible(vertices, faces, points[:0], face_ids[:0], eyes).shape == (2, 0)
    with torch.inference_mode():
        assert torch.equal(zo.torch.visible(vertices.clone(), faces.clone(), points, face_ids, eyes), mask)
    hits = zo.torch.first_hits(vertices, faces, eyes[:1], torch.tensor([[-3.0, -0.5, -1.0], [1.0, 0.0, 0.0]]))
    assert (hits.face_ids.dtype, hits.distances.dtype) == (torch.int32, torch.float64)
    assert hits.face_ids.tolist()[1] == -1
    assert hits.distances[1] == np.inf


@pytest.mark.parametrize("length", [1e-300, 1e-30, 1e30, 1e69])
def test_a_direction_may_have_any_length(length: float) -> None:
    plate = as_tensors(np.array([[-1.0, -1, 0], [3, -1, 0], [-1, 3, 0]]), np.array([[0, 1, 2]]))
    origins, directions = as_tensors(np.array([[0.1, 0.2, 1.0], [0.1, 0.2, 1e6]]), np.array([[0, 0, -length]] * 2))
    found = zo.torch.first_hits(*plate, origins, directions)
    assert found.face_ids.tolist() == [0, 0]
    assert found.distances.tolist() == pytest.approx([1.0, 1e6], rel=1e-12)


@contextmanager
def no_way_to_the_host() -> Iterator[None]:
    """Forbid to read a tensor's values outside of its device."""

    def refused(*_: Any, **__: Any) -> Any:
        raise AssertionError("a tensor went to the host")

    with pytest.MonkeyPatch.context() as patched:
        for name in ("cpu", "numpy", "tolist", "item", "__array__", "__bool__", "__int__", "__float__"):
            patched.setattr(torch.Tensor, name, refused)
        yield


def test_nothing_is_copied_to_the_host() -> None:
    given = asked()
    expected = zo.torch.visible(*given).numpy()
    data = SimpleNamespace(pos=given[0], face=given[1].T.contiguous())
    occlude = zo.torch.OnTheFlyOcclusion(50, eyes_per_sampling=2, attributes=("normals",), device="cpu")
    occlude(data)
    with no_way_to_the_host():
        mask = zo.torch.visible(*given)
        zo.torch.first_hits(given[0], given[1], given[4], -given[4])
        clouds = [occlude(data) for _ in range(4)]
        with pytest.raises(AssertionError, match="went to the host"):
            _ = bool(given[0].sum() > 0)
    assert (mask.numpy() == expected).all()
    assert all(cloud.pos.shape == cloud.normal.shape == (50, 3) for cloud in clouds)


def test_a_mesh_is_prepared_once_and_again_when_it_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    from zbuf_occlude.engines import warp

    prepared: list[int] = []

    class Counted(warp.DeviceBvh):
        def __init__(self, corners: Any, bounds: Any) -> None:
            prepared.append(corners.shape[0] // 3)
            super().__init__(corners, bounds)

    monkeypatch.setattr(warp, "DeviceBvh", Counted)
    vertices, faces, points, face_ids, eyes = asked()
    for _ in range(3):
        assert not zo.torch.visible(vertices, faces, points, -torch.ones_like(face_ids), eyes).all()
    assert prepared == [len(BALL.faces)]
    vertices += 50.0  # in place; nothing is before the points any more
    assert zo.torch.visible(vertices, faces, points, -torch.ones_like(face_ids), eyes).all()
    assert zo.torch.first_hits(vertices, faces[:2].clone(), eyes, 50.0 - eyes).face_ids.max() < 2
    assert prepared == [len(BALL.faces), len(BALL.faces), 2]
    transposed = faces.T.contiguous()
    for _ in range(2):  # another object each time, of the same memory
        zo.torch.visible(vertices[:], transposed.T, points, face_ids, eyes)
    assert len(prepared) == 4
    vertices.data = vertices.data.clone() - 50.0  # as module.to() does it, unseen by its version
    assert not zo.torch.visible(vertices, faces, points, -torch.ones_like(face_ids), eyes).all()
    vertices.data = vertices.data[:3]
    with pytest.raises(zo.ArgumentError, match="faces must lie in"):
        zo.torch.visible(vertices, faces, points, face_ids, eyes)
    known = len(tensors._meshes)
    del vertices
    gc.collect()
    assert len(tensors._meshes) < known, "kept as long as the vertices"


@pytest.mark.parametrize(
    ("changed", "error", "message"),
    [
        ({0: BALL.vertices}, zo.ArgumentError, r"vertices must be a \(n, 3\) float tensor on cpu; got ndarray"),
        ({2: torch.zeros(3, 7)}, zo.ArgumentError, r"points must be .*got \(3, 7\) float32 on cpu"),
        ({3: torch.zeros(300)}, zo.ArgumentError, r"face_ids must be a \(300,\) int tensor"),
        ({3: torch.zeros(4, dtype=torch.int32)}, zo.ArgumentError, r"face_ids must be a \(300,\) int tensor.*\(4,\)"),
        ({4: torch.zeros(2, 3, device="meta")}, zo.ArgumentError, "eyes must be .* on cpu; got .* on meta"),
        ({4: None}, zo.ArgumentError, "eyes must be .* got NoneType"),
        ({0: torch.zeros(5, 3, device="meta")}, zo.ArgumentError, "on the CPU or on a CUDA device; .* on meta"),
        (
            {1: torch.tensor([[0, 1, 2 + 2**32]])},
            zo.ArgumentError,
            r"faces must lie in .* to 4294967298",
        ),
        ({0: torch.tensor(BALL.vertices).to_sparse()}, zo.ArgumentError, "vertices must be .*sparse"),
        (
            {4: torch.nested.nested_tensor([torch.eye(3)], layout=torch.jagged)},
            zo.ArgumentError,
            "eyes must be .*nested",
        ),
        ({0: torch.tensor(BALL.vertices * 1e100)}, zo.MeshError, r"none beyond 1e\+70"),
        ({0: torch.tensor(BALL.vertices * 1e-100)}, zo.MeshError, "at least 1e-70 long"),
        ({1: torch.tensor([[0, 1, 999]])}, zo.ArgumentError, r"faces must lie in \[0, \d+\); got values from 0 to 999"),
        ({1: torch.zeros(0, 3, dtype=torch.int64)}, zo.MeshError, "must have vertices and faces"),
        ({0: torch.full(BALL.vertices.shape, torch.nan)}, zo.MeshError, "must have finite positions"),
    ],
)
def test_errors(changed: dict[int, Any], error: type[Exception], message: str) -> None:
    given = [changed.get(i, each) for i, each in enumerate(asked())]
    with pytest.raises(error, match=message):
        zo.torch.visible(*given)


@pytest.mark.parametrize("function", [tensors.visible, tensors.first_hits])
def test_the_examples_are_true(function: Any) -> None:
    (test,) = doctest.DocTestFinder(recurse=False).find(function, globs={"zo": zo, "torch": torch})
    assert doctest.DocTestRunner().run(test).failed == 0


@pytest.mark.parametrize("contact", [-1.0, 5, "a"])
def test_contact_must_be_a_fraction(contact: Any) -> None:
    with pytest.raises(zo.OptionError, match="contact must lie in"):
        zo.torch.visible(*asked(), contact=contact)


def test_a_face_id_of_no_face_is_none() -> None:
    """Even one that would be another face's in 32 bits."""
    vertices, faces, points, face_ids, eyes = asked()
    none = zo.torch.visible(vertices, faces, points, -torch.ones_like(face_ids), eyes, contact=0.0)
    assert not torch.equal(zo.torch.visible(vertices, faces, points, face_ids, eyes, contact=0.0), none)
    for away in (2**32, -(2**32)):
        assert torch.equal(zo.torch.visible(vertices, faces, points, face_ids.long() + away, eyes, contact=0.0), none)


@pytest.mark.parametrize("length", [0.0, np.nan, np.inf])
def test_a_direction_without_a_length_meets_nothing(length: float) -> None:
    vertices, faces, _, _, eyes = asked()
    hits = zo.torch.first_hits(vertices, faces, eyes, -eyes * length)
    assert hits.face_ids.tolist() == [-1, -1]
    assert hits.distances.tolist() == [np.inf, np.inf]


def test_origins_are_one_or_one_for_each_ray() -> None:
    vertices, faces, _, _, eyes = asked()
    with pytest.raises(zo.ArgumentError, match=r"origins must be a \(3, 3\) float tensor on cpu; got \(2, 3\)"):
        zo.torch.first_hits(vertices, faces, eyes, torch.ones(3, 3))

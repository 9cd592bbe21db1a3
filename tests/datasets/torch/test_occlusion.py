"""Occlusion on the fly: only visible points, another eye each time, in workers, of any kind of mesh."""

import copy
import math
import pickle
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch is not installed: pip install 'zbuf-occlude[learn]'")

from tests.scenes import sphere  # noqa: E402
from zbuf_occlude import ArgumentError, Mesh, MeshError, OptionError, SurfacePoints, prepare  # noqa: E402
from zbuf_occlude.base.jit.threads import n_threads  # noqa: E402
from zbuf_occlude.datasets.torch import OnTheFlyOcclusion  # noqa: E402
from zbuf_occlude.geometry.colors import GREY, WHITE, SurfaceColors  # noqa: E402

BALL = sphere(24)
needs_warp = pytest.mark.skipif(find_spec("warp") is None, reason="Warp is not installed: zbuf-occlude[warp]")
anywhere = pytest.mark.parametrize("device", [None, pytest.param("cpu", marks=needs_warp)])
"""Drawn by NumPy, or by PyTorch on a device."""


def mean_direction(cloud: Any) -> np.ndarray:
    mean = np.asarray(cloud, dtype=float).mean(axis=0)
    return mean / np.linalg.norm(mean)


@anywhere
def test_a_ball_is_seen_as_a_cap_from_everywhere(device: str | None) -> None:
    """From d = 4 diameters = 8 radii the cap is what has cos > 1/8, whose uniform points have mean (1 + 1/8) / 2."""
    torch.manual_seed(0)
    occlude = OnTheFlyOcclusion(2048, scale="mesh", device=device)
    directions = []
    for _ in range(60):
        cloud = occlude(BALL)
        assert (cloud.shape, cloud.dtype) == ((2048, 3), torch.float32)
        towards = mean_direction(cloud)
        heights = cloud.numpy() @ towards
        assert heights.min() > 1 / 8 - 0.15, "nothing beyond the horizon"  # the mean of 2048 points is off by .02 or so
        assert abs(heights.mean() - 9 / 16) < 0.06
        assert len(np.unique(cloud.numpy(), axis=0)) == 2048, "no point twice where enough are visible"
        directions.append(towards)
    spread = np.array(directions)
    assert np.abs(spread.mean(axis=0)).max() < 5 / math.sqrt(3 * 60), "eyes are uniform over the sphere"
    assert len(np.unique(spread.round(2), axis=0)) > 55, "another eye each time"


@anywhere
def test_every_point_is_visible_by_the_oracles_word(device: str | None) -> None:
    """For the one elevation whose eye is known: straight above a ring."""
    mesh = Mesh.from_trimesh(__import__("trimesh").creation.annulus(0.3, 0.5, 0.4))
    occlude = OnTheFlyOcclusion(200, scale="mesh", elevation=(90, 90), device=device)  # straight above
    eye = mesh.centre + np.array([0, 0, 4 * mesh.longest_side])
    with prepare(mesh, "oracle", contact=1e-4) as oracle:  # positions are float32
        for _ in range(3):
            cloud = occlude(mesh).numpy().astype(float)
            towards = eye - cloud
            lifted = cloud + 1e-3 * towards / np.linalg.norm(towards, axis=1, keepdims=True)
            assert oracle.visible(SurfacePoints.free(lifted), eye[None]).all()
            outer = np.linalg.norm(cloud[:, :2], axis=1) > 0.49
            assert (cloud[~outer, 2] > -0.21).all()
            assert (cloud[outer, 2] > 0.19).all(), "from above the outer wall is behind the rim"


@anywhere
def test_scale_makes_the_longest_side_one(device: str | None) -> None:
    cloud = OnTheFlyOcclusion(100, device=device)(BALL.transformed(37.0, [5, 6, 7]))
    assert np.ptp(cloud.numpy(), axis=0).max() == pytest.approx(1.0)
    assert np.allclose(cloud.numpy().min(axis=0) + cloud.numpy().max(axis=0), 0, atol=1e-6)


def test_seeded_by_torch() -> None:
    def one() -> Any:
        torch.manual_seed(5)
        occlude = OnTheFlyOcclusion(64, eyes_per_sampling=2)
        return torch.stack([occlude(BALL) for _ in range(5)])

    assert torch.equal(one(), one())


def test_the_same_seed_gives_the_same_cloud_whatever_was_drawn_before() -> None:
    """For validation, say: as long as no clouds are in store."""
    occlude = OnTheFlyOcclusion(64, eyes_per_sampling=1)
    clouds = []
    for _ in range(3):
        torch.manual_seed(7)
        clouds.append(occlude(BALL))
        occlude(BALL)
    assert torch.equal(clouds[0], clouds[1])
    assert torch.equal(clouds[0], clouds[2])


def test_any_kind_of_mesh() -> None:
    import trimesh

    def first(mesh: Any) -> Any:
        torch.manual_seed(5)
        return OnTheFlyOcclusion(64)(mesh)

    expected = first(BALL)
    assert torch.equal(first(trimesh.Trimesh(BALL.vertices, BALL.faces, process=False)), expected)
    data = SimpleNamespace(pos=torch.tensor(BALL.vertices), face=torch.tensor(BALL.faces.T.copy()).long(), y=3)
    before = copy.copy(data)
    after = first(data)
    assert torch.equal(after.pos, expected)
    assert (after.face, after.y, type(after)) == (None, 3, SimpleNamespace)
    assert data.pos is before.pos, "the one given stays"
    assert data.face is before.face


class Meshes(torch.utils.data.Dataset):  # type: ignore[misc]  # torch is not typed here
    """As a user would write it: a mesh and its label, through a transform."""

    def __init__(self, transform: Any) -> None:
        self.transform = transform

    def __len__(self) -> int:
        return 12

    def __getitem__(self, index: int) -> Any:
        return self.transform(sphere(6 + index % 3)), n_threads()


def test_in_a_spawned_worker() -> None:
    occlude = OnTheFlyOcclusion(128)
    loader = torch.utils.data.DataLoader(
        Meshes(occlude), batch_size=3, num_workers=1, multiprocessing_context="spawn", timeout=500
    )
    batches = [clouds for clouds, threads in loader if (threads == 1).all()]
    assert len(batches) == 4, "a worker has one thread"
    assert all(clouds.shape == (3, 128, 3) for clouds in batches)
    assert len({cloud.numpy().tobytes() for clouds in batches for cloud in clouds}) == 12


def test_in_forked_workers() -> None:
    """In an interpreter of its own, which has not used threads before it forks, and then has."""
    program = (
        "import torch; from tests.datasets.torch.test_occlusion import Meshes, OnTheFlyOcclusion\n"
        "meshes = Meshes(OnTheFlyOcclusion(128))\n"
        "loader = torch.utils.data.DataLoader(meshes, batch_size=3, num_workers=2,\n"
        "                                     multiprocessing_context='fork', timeout=500)\n"
        "batches = [clouds for clouds, _ in loader]\n"
        "for i in range(3): meshes[i]  # clouds are in store now: workers must not all hand out the same\n"
        "batches += [clouds for clouds, _ in loader]\n"
        "assert all(clouds.shape == (3, 128, 3) for clouds in batches)\n"
        "assert len({cloud.numpy().tobytes() for clouds in batches for cloud in clouds}) == 24, 'no eye twice'\n"
    )
    root = Path(__file__).parents[3]
    child = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=False)
    assert child.returncode == 0, child.stderr


def test_meshes_are_kept_prepared_within_the_memory_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    from zbuf_occlude.datasets.torch import on_the_fly

    prepared: list[int] = []

    def counting(mesh: Mesh, *arguments: Any, **options: Any) -> Any:
        prepared.append(len(mesh.faces))
        return prepare(mesh, *arguments, **options)

    monkeypatch.setattr(on_the_fly, "prepare", counting)
    occlude = OnTheFlyOcclusion(16, cache_megabytes=0.5)
    small, other, large = sphere(6), sphere(7), sphere(16)  # 120, 168 and 960 faces
    for mesh in (small, other, small, sphere(6), other):
        occlude(mesh)
    assert prepared == [120, 168], "known by content"
    occlude(large)
    occlude(small)
    assert prepared == [120, 168, 960, 120]
    assert pickle.loads(pickle.dumps(occlude))._subjects == {}


@anywhere
def test_where_little_is_visible_points_are_found_all_the_same(device: str | None) -> None:
    """A hollow box of many inner walls shows less than a tenth of its surface."""
    shells = [BALL.transformed(0.05 * i) for i in range(4, 21)]
    corners = np.concatenate([shell.corners for shell in shells]).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3))
    cloud = OnTheFlyOcclusion(300, scale="mesh", device=device)(mesh).numpy()
    assert len(np.unique(cloud, axis=0)) == 300
    assert np.linalg.norm(cloud, axis=1).min() > 0.97, "all of them on the outermost shell"


def test_a_mesh_never_seen_is_an_error() -> None:
    """A flat square seen edge on from everywhere on its horizon, by a method that removes everything."""
    occlude = OnTheFlyOcclusion(16)
    subject = occlude._subject(BALL.vertices, BALL.faces, BALL)

    class Blind:
        def visible(self, points: Any, eyes: Any) -> Any:
            return np.zeros((len(eyes), len(points)), dtype=bool)

    subject.occluder = Blind()  # type: ignore[assignment]
    with pytest.raises(MeshError, match="a mesh must be seen from somewhere"):
        occlude(BALL)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "exact_gl"}, "method must need no GL to run in DataLoader workers; 'exact_gl' does. Take 'exact'"),
        ({"method": "magic"}, "method must be one of"),
        ({"method_options": {"colour": 3}}, "must be given one of its options"),
        ({"n_points": 0}, "n_points must be a positive int; got 0"),
        ({"n_points": "many"}, "n_points must be a positive int; got 'many'"),
        ({"distance": "far"}, "distance must be a positive number; got 'far'"),
        ({"cache_megabytes": True}, "cache_megabytes must be a number from 0; got True"),
        ({"attributes": "normals"}, "attributes must be a sequence of words; got 'normals'"),
        ({"method_options": "n=1"}, "method_options must be a mapping; got 'n=1'"),
        ({"elevation": (0.5, 91)}, "elevations must run upwards within -90..90"),
        ({"device": "cpu", "method": "exact"}, "on a device must have method 'warp'; got 'exact'"),
        ({"device": "cpu", "attributes": ("colors",)}, "on a device must have no colors"),
        ({"device": "cpu", "method_options": {"contact": 5}}, "contact must lie in"),
        ({"device": "cpu", "method_options": {"device": "cuda"}}, "device must be said once"),
        ({"device": "nowhere"}, "device must be one that PyTorch finds here; got 'nowhere'"),
        ({"scale": "sphere"}, "scale must be one of cloud, metres, mesh; got 'sphere'"),
    ],
)
def test_errors(options: dict[str, Any], message: str) -> None:
    with pytest.raises((OptionError, ArgumentError), match=message):
        OnTheFlyOcclusion(**options)


def test_a_cloud_is_no_mesh() -> None:
    with pytest.raises(ArgumentError, match="a mesh must have vertices and faces, or pos and face; got Tensor"):
        OnTheFlyOcclusion()(torch.zeros(5, 3))


@anywhere
@pytest.mark.parametrize("face", [None, torch.eye(3).to_sparse()])
def test_data_without_faces(face: Any, device: str | None) -> None:
    with pytest.raises(ArgumentError, match=r"faces? must be"):
        OnTheFlyOcclusion(8, device=device)(SimpleNamespace(pos=torch.eye(3), face=face))


@needs_warp
def test_on_a_device_a_mesh_is_known_by_its_memory() -> None:
    """Meshes of the same address, version and shape, and each other's height."""
    occlude = OnTheFlyOcclusion(64, scale="mesh", device="cpu")
    face = torch.tensor([[0, 0, 1], [1, 2, 2], [2, 1, 3]])
    data = SimpleNamespace(pos=torch.tensor([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 5]]), face=face)
    assert occlude(data).pos[:, 2].max() > 0.0
    occlude(SimpleNamespace(pos=data.pos, face=face.T))
    data.pos = data.pos[:]
    occlude(data)
    assert len(occlude._subjects) == 2, "other strides are another mesh, and a new view is none"
    data.pos.data = data.pos.data + 100.0
    assert occlude(data).pos.min() >= 100.0
    with torch.inference_mode():
        data.pos = data.pos.clone()
        for height in (100.0, 200.0):
            assert occlude(data).pos[:, 2].min() >= height
            data.pos += 100.0


@needs_warp
def test_an_eye_that_sees_too_little_repeats_points_and_one_that_sees_nothing_has_anothers_cloud() -> None:
    occlude = OnTheFlyOcclusion(64, scale="mesh", device="cpu", eyes_per_sampling=3)
    occlude(BALL)
    (subject,) = occlude._subjects.values()
    visible = subject._mesh.visible  # type: ignore[attr-defined]
    seen: list[Any] = []

    def few(points: Any, own: Any, eyes: Any, contact: float) -> Any:
        mask = visible(points, own, eyes, contact)
        mask[0], mask[1, 5:] = False, False
        seen.append(points[mask[1]].float())
        return mask

    subject._mesh.visible = few  # type: ignore[attr-defined]
    subject.forget_clouds()
    third, second, first = (occlude(BALL) for _ in range(3))
    assert set(map(tuple, second.tolist())) == set(map(tuple, seen[0].tolist()))
    assert torch.equal(first, third)
    subject._mesh.visible = lambda points, own, eyes, contact: torch.zeros(3, len(points), dtype=torch.bool)  # type: ignore[attr-defined]
    assert occlude(BALL).isnan().all()
    with pytest.raises(MeshError, match="must have faces of some area"):
        occlude(Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))


def test_clouds_on_the_fly_have_normals_and_colours() -> None:
    """A ball whose colour is its normal: of what an eye sees both are known from the positions."""
    colors = SurfaceColors((WHITE,), np.zeros(len(BALL.faces), np.int32), BALL.vertices[BALL.faces] / 2 + 0.5)
    ball = Mesh(BALL.vertices, BALL.faces, colors=colors)
    cloud = OnTheFlyOcclusion(400, scale="mesh", attributes=("colors", "normals"))(ball).numpy()
    assert cloud.shape == (400, 9)
    outwards = (cloud[:, :3] * cloud[:, 3:6]).sum(axis=1)
    assert outwards.min() > 0.95, "towards the eye is outwards here"
    np.testing.assert_allclose(cloud[:, 6:], cloud[:, :3] / 2 + 0.5, atol=0.01)
    data = SimpleNamespace(pos=torch.tensor(BALL.vertices), face=torch.tensor(BALL.faces.T))
    found = OnTheFlyOcclusion(50, attributes=("colors",))(data)
    assert (found.pos.shape, found.color.shape) == ((50, 3), (50, 3))
    assert torch.allclose(found.color, torch.tensor(GREY / 255))
    with pytest.raises(OptionError, match="attribute must be one of normals, colors; got 'rgb'"):
        OnTheFlyOcclusion(50, attributes=("rgb",))


def test_a_mesh_too_far_from_the_origin_for_float32_is_refused() -> None:
    far = Mesh(BALL.vertices + 1e6, BALL.faces)
    with pytest.raises(ArgumentError, match=r"must suit float32; their coordinates reach 100000\d"):
        OnTheFlyOcclusion(64, scale="mesh")(far)
    for config in ({"scale": "metres"}, {"scale": "mesh", "frame": "camera"}):
        cloud = OnTheFlyOcclusion(64, **config)(far).numpy().astype(float)  # type: ignore[arg-type]
        assert len(np.unique(cloud, axis=0)) == 64

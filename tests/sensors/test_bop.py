"""`write_bop` against projection by hand and first hits of the whole scene; Pillow and json read what it wrote."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

pytest.importorskip("PIL", reason="Pillow is not installed: pip install 'zbuf-occlude[report]'")

from PIL import Image

import zbuf_occlude as zo
from tests.scenes import box, sphere
from zbuf_occlude.datasets.generate import generate
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.meshes.collection import MeshCollection, MeshEntry
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.kinds import plate_mesh

WIDTH, HEIGHT = 96, 64
SCENE = Scene.joined(
    [
        Placed(box(), "crate", moved(yaw=np.degrees(0.4), to=(0.0, 0.0, 0.5))),
        Placed(box(), "crate", moved(yaw=np.degrees(1.1), to=(1.3, 0.2, 0.5))),
        Placed(plate_mesh(3.0), "ground"),
        Placed(box(), "bin", moved(scale=(1.0, 1.0, 0.5), to=(-0.2, 2.2, 0.25))),
    ]
)
VIEWS = zo.views.parse("ring:3@20").around(np.zeros(3), 1.1)


def pixels(path: Path) -> Any:
    return np.asarray(Image.open(path))


def dataset(folder: Path, views: str, scan: ScanConfig, meshes: dict[str, Callable[[], zo.Mesh]]) -> dict[str, Any]:
    """Generate the views of some classes of one mesh each; return the manifest."""
    config = DatasetConfig(
        method="exact", views=views, scan=scan, sample_size=None, scale="mesh", attributes=("normals",)
    )
    entries = [MeshEntry(f"a/{label}.off", label, "train", mesh) for label, mesh in meshes.items()]
    return generate(Plan(MeshCollection(entries), config, "bop"), folder)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bop")
    names = zo.write_bop(folder, [SCENE, SCENE], VIEWS, width=WIDTH, height=HEIGHT, fov=45)
    assert len(names) == len(set(names))
    assert set(names) == {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    return folder


def test_each_pixel_is_of_what_is_met_first(written: Path) -> None:
    found = list(zo.frames(SCENE, VIEWS, width=WIDTH, height=HEIGHT, fov=45))
    place = written / "train" / "000001"
    scales = json.loads((place / "scene_camera.json").read_text())
    for view, frame in enumerate(found):
        visible = [pixels(place / "mask_visib" / f"{view:06d}_{row:06d}.png") > 0 for row in range(3)]
        whole = [pixels(place / "mask" / f"{view:06d}_{row:06d}.png") > 0 for row in range(3)]
        for row, instance in enumerate((0, 1, 3)):
            assert (visible[row] == (frame.instances == instance)).all()
            assert not (visible[row] & ~whole[row]).any()
        assert (np.sum(visible, axis=0) + (frame.instances == 2) == frame.mask).all()
        scale = scales[str(view)]["depth_scale"]
        depth = pixels(place / "depth" / f"{view:06d}.png") * scale
        assert np.abs(depth - 1000 * np.where(frame.mask, frame.depth, 0)).max() <= scale / 2 + 1e-3
        assert pixels(place / "rgb" / f"{view:06d}.png").shape == (HEIGHT, WIDTH, 3)


def test_models_in_their_poses_lie_on_their_masks(written: Path) -> None:
    """A box is convex: its silhouette is the hull of its corners, which BOP's own formula projects."""
    place = written / "train" / "000000"
    cameras, poses, counts = (
        json.loads((place / f"scene_{name}.json").read_text()) for name in ("camera", "gt", "gt_info")
    )
    second = json.loads((written / "train" / "000001" / "scene_gt.json").read_text())
    for found in (poses["0"], second["2"]):
        assert [each["obj_id"] for each in found] == [1, 1, 2], "crates are one model, the bin is flatter"
    outside = 0
    for view in range(3):
        matrix = np.reshape(cameras[str(view)]["cam_K"], (3, 3))
        for row, pose in enumerate(poses[str(view)]):
            corners = trimesh.load(written / "models" / f"obj_{pose['obj_id']:06d}.ply", process=False).vertices
            at = corners @ np.reshape(pose["cam_R_m2c"], (3, 3)).T + pose["cam_t_m2c"]
            x, y = ((at @ matrix.T)[:, :2] / at[:, 2:]).T
            info = counts[str(view)][row]
            if info["px_count_visib"] == 0:
                assert info["bbox_obj"] == [-1, -1, -1, -1]
                continue
            left, top, width, height = info["bbox_obj"]
            assert 0 <= left - x.min() <= 1.001
            assert 0 <= top - y.min() <= 1.001
            assert 0 <= x.max() - left - width <= 1.001
            assert 0 <= y.max() - top - height <= 1.001
            outside += left < 0 or top < 0 or left + width >= WIDTH or top + height >= HEIGHT
            mask, visible = (pixels(place / name / f"{view:06d}_{row:06d}.png") > 0 for name in ("mask", "mask_visib"))
            assert info["px_count_valid"] == mask.sum()
            assert info["px_count_visib"] == visible.sum()
            assert info["px_count_all"] >= mask.sum()
            assert info["visib_fract"] == visible.sum() / info["px_count_all"]
    assert outside, "one at least is cut by the picture's border"


def test_models_info(written: Path) -> None:
    info = json.loads((written / "models" / "models_info.json").read_text())
    assert list(info) == list("12")
    assert info["1"]["diameter"] == pytest.approx(1000 * np.sqrt(3))
    assert [info["2"][f"size_{axis}"] for axis in "xyz"] == [1000, 1000, 500]
    assert [info["2"][f"min_{axis}"] for axis in "xyz"] == [-500, -500, -250]
    for name in info:
        vertices = trimesh.load(written / "models" / f"obj_{int(name):06d}.ply", process=False).vertices
        apart = np.linalg.norm(vertices[:, None] - vertices, axis=2).max()
        assert info[name]["diameter"] == pytest.approx(apart, abs=1e-3)
        assert np.allclose(vertices.min(axis=0), -vertices.max(axis=0), atol=1e-3)
    camera = json.loads((written / "camera.json").read_text())
    assert (camera["width"], camera["height"]) == (WIDTH, HEIGHT)
    assert camera["cx"] == WIDTH / 2 - 0.5


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        ((Scene.joined([Placed(plate_mesh(1.0), "ground")]), VIEWS), {}, "beside the background"),
        (([], VIEWS), {}, "views must be one"),
        (([SCENE], [VIEWS, VIEWS]), {}, "got 2 for 1"),
        ((SCENE, VIEWS.select(np.zeros(0, dtype=int))), {}, "must have at least one view"),
        ((SCENE, VIEWS), {"split": "a/b"}, "split must be"),
        ((SCENE, VIEWS), {"split": "a\0b"}, "split must be"),
        ((SCENE, VIEWS), {"split": None}, "split must be"),
        ((SCENE, VIEWS), {"width": 0}, "width"),
    ],
)
def test_what_cannot_be_written(tmp_path: Path, arguments: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(zo.OccludeError, match=words):
        zo.write_bop(tmp_path / "bop", *arguments, **options)
    assert not (tmp_path / "bop").exists()


def test_older_output_is_not_mixed_with_new(tmp_path: Path) -> None:
    """Two scenes before, one now: the second would stay, with numbers of other models."""
    zo.write_bop(tmp_path, [SCENE, SCENE], VIEWS, width=16, height=12)
    before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
    for split in ("train", "test"):
        with pytest.raises(zo.ArgumentError, match=r"must be new.*models"):
            zo.write_bop(tmp_path, SCENE, VIEWS, width=16, height=12, split=split)
    assert {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")} == before


def test_background_is_marked_or_named(tmp_path: Path) -> None:
    """With no labels of background an object called wall has a model, and a marked one has none."""
    scene = Scene.joined([Placed(box(), "wall"), Placed(sphere(4), "pole", moved(to=(3, 0, 0)), is_background=True)])
    names = zo.write_bop(tmp_path, scene, VIEWS, width=16, height=12, background=())
    assert [name for name in names if name.startswith("models/obj")] == ["models/obj_000001.ply"]
    assert len(trimesh.load(tmp_path / "models/obj_000001.ply").faces) == 12


def test_a_flat_object_has_a_diameter(tmp_path: Path) -> None:
    scene = Scene.joined([Placed(plate_mesh(0.5), "sheet")])
    zo.write_bop(tmp_path, scene, VIEWS, width=32, height=32, background=())
    info = json.loads((tmp_path / "models" / "models_info.json").read_text())
    assert info["1"]["diameter"] == pytest.approx(1000 * np.sqrt(2))


@pytest.mark.needs("open3d")
def test_a_dataset_of_rooms_has_what_its_models_show(tmp_path: Path) -> None:
    """Open3D's rays to the models in their poses: the nearest is whose each pixel is; the same mesh is one model."""
    import open3d as o3d

    sensor = zo.sensors.make("pinhole", width=WIDTH, height=HEIGHT, fov=60)
    scan = ScanConfig(sensor, size={"chest": 0.9, "lamp": 0.7}, scene="room", keep="all", range=(2.0, 3.0))
    manifest = dataset(tmp_path, "ring:3@15", scan, {"chest": lambda: box((0.4, 0.5, 0.8)), "lamp": lambda: sphere(8)})
    assert manifest["counts"]["clouds"] == 6
    n_models, n_objects = len(json.loads((tmp_path / "models" / "models_info.json").read_text())), 0
    for place in sorted((tmp_path / "train").iterdir()):
        cameras, poses = (json.loads((place / f"scene_{name}.json").read_text()) for name in ("camera", "gt"))
        for view, of_view in poses.items():
            scene, camera = o3d.t.geometry.RaycastingScene(), np.reshape(cameras[view]["cam_K"], (3, 3))
            for each in of_view:
                model = trimesh.load(tmp_path / "models" / f"obj_{each['obj_id']:06d}.ply", process=False)
                at = model.vertices @ np.reshape(each["cam_R_m2c"], (3, 3)).T + each["cam_t_m2c"]
                scene.add_triangles(np.float32(at), np.uint32(model.faces))
            y, x = np.mgrid[:HEIGHT, :WIDTH]
            rays = np.zeros((HEIGHT, WIDTH, 6), np.float32)
            rays[..., 3:] = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(camera).T
            found = scene.cast_rays(rays)["geometry_ids"].numpy().astype(np.int64)
            masks = [pixels(place / "mask_visib" / f"{int(view):06d}_{row:06d}.png") > 0 for row in range(len(of_view))]
            assert np.mean([((found == row) != mask).mean() for row, mask in enumerate(masks)]) < 1e-3
            assert masks[0].any(), "the target is seen"
            n_objects += len(of_view)
    assert n_models < n_objects / 3, "chests and lamps stand in every room"


def test_a_sensor_is_noisy_in_the_depth_alone(tmp_path: Path) -> None:
    """Masks are the silhouettes of the camera without fault, in every file; depth has lost pixels and a step."""
    sensor = zo.sensors.make("realsense-d435", width=WIDTH, height=HEIGHT, fov=45, match_window=1)
    zo.write_bop(tmp_path / "noisy", SCENE, VIEWS, sensor=sensor, unit=0.001)
    zo.write_bop(tmp_path / "exact", SCENE, VIEWS, width=WIDTH, height=HEIGHT, fov=45)
    for path in (tmp_path / "exact").rglob("*.png"):
        found, exact = pixels(tmp_path / "noisy" / path.relative_to(tmp_path / "exact")), pixels(path)
        if path.parent.name != "depth":
            assert (found == exact).all(), path
            continue
        assert ((found > 0) & (exact == 0)).sum() == 0
        assert 0 < ((found == 0) & (exact > 0)).sum() < 0.5 * (exact > 0).sum()
    cameras = json.loads((tmp_path / "noisy" / "train" / "000000" / "scene_camera.json").read_text())
    assert [each["depth_scale"] for each in cameras.values()] == [1.0] * 3, "one unit of all images, a millimetre"


def test_noise_is_in_the_depth_alone(tmp_path: Path) -> None:
    """Of an object that nothing hides all is visible, also where the sensor has no return."""
    scan = ScanConfig(zo.sensors.make("kinect-v1"), size={"crate": 0.6}, keep="all", range=(1.5, 1.5))
    dataset(tmp_path, "ring:1@15", scan, {"crate": box})
    place = tmp_path / "train" / "000000"
    (info,) = json.loads((place / "scene_gt_info.json").read_text())["0"]
    depth, mask = pixels(place / "depth" / "000000.png"), pixels(place / "mask_visib" / "000000_000000.png") > 0
    assert info["visib_fract"] == 1.0
    assert info["px_count_visib"] == mask.sum() == info["px_count_all"]
    assert info["px_count_valid"] == (mask & (depth > 0)).sum() < mask.sum()
    assert (pixels(place / "rgb" / "000000.png").any(axis=2) == mask).all()

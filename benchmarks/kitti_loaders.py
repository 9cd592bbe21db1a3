"""Published loaders of KITTI, unmodified, on `--format kitti`: their boxes against the points that the scans know.

    python benchmarks/kitti_loaders.py FOLDER [--meshes N] [--keep FOLDER]

FOLDER holds checkouts of kuixu/kitti_object_vis and open-mmlab/OpenPCDet: OWNER+NAME, OWNER/NAME or NAME. What is not
there is skipped, and said. They need `pip install opencv-python-headless scikit-image easydict SharedArray`. Nothing of
them is compiled: OpenPCDet's one function of C++ is repeated in NumPy, other compiled modules are stubs.

The script generates streets as `hdf5` with boxes, which knows whose each point is, and converts them to `kitti`.

in the box     points of an object that lie in the box that the loader reads, 1 mm of slack, without noise
apart, beyond  corners that the loader projects, from those by a formula here; windows, outside of these corners
counts         boxes whose `num_points_in_gt` is the count here, in world space (OpenPCDet)

Exit status 1 if a point lies outside, corners or windows are 0.1 pixels off, or a count differs.
"""

import pickle
import subprocess
import sys
import tempfile
import types
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from common import heads, row, run
from numpy.typing import NDArray
from published_loaders import Stub, find_checkout

Array = NDArray[Any]
SPLITS = ("train", "val")
SLACK, ROUNDED, MARGIN = 1e-3, 1e-4, 1e-2
"""Metres: by which points may lie outside; by which they may lie on either side; of OpenPCDet's points_in_boxes_cpu."""
NOT_NEEDED = ("av2", "pyquaternion", "torchvision", "spconv", "nuscenes", "pcdet.version", "pcdet.datasets.argo2")


class StubOthers(MetaPathFinder, Loader):
    """Makes stubs of modules that have nothing to do with KITTI, and of compiled ones."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Return a spec of a stub."""
        wanted = name.endswith("_cuda") or any(f"{name}.".startswith(f"{each}.") for each in NOT_NEEDED)
        return ModuleSpec(name, self, is_package=True) if wanted else None

    def create_module(self, spec: ModuleSpec) -> types.ModuleType:
        """Return the stub."""
        module: Any = Stub(spec.name)
        module.__version__ = "0"
        module.points_in_boxes_cpu = points_in_boxes
        return module

    def exec_module(self, module: types.ModuleType) -> None:
        """Do nothing."""


def points_in_boxes(boxes: Any, points: Any, found: Any) -> None:
    """Fill in which points lie in which boxes (x, y, z, length, width, height, heading), as OpenPCDet's C++ does."""
    for number, (x, y, z, length, width, height, heading) in enumerate(boxes.numpy().astype(float)):
        local = points.numpy().astype(float) - [x, y, z]
        along = local[:, 0] * np.cos(heading) + local[:, 1] * np.sin(heading)
        across = local[:, 1] * np.cos(heading) - local[:, 0] * np.sin(heading)
        inside = (abs(along) < length / 2 + MARGIN) & (abs(across) < width / 2 + MARGIN)
        found[number] = found.new_tensor(inside & (abs(local[:, 2]) <= height / 2))


def read_kitti_object_vis(checkout: Path, data: Path) -> list[dict[str, Any]]:
    """Frames of training, by kitti_object and kitti_util."""
    import kitti_object
    import kitti_util

    frames, dataset = [], kitti_object.kitti_object(str(data))
    for number in range(len(list((data / "training/velodyne").iterdir()))):
        calibration = dataset.get_calibration(number)
        objects = [each for each in dataset.get_label_objects(number) if each.type != "DontCare"]
        assert dataset.get_image(number).shape == (375, 1242, 3)
        projected, corners = zip(*(kitti_util.compute_box_3d(each, calibration.P) for each in objects), strict=True)
        frames.append(
            {
                "corners": np.array(corners),
                "projected": list(projected),
                "windows": np.array([each.box2d for each in objects]),
                "points": calibration.project_velo_to_rect(dataset.get_lidar(number)[:, :3]),
            }
        )
    return frames


def read_openpcdet(checkout: Path, data: Path) -> list[dict[str, Any]]:
    """Frames of train and val, by `create_kitti_infos`; and items of KittiDataset, of which the boxes are the same."""
    import yaml
    from easydict import EasyDict
    from pcdet.datasets.kitti import kitti_dataset
    from pcdet.utils import box_utils

    settings = EasyDict(yaml.safe_load((checkout / "tools/cfgs/dataset_configs/kitti_dataset.yaml").read_text()))
    settings.DATA_PROCESSOR = settings.DATA_PROCESSOR[:1]  # voxels need spconv
    classes = ["Car", "Van", "Misc"]
    kitti_dataset.Path = Path  # its own `__main__` imports it, and its functions count on that
    kitti_dataset.create_kitti_infos(settings, classes, data, data)
    frames = []
    for split in SPLITS:
        infos = pickle.loads((data / f"kitti_infos_{split}.pkl").read_bytes())
        dataset = kitti_dataset.KittiDataset(settings, classes, training=False, root_path=data)
        dataset.set_split(split)
        dataset.kitti_infos = infos
        for number, info in enumerate(infos):
            notes, calibration = info["annos"], dataset.get_calib(info["point_cloud"]["lidar_idx"])
            boxes = notes["gt_boxes_lidar"][notes["name"] != "DontCare"]
            corners = box_utils.boxes_to_corners_3d(boxes.astype(np.float32))
            item = dataset[number]
            low, high = np.array(settings.POINT_CLOUD_RANGE).reshape(2, 3)
            assert ((item["points"][:, :2] >= low[:2]) & (item["points"][:, :2] <= high[:2])).all()
            frames.append(
                {
                    "corners": np.array([calibration.lidar_to_rect(each) for each in np.asarray(corners)]),
                    "counts": notes["num_points_in_gt"][: len(boxes)],
                    "points": calibration.lidar_to_rect(dataset.get_lidar(info["point_cloud"]["lidar_idx"])[:, :3]),
                }
            )
    return frames


READERS = {"kuixu/kitti_object_vis": read_kitti_object_vis, "open-mmlab/OpenPCDet": read_openpcdet}


def truth_of(stored: Path) -> list[dict[str, Array]]:
    """Return what the hdf5 dataset has of each frame, in order: points, whose they are, and boxes, in world space."""
    frames = []
    for split in SPLITS:
        names = [f"ply_data_{split}{number}.h5" for number in range(len(list(stored.glob(f"ply_data_{split}*"))))]
        for name in names:
            with h5py.File(stored / name) as h5:
                for row, (begin, end) in enumerate(pairwise(h5["offsets"][:])):
                    of_points = {name: h5[name][begin:end] for name in ("data", "instance")}
                    frames.append(of_points | {"boxes": h5["boxes"][row]})
    return frames


def check(found: list[dict[str, Any]], truth: list[dict[str, Array]]) -> tuple[str, bool]:
    """Compare what a loader read with the dataset of which it was made."""
    n_boxes = n_points = n_outside = n_counted = n_equal = 0
    apart = beyond = 0.0
    for frame, true in zip(found, truth, strict=True):
        points = frame["points"].astype(float)  # of float32 even the mean is rounded by more than a millimetre
        instances = instances_of(points, frame["corners"], true)
        pixels = projected(points)
        seen = (points[:, 2] >= 0) & (pixels >= 0).all(axis=1) & (pixels < [1242, 375]).all(axis=1)
        for number, (corners, instance) in enumerate(zip(frame["corners"], instances, strict=True)):
            n_boxes += 1
            edges = corners[[1, 3, 4]] - corners[0]
            lengths = np.linalg.norm(edges, axis=1)
            outside = np.abs((points - corners.mean(axis=0)) @ (edges.T / lengths)) - lengths / 2
            mine = outside[true["instance"] == instance]
            n_points, n_outside = n_points + len(mine), n_outside + int((mine > SLACK).any(axis=1).sum())
            if "counts" in frame:
                outside = outside_in_world(true["data"], true["boxes"][instance])
                least, most = (((outside <= slack).all(axis=1) & seen).sum() for slack in (-ROUNDED, ROUNDED))
                n_counted, n_equal = n_counted + 1, n_equal + int(least <= frame["counts"][number] <= most)
            if "projected" in frame and frame["projected"][number] is not None:
                places, window = projected(corners), frame["windows"][number]
                apart = max(apart, float(np.abs(places - frame["projected"][number]).max()))
                low, high = (np.clip(end(axis=0), 0, [1241, 374]) for end in (places.min, places.max))
                beyond = max(beyond, float(np.max([low - window[:2], window[2:] - high])))
    text = f"{n_boxes} boxes; {n_outside} of {n_points} points outside"
    text += f"; corners {apart:.3f} pixels apart, windows {beyond:.3f} beyond" if "projected" in found[0] else ""
    text += f"; {n_equal} of {n_counted} counts equal" if n_counted else ""
    return text, bool(n_boxes) and not n_outside and max(apart, beyond) < 0.1 and n_equal == n_counted


def projected(points: Array) -> Array:
    """Return pixels (n, 2) of points before the camera, KITTI's numbers."""
    with np.errstate(divide="ignore"):
        return np.asarray(721.5377 * points[:, :2] / points[:, 2:] + [609.5593, 172.854])


def instances_of(points: Array, corners: Array, true: dict[str, Array]) -> list[int]:
    """Return whose each box is, by the motion that takes the world's points to the camera's (Kabsch)."""
    middles = true["data"].astype(float).mean(axis=0), points.mean(axis=0)
    u, _, vt = np.linalg.svd((true["data"] - middles[0]).T @ (points - middles[1]))
    centres = (true["boxes"]["centre"] - middles[0]) @ (u @ vt) + middles[1]
    centres[~true["boxes"]["sides"].any(axis=1)] = np.inf
    away = np.linalg.norm(corners.mean(axis=1)[:, None] - centres, axis=2)
    if away.min(axis=1).max() > SLACK:
        raise ValueError("a box lies where no object is")
    return list(away.argmin(axis=1))


def outside_in_world(points: Array, box: Any) -> Array:
    """Return how far (n, 3) points lie beyond the sides of a box of the hdf5 dataset."""
    cos, sin = np.cos(box["yaw"]), np.sin(box["yaw"])
    x, y, z = (points - box["centre"]).T
    return np.asarray(np.abs(np.stack([x * cos + y * sin, y * cos - x * sin, z], axis=1)) - box["sides"] / 2)


def make(root: Path, n_meshes: int) -> None:
    """Generate streets, as `stored` and as `kitti`."""
    generate = "generate --format hdf5 --sensor hdl-64e --set-sensor noise=0 --scene street --keep all --with boxes "
    generate += "--range 6..40 --views ring:4@0 --sample-size all --scale mesh --classes car,chair "
    generate += f"--limit {n_meshes} --out {root}/stored"
    for words in (generate, f"convert {root}/stored --format kitti --out {root}/kitti"):
        subprocess.run([sys.executable, "-m", "zbuf_occlude", *words.split()], check=True, capture_output=True)


def main(folder: Path, *, meshes: int = 12, keep: Path | None = None) -> int:
    checkouts = {repository: find_checkout(folder, repository) for repository in READERS}
    right = True
    with tempfile.TemporaryDirectory() as place:
        root = (keep or Path(place)).resolve()
        if any(checkouts.values()):
            make(root, meshes)
        heads("repository", "commit", "frames", "checks", words=4)
        for repository, checkout in checkouts.items():
            if checkout is None:
                row(repository, "", "", "skipped: no checkout")
                continue
            truth, out = truth_of(root / "stored"), root / f"{repository.split('/')[1]}.pickle"
            command = [sys.executable, __file__, "--child", repository, checkout[0], root / "kitti", out]
            done = subprocess.run([*map(str, command)], capture_output=True, text=True)
            if done.returncode:
                text, fine = f"the loader stopped: {done.stderr.strip().splitlines()[-1]}", False
            else:
                text, fine = check(pickle.loads(out.read_bytes()), truth)
            right = right and fine
            row(repository, checkout[1], len(truth), text)
    return 0 if right else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        place, data, out = map(Path, sys.argv[3:])
        sys.meta_path.insert(0, StubOthers())
        sys.path.insert(0, str(place))
        out.write_bytes(pickle.dumps(READERS[sys.argv[2]](place, data)))
    else:
        run(main, __doc__)

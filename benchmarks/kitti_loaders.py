"""Published loaders of KITTI, unmodified, on `--format kitti`: their boxes against the points that the scans know.

    python benchmarks/kitti_loaders.py FOLDER [--meshes N] [--keep FOLDER]

FOLDER holds checkouts of kuixu/kitti_object_vis and open-mmlab/OpenPCDet: OWNER+NAME, OWNER/NAME or NAME. What is not
there is skipped, and said. They need `pip install opencv-python-headless scikit-image easydict SharedArray`. Nothing of
them is compiled: OpenPCDet's one function of C++ is repeated in NumPy, other compiled modules are stubs.

The script generates streets as `hdf5` with boxes, which knows whose each point is, and converts them to `kitti`.

in the box     points of an object that lie in the box that the loader reads, 1 mm of slack, without noise
apart          of the corners that the loader projects from those by a formula here; of its windows from the corners'
counts         boxes whose `num_points_in_gt` is the count here, in world space (OpenPCDet)

Exit status 1 if a point lies outside, corners are 0.1 pixels apart, or a count differs.
"""

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
import types
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from published_loaders import Stub, find_checkout

Array = NDArray[Any]
SPLITS = ("train", "val")
SLACK, MARGIN = 1e-3, 1e-2
"""Metres: of float32; of OpenPCDet's points_in_boxes_cpu, across the box."""
NOT_NEEDED = ("av2", "pyquaternion", "torchvision", "spconv", "nuscenes", "pcdet.version", "pcdet.datasets.argo2")


class Found(dict[str, Any]):
    """What a loader read of a frame: `types`, `corners` (n, 8, 3) and `points` of the camera; more by loader."""


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
    for row, (x, y, z, length, width, height, heading) in enumerate(boxes.numpy().astype(float)):
        local = points.numpy().astype(float) - [x, y, z]
        along = local[:, 0] * np.cos(heading) + local[:, 1] * np.sin(heading)
        across = local[:, 1] * np.cos(heading) - local[:, 0] * np.sin(heading)
        inside = (abs(along) < length / 2 + MARGIN) & (abs(across) < width / 2 + MARGIN)
        found[row] = found.new_tensor(inside & (abs(local[:, 2]) <= height / 2))


def read_kitti_object_vis(checkout: Path, data: Path) -> list[Found]:
    """Frames of training, by kitti_object and kitti_util."""
    import kitti_object
    import kitti_util

    frames, dataset = [], kitti_object.kitti_object(str(data))
    for number in range(len(list((data / "training/velodyne").iterdir()))):
        calibration, objects = dataset.get_calibration(number), dataset.get_label_objects(number)
        assert dataset.get_image(number).shape == (375, 1242, 3)
        projected, corners = zip(*(kitti_util.compute_box_3d(each, calibration.P) for each in objects), strict=True)
        frames.append(
            Found(
                types=[each.type for each in objects],
                corners=np.array(corners),
                projected=list(projected),
                windows=np.array([each.box2d for each in objects]),
                truncated=np.array([each.truncation for each in objects]),
                points=calibration.project_velo_to_rect(dataset.get_lidar(number)[:, :3]),
            )
        )
    return frames


def read_openpcdet(checkout: Path, data: Path) -> list[Found]:
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
                Found(
                    types=notes["name"].tolist(),
                    corners=np.array([calibration.lidar_to_rect(each) for each in np.asarray(corners)]),
                    counts=notes["num_points_in_gt"],
                    points=calibration.lidar_to_rect(dataset.get_lidar(info["point_cloud"]["lidar_idx"])[:, :3]),
                )
            )
    return frames


READERS = {"kuixu/kitti_object_vis": read_kitti_object_vis, "open-mmlab/OpenPCDet": read_openpcdet}


def truth_of(stored: Path) -> list[dict[str, Any]]:
    """Return what the hdf5 dataset has of each frame, in order."""
    frames = []
    for split in SPLITS:
        for path in sorted(stored.glob(f"ply_data_{split}*.h5"), key=lambda path: int(path.stem[len("ply_data_" + split) :])):
            with h5py.File(path) as h5:
                ends = h5["offsets"][:]
                for row, (begin, end) in enumerate(zip(ends, ends[1:], strict=False)):
                    frames.append(
                        {name: h5[name][begin:end] for name in ("data", "instance")} | {"boxes": h5["boxes"][row]}
                    )
    return frames


def local(points: Array, corners: Array) -> Array:
    """Return coordinates (n, 3) of points in a box (8, 3), from -1 to 1 within it, in metres beyond its sides."""
    centre = corners.mean(axis=0)
    # whatever the order of the corners: three edges from the first one, at right angles
    edges = corners[1:] - corners[0]
    edges = edges[np.argsort(np.linalg.norm(edges, axis=1))]
    chosen: list[Array] = []
    for edge in edges:
        if all(abs(edge @ other) < 1e-3 * np.linalg.norm(edge) * np.linalg.norm(other) for other in chosen):
            chosen.append(edge)
    halves = np.array([np.linalg.norm(edge) / 2 for edge in chosen[:3]])
    axes = np.array([edge / np.linalg.norm(edge) for edge in chosen[:3]])
    return np.abs((points - centre) @ axes.T) - halves


def check(found: list[Found], truth: list[dict[str, Any]]) -> tuple[str, bool]:
    """Compare what a loader read with the dataset of which it was made."""
    n_boxes = n_points = n_outside = n_counted = n_equal = 0
    apart = window = 0.0
    for frame, true in zip(found, truth, strict=True):
        assert len(frame["points"]) == len(true["data"])
        for row, kind in enumerate(frame["types"]):
            if kind == "DontCare":
                continue
            n_boxes += 1
            inside = local(frame["points"], frame["corners"][row])
            middle = frame["corners"][row].mean(axis=0)
            instance = nearest(middle, true, frame["points"])
            mine = inside[true["instance"] == instance]
            n_points += len(mine)
            n_outside += int((mine > SLACK).any(axis=1).sum())
            if "counts" in frame:
                x, y = 721.5377 * frame["points"][:, :2].T / frame["points"][:, 2] + [[609.5593], [172.854]]
                seen = (frame["points"][:, 2] >= 0) & (x >= 0) & (x < 1242) & (y >= 0) & (y < 375)
                least, most = (int(((world(true, instance) <= slack).all(axis=1) & seen).sum()) for slack in (-1e-4, 1e-4))
                n_counted += 1
                n_equal += least <= frame["counts"][row] <= most
            if frame.get("projected") and frame["projected"][row] is not None:
                corners = frame["corners"][row]
                pixels = 721.5377 * corners[:, :2] / corners[:, 2:] + [609.5593, 172.854]
                apart = max(apart, float(np.abs(pixels - frame["projected"][row]).max()))
                left, top, right, bottom = frame["windows"][row]
                hull = np.clip([*pixels.min(axis=0), *pixels.max(axis=0)], 0, [1241, 374] * 2)
                window = max(window, *(hull[:2] - [left, top]), *([right, bottom] - hull[2:]))
    text = f"{n_boxes} boxes; {n_outside} of {n_points} points outside"
    text += f"; corners {apart:.3f}, windows {window:.2f} pixels beyond" if apart or window else ""
    text += f"; {n_equal} of {n_counted} counts equal" if n_counted else ""
    return text, bool(n_boxes) and not n_outside and apart < 0.1 and window < 1.0 and n_equal == n_counted


def nearest(middle: Array, true: dict[str, Any], points: Array) -> int:
    """Return the instance whose box lies there, by the motion that takes the world's points to the camera's."""
    source, target = true["data"] - true["data"].mean(axis=0), points - points.mean(axis=0)
    u, _, vt = np.linalg.svd(source.T.astype(float) @ target)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    centres = (true["boxes"]["centre"] - true["data"].mean(axis=0)) @ turn + points.mean(axis=0)
    away = np.linalg.norm(centres - middle, axis=1)
    away[~true["boxes"]["sides"].any(axis=1)] = np.inf
    assert away.min() < 1e-2
    return int(away.argmin())


def world(true: dict[str, Any], instance: int) -> Array:
    """Return how far the points lie beyond the sides of an object's box, in world space."""
    box = true["boxes"][instance]
    cos, sin = np.cos(box["yaw"]), np.sin(box["yaw"])
    x, y, z = (true["data"] - box["centre"]).T
    return np.abs(np.stack([x * cos + y * sin, y * cos - x * sin, z], axis=1)) - box["sides"] / 2


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("folder", type=Path, help="of checkouts")
    parser.add_argument("--meshes", type=int, default=8, help="of the built-in cars, four frames each")
    parser.add_argument("--keep", type=Path, help="make the datasets here, and leave them")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        root = (arguments.keep or Path(place)).resolve()
        command = ["generate", "--format", "hdf5", "--sensor", "hdl-64e", "--scene", "street", "--keep", "all"]
        command += ["--range", "6..40", "--views", "ring:4@0", "--sample-size", "all", "--scale", "mesh"]
        command += ["--with", "boxes", "--classes", "car,chair", "--set-sensor", "noise=0", "--out", root / "stored"]
        for words in ([*command, "--limit", arguments.meshes], ["convert", root / "stored", "--format", "kitti", "--out", root / "kitti"]):
            subprocess.run([sys.executable, "-m", "zbuf_occlude", *map(str, words)], check=True, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        print("| repository | commit | frames | checks |\n|" + " --- |" * 4)
        truth, right = truth_of(root / "stored"), True
        for repository in READERS:
            checkout = find_checkout(arguments.folder, repository)
            if checkout is None:
                print(f"| {repository} | | | skipped: no checkout |")
                continue
            out = root / f"{repository.split('/')[1]}.pickle"
            words = [__file__, "--child", repository, checkout[0], root / "kitti", out]
            done = subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True)
            if done.returncode:
                text, fine = f"the loader stopped: {done.stderr.strip().splitlines()[-1]}", False
            else:
                text, fine = check(found := pickle.loads(out.read_bytes()), truth)
            right &= fine
            print(f"| {repository} | {checkout[1]} | {len(truth)} | {text} |", flush=True)
    return 0 if right else 1


if __name__ == "__main__":
    if sys.argv[1:2] == ["--child"]:
        place, data, out = map(Path, sys.argv[3:])
        sys.meta_path.insert(0, StubOthers())
        sys.path.insert(0, str(place))
        os.chdir(place)
        found = [dict(each) for each in READERS[sys.argv[2]](place, data)]
        out.write_bytes(pickle.dumps(found))
    else:
        sys.exit(main())

"""nuscenes-devkit, unmodified, on a sequence of `zbuf-occlude drive --format nuscenes`: clouds, boxes, several sweeps.

    python benchmarks/nuscenes_devkit.py DATASET

DATASET is the folder of a drive with one scene. Runs where nuscenes-devkit is installed, and needs this package not.

boxes      points in the boxes of their key frame, by the devkit's `points_in_box`, and by the annotations
sweeps     points of ten sweeps of all LiDARs, joined by `from_file_multisweep`; height of the lowest ones above the
           ground: the 1st and the 50th percentile of those below 0.2 m

Exit status 1 where the two counts differ by more than 1 %, or the ground is 5 cm off.
"""

import sys

import numpy as np
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.data_classes import LidarPointCloud
from nuscenes.utils.geometry_utils import points_in_box
from pyquaternion import Quaternion

OFF, GROUND = 0.01, 0.05


def in_car(nusc, token):
    """Return the points (3, n) of a LiDAR's data in the car's frame, and the car's row."""
    path, _, _ = nusc.get_sample_data(token)
    data = nusc.get("sample_data", token)
    mount = nusc.get("calibrated_sensor", data["calibrated_sensor_token"])
    cloud = LidarPointCloud.from_file(path)
    cloud.rotate(Quaternion(mount["rotation"]).rotation_matrix)
    cloud.translate(np.array(mount["translation"]))
    return cloud.points[:3], nusc.get("ego_pose", data["ego_pose_token"])


def main(dataroot):
    """Read, count, and say it."""
    nusc = NuScenes("v1.0-mini", dataroot, verbose=False)
    (scene,) = nusc.scene
    inside = counted = n_boxes = n_samples = 0
    sample = nusc.get("sample", scene["first_sample_token"])
    while True:
        n_samples += 1
        points = []
        for token in sample["data"].values():
            local, car = in_car(nusc, token)
            world = Quaternion(car["rotation"]).rotation_matrix @ local + np.array(car["translation"])[:, None]
            points.append(world)
        for name in sample["anns"]:
            row = nusc.get("sample_annotation", name)
            inside += int(points_in_box(nusc.get_box(name), np.hstack(points)).sum())
            counted += row["num_lidar_pts"]
            n_boxes += 1
        if not sample["next"]:
            break
        sample = nusc.get("sample", sample["next"])
    merged, first = [], nusc.get("sample", scene["last_sample_token"])
    for channel in first["data"]:
        cloud, _ = LidarPointCloud.from_file_multisweep(nusc, first, channel, "LIDAR_TOP", nsweeps=10, min_distance=0.0)
        merged.append(cloud.points[:3])
    mount = nusc.get(
        "calibrated_sensor", nusc.get("sample_data", first["data"]["LIDAR_TOP"])["calibrated_sensor_token"]
    )
    together = Quaternion(mount["rotation"]).rotation_matrix @ np.hstack(merged)
    heights = together[2] + mount["translation"][2]
    low, middle = np.percentile(heights[heights < 0.2], (1, 50))
    channels = ", ".join(first["data"])
    print(f"{scene['nbr_samples']} key frames ({n_samples} by their links), {n_boxes} boxes, channels {channels}")
    print(f"boxes: {inside} points, {counted} by the annotations")
    print(f"sweeps: {together.shape[1]} points, ground at {low:+.3f} and {middle:+.3f} m")
    return int(n_samples != scene["nbr_samples"] or abs(inside - counted) > OFF * counted or abs(middle) > GROUND)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))

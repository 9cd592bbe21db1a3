"""Write a real range scan of the Stanford bunny as a depth image in a folder of BOP, for `zbuf-occlude compare-scans`.

    python benchmarks/bunny_depth_image.py SCANS OUT [--scan bun000]

SCANS has bun_zipper.ply, bun.conf and the scans. The camera stands where the scanner's laser starts, (0, 0.178, 1.3) in
the frame of the scan, and looks along -z; a pixel has the nearest real point in it. What the scanner could not measure,
because its camera saw no laser there, is empty. Lengths are millimetres, as BOP has them.
"""

import json
from pathlib import Path

import numpy as np
from common import run
from PIL import Image

import zbuf_occlude as zo
from zbuf_occlude.datasets.cloud_files import read_points
from zbuf_occlude.geometry.camera import rotations_of

PLACE = np.array([0.0, 0.178, 1.3])
"""Place of the camera in the frame of the scan, metres."""
TO_CAMERA = np.diag([1.0, -1.0, -1.0])
"""Rotation from the frame of the scan, y up, to the camera's: x right, y down, z forward."""
FOCAL, SIDE = 1500.0, 400
"""Focal length and sides of the image, pixels: 0.9 mm a pixel at the object, whose points are 0.5 mm apart."""
STEP = 0.1
"""Step of the depth image, millimetres."""


def main(scans: Path, out: Path, *, scan: str = "bun000") -> None:
    to_mesh = pose_of(scans / "bun.conf", scan)
    image = depth_image(read_points(scans / f"{scan}.ply"))
    folder, models = out / "train" / "000000", out / "models"
    (folder / "depth").mkdir(parents=True)
    models.mkdir()
    Image.fromarray(image).save(folder / "depth" / "000000.png")
    middle = SIDE / 2 - 0.5
    camera = {"cam_K": [FOCAL, 0.0, middle, 0.0, FOCAL, middle, 0.0, 0.0, 1.0], "depth_scale": STEP}
    rotation = TO_CAMERA @ to_mesh[:3, :3].T
    place = -rotation @ to_mesh[:3, 3] - TO_CAMERA @ PLACE
    pose = {"obj_id": 1, "cam_R_m2c": rotation.ravel().tolist(), "cam_t_m2c": (1000.0 * place).tolist()}
    mesh = zo.load_mesh(scans / "bun_zipper.ply")
    mesh.transformed(1000.0).to_trimesh().export(models / "obj_000001.ply")
    for path, document in (
        (folder / "scene_camera.json", {"0": camera}),
        (folder / "scene_gt.json", {"0": [pose]}),
        (models / "models_info.json", {"1": {"diameter": 1000.0 * mesh.diagonal}}),
    ):
        path.write_text(json.dumps(document))
    print(f"{np.count_nonzero(image):,} pixels of {scan} have a depth: {folder}")


def pose_of(path: Path, scan: str) -> np.ndarray:
    """Return the pose (4, 4), scan to mesh, of a line ``bmesh SCAN.ply tx ty tz qx qy qz qw`` of bun.conf."""
    line = next(words for words in map(str.split, path.read_text().splitlines()) if words[1:2] == [f"{scan}.ply"])
    x, y, z, qx, qy, qz, qw = map(float, line[2:])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotations_of(np.array([qx, qy, qz, -qw])), (x, y, z)  # turns the other way round
    return pose


def depth_image(points: np.ndarray) -> np.ndarray:
    """Return the depth (rows, columns) of the nearest point in each pixel, uint16 steps; 0 where there is none."""
    x, y, z = ((points - PLACE) @ TO_CAMERA.T).T
    columns, rows = (np.floor(FOCAL * each / z + SIDE / 2).astype(int) for each in (x, y))
    inside = (columns >= 0) & (columns < SIDE) & (rows >= 0) & (rows < SIDE)
    depths = np.full((SIDE, SIDE), np.inf)
    np.minimum.at(depths, (rows[inside], columns[inside]), z[inside])
    return np.where(np.isfinite(depths), np.rint(1000.0 / STEP * depths), 0.0).astype(np.uint16)


if __name__ == "__main__":
    run(main, __doc__)

"""benchmarks/bunny_depth_image.py: a range scan of a turned object becomes a BOP folder that `compare_scans` reads."""

import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from trimesh.creation import icosphere

import zbuf_occlude as zo
from zbuf_occlude.base.point_files import write_ply
from zbuf_occlude.sensors import look_at

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import bunny_depth_image


@pytest.mark.needs("open3d")
def test_a_scan_becomes_a_depth_image_in_its_place(tmp_path: Path) -> None:
    """A stretched ball, turned by 50 degrees about y and moved: the pose in bun.conf leads from its scan to it."""
    body = icosphere(subdivisions=4, radius=0.05)
    mesh = zo.Mesh(body.vertices * [1.5, 1.0, 0.6] + [0.01, 0.11, 0.02], body.faces)
    angle = np.radians(50.0)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    of_scan = zo.Mesh((mesh.vertices - [0.02, 0.0, -0.01]) @ turn, mesh.faces)  # mesh = turn @ scan + shift
    camera = zo.sensors.make("pinhole:width=300,height=300,fov=9", noise=0)
    points = zo.scan(of_scan, camera, look_at(bunny_depth_image.PLACE, [0.0, 0.178, 0.0], [0, 1, 0])).points
    assert len(points) > 2000
    scans, out = tmp_path / "scans", tmp_path / "out"
    scans.mkdir()
    write_ply(scans / "bun000.ply", points)
    mesh.to_trimesh().export(scans / "bun_zipper.ply")
    quaternion = f"0 {np.sin(angle / 2)} 0 {-np.cos(angle / 2)}"  # Stanford's turns the other way round
    (scans / "bun.conf").write_text(f"camera 0 0 0 0 0 0 1\nbmesh bun000.ply 0.02 0 -0.01 {quaternion}\n")
    bunny_depth_image.main(scans, out)
    folder = out / "train" / "000000"
    with Image.open(folder / "depth" / "000000.png") as image:
        depths = np.asarray(image)
    nearest = bunny_depth_image.PLACE[2] - of_scan.vertices[:, 2].max()
    assert nearest - 1e-4 < depths[depths > 0].min() / 1e4 < nearest + 1e-3
    poses = folder / "scene_gt.json"
    (found,) = zo.compare_scans(
        out / "models" / "obj_000001.ply", folder / "depth" / "000000.png", "pinhole", poses=poses
    )
    assert found.false_hidden < 1e-3
    assert abs(found.residual) < 2e-4
    assert found.agreement > 0.75

"""Hold the masks of a BOP dataset to Open3D's first hits, and what differs to the reference.

    zbuf-occlude generate MESHES --format bop --scene room --size 0.5 --range 2 --views ring:4@15 --out rooms
    python benchmarks/bop_masks.py rooms [--frames 200]

Read are the files alone: models, poses, intrinsics, pictures. Open3D casts a ray through each pixel's centre. Where the
object differs, the reference decides. BOP has no walls and no ground: pixels that these hide count against the masks.
"""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from common import Open3D, run
from PIL import Image

import zbuf_occlude as zo

OBJECT, MASK = "{0:06d}_{1:06d}.png", 128
COUNTS = ("frames", "objects", "pixels of objects", "pixels that differ", "decided for the masks", "decided for Open3D")
COUNTS += ("pixels in two mask_visib", "pixels of mask_visib outside mask")


def frame(folder: Path, image: int, models: dict[int, Any]) -> Counter[str]:
    """Compare one frame; return counts of pixels."""
    documents = {name: json.loads((folder / f"scene_{name}.json").read_text()) for name in ("camera", "gt")}
    placed, count = documents["gt"][str(image)], Counter[str]()
    names = [OBJECT.format(image, number) for number in range(len(placed))]
    visible, alone = (
        np.stack([np.asarray(Image.open(folder / kind / name)) >= MASK for name in names])
        for kind in ("mask_visib", "mask")
    )
    vertices, faces, instances, n = list[Any](), list[Any](), list[Any](), 0
    for number, each in enumerate(placed):
        mesh, rotation = models[each["obj_id"]], np.reshape(each["cam_R_m2c"], (3, 3))
        vertices.append(mesh.vertices @ rotation.T + each["cam_t_m2c"])
        faces.append(mesh.faces + n)
        instances.append(np.full(len(mesh.faces), number))
        n += len(mesh.vertices)
    scene = zo.Mesh(np.concatenate(vertices), np.concatenate(faces))
    instance_of = np.append(np.concatenate(instances), -1)
    height, width = visible.shape[1:]
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(height, dtype=float))
    pixels = np.stack([columns, rows, np.ones_like(rows)], axis=-1).reshape(-1, 3)
    rays = pixels @ np.linalg.inv(np.reshape(documents["camera"][str(image)]["cam_K"], (3, 3))).T
    caster = Open3D(scene)
    theirs = instance_of[caster.first(caster.rays(np.zeros((1, 3)), rays))]
    ours = np.where(visible.any(axis=0), visible.argmax(axis=0), -1).ravel()
    differ = np.flatnonzero(ours != theirs)
    if len(differ):
        with zo.prepare(scene, "oracle") as oracle:
            decided = instance_of[oracle.first_hits(np.zeros((1, 3)), rays[differ]).face_ids]
        count["decided for the masks"] += int((decided == ours[differ]).sum())
        count["decided for Open3D"] += int((decided == theirs[differ]).sum())
    count["pixels of objects"] += int((theirs >= 0).sum())
    count["pixels that differ"] += len(differ)
    count["pixels in two mask_visib"] += int((visible.sum(axis=0) > 1).sum())
    count["pixels of mask_visib outside mask"] += int((visible & ~alone).sum())
    count["frames"] += 1
    count["objects"] += len(placed)
    return count


def main(folder: Path, *, frames: int = 200) -> None:
    count = Counter[str]()
    models = {
        int(path.stem[4:]): trimesh.load(path, process=False) for path in sorted((folder / "models").glob("obj_*.ply"))
    }
    for path in sorted(folder.glob("*/*/scene_gt.json")):
        for image in map(int, json.loads(path.read_text())):
            if count["frames"] < frames:
                count += frame(path.parent, image, models)
    for name in COUNTS:
        print(f"{count[name]:>12,} {name}")


if __name__ == "__main__":
    run(main, __doc__)

"""Pairs for registration: two views of one object whose overlap lies in a range, as MVP's registration benchmark."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.errors import DatasetError, MeshError, OptionError
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.export import Exported, check_one_frame
from zbuf_occlude.datasets.formats import find_format
from zbuf_occlude.datasets.formats.hdf5 import new_h5
from zbuf_occlude.datasets.plan import DatasetConfig, Plan
from zbuf_occlude.datasets.records import draw_visible, object_transform
from zbuf_occlude.datasets.source import CloudReader, StoredSampling
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.sensors.capture import in_metres
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.visibility import prepare

TURN, SHIFT = np.pi / 4, 0.25
"""Maximum turn of most pairs, radians, and maximum shift of all pairs, units."""
UNRESTRICTED = 0.2
"""Share of the pairs that are turned by any angle."""
MATCHED = 0.5
"""From this overlap on, `match_level` is 1."""


class Pair(NamedTuple):
    """Two views of an object: indices, and the share of the first's visible surface that the second sees."""

    source: int
    target: int
    overlap: float


def export(source: CloudReader, out: Path) -> Exported:
    """Write MVP's layout of registration: MVP_Train_RG.h5, MVP_Test_RG.h5 (and MVP_Val_RG.h5), a row per pair.

    =======================  =================================================================================
    src, tgt                 (n, size, 3) float32, points that the one view sees, and the other; both in the object's
                             frame
    rotated_src, rotated_tgt the same, each moved: by pose_src, pose_tgt (n, 4, 4) float64
    transforms               (n, 4, 4) float64, takes rotated_src onto rotated_tgt
    overlap                  (n,) float32, share of src's visible surface that tgt's view sees
    match_id/0, 1, ...       (c, 2) int32, rows of src and tgt that are the same surface point
    match_level, rot_level   (n,) int32: 1 from an overlap of 0.5 on; 1 where `transforms` turns by 45 degrees or more
    cat_labels               (n,) int32
    mesh_id, variation, view_src, view_tgt        (n,) int32
    =======================  =================================================================================

    Both clouds are drawn independently from the same points of the surface. With a sensor each is a scan, with its
    noise, and `match_id` is empty. Overlaps are always of points of the surface: for scans, of those that the first
    camera or laser of the sensor sees from its places. Each object gives as many pairs as it has views. Their overlaps
    are drawn evenly over the range, by the seed, and the pair with the nearest overlap is taken, without repeats.
    Objects without a pair in the range are left out, and counted.

    References
    ----------
    paul007pl/MVP_Benchmark, registration/dataset.py, MVP_RG, and its README: rotations up to 45 degrees and any at 4:1.
    """
    plan, files, n_pairs, n_without = source.plan, dict[str, list[str]](), dict[str, int](), 0
    size, (low, high) = plan.config.equal_size, _range_of(plan.config)
    left_out = dict.fromkeys(source.ids()["mesh_id"].tolist(), f"no two views have an overlap of {low:g} to {high:g}")
    ids = source.ids()
    for split, numbers in source.order.items():
        name, n_pairs[split] = f"MVP_{split.capitalize()}_RG.h5", 0
        with new_h5(out / name) as h5:
            arrays = {
                field: h5.create_dataset(
                    field, (0, *shape), kind, maxshape=(None, *shape), chunks=(64, *shape), track_times=False
                )
                for field, (kind, shape) in _fields(size).items()
            }
            matches = h5.create_group("match_id")
            for mesh_id, variation in np.unique(ids[numbers][["mesh_id", "variation"]]).tolist():
                rows = list(_rows_of(source, mesh_id, variation))
                n_without += not rows
                if rows:
                    left_out.pop(mesh_id, None)
                first, n_pairs[split] = n_pairs[split], n_pairs[split] + len(rows)
                for field, array in arrays.items():
                    array.resize(n_pairs[split], axis=0)
                    if rows:
                        array[first:] = np.array([row[field] for row in rows])
                for number, row in enumerate(rows, first):
                    matches.create_dataset(str(number), data=row["match_id"], track_times=False)
        files[split] = [name]
    if not any(n_pairs.values()):
        raise DatasetError(
            f"at least one pair must have an overlap of {low:g} to {high:g}; none has. Choose more --views, nearer to "
            "each other, or another --overlap."
        )
    return Exported(files, n_pairs, {"objects_without_pairs": n_without}, left_out)


def _fields(size: int) -> dict[str, tuple[str, tuple[int, ...]]]:
    return {
        **dict.fromkeys(("src", "tgt", "rotated_src", "rotated_tgt"), ("<f4", (size, 3))),
        **dict.fromkeys(("pose_src", "pose_tgt", "transforms"), ("<f8", (4, 4))),
        "overlap": ("<f4", ()),
        **dict.fromkeys(("match_level", "rot_level", "cat_labels"), ("<i4", ())),
        **dict.fromkeys(("mesh_id", "variation", "view_src", "view_tgt"), ("<i4", ())),
    }


def _rows_of(source: CloudReader, mesh_id: int, variation: int) -> Iterator[dict[str, Any]]:
    """Yield the pairs of one sampling of an object, as the fields of a row."""
    assert source.block is not None  # it is read from the format packed
    plan, block = source.plan, source.block(mesh_id, variation)
    entry, config = plan.meshes[mesh_id], plan.config
    rng = np.random.default_rng(seed_of(config.seed, entry.key + "/pairs", variation))
    mask = block.mask if config.scan is None else _seen_by_places(entry, block, config.scan)
    positions = _placed(plan, block)
    seed = seed_of(config.seed, entry.key, variation, 0).generate_state(1, np.uint64)[0]
    clouds = dict[int, IntArray]()
    for pair in choose_pairs(mask, len(plan.views), _range_of(config), rng):
        for view in pair[:2]:
            if view not in clouds:
                clouds[view], _ = draw_visible(block.mask[view], config.equal_size, seed, view)
        drawn = [clouds[view] for view in pair[:2]]
        most = np.pi if rng.random() < UNRESTRICTED else TURN
        pose, _ = _motion(rng, np.pi)
        transform, turned = _motion(rng, most)
        poses = [pose, transform @ pose]
        _, *matched = np.intersect1d(drawn[0], drawn[1], return_indices=True)
        src, tgt = (positions[ids].astype(np.float32) for ids in drawn)
        moved = [positions[ids] @ each[:3, :3].T + each[:3, 3] for ids, each in zip(drawn, poses, strict=True)]
        yield {
            "src": src,
            "tgt": tgt,
            "rotated_src": moved[0],
            "rotated_tgt": moved[1],
            "pose_src": poses[0],
            "pose_tgt": poses[1],
            "transforms": transform,
            "overlap": pair.overlap,
            "match_id": np.stack(matched, axis=1).astype("<i4"),
            "match_level": pair.overlap >= MATCHED,
            "rot_level": turned >= TURN,
            "cat_labels": plan.classes.index(entry.label),
            "mesh_id": mesh_id,
            "variation": variation,
            "view_src": pair.source,
            "view_tgt": pair.target,
        }


def _seen_by_places(entry: MeshEntry, block: StoredSampling, scan: ScanConfig) -> BoolArray:
    """Return which points (n,) of an object's whole surface each of k places of the sensor sees; (k, n).

    A place whose scan has no return sees nothing. A mesh that cannot be loaded is a DatasetError.
    """
    try:
        mesh = entry.load()
    except MeshError as error:
        raise DatasetError(
            f"pairs of scans must be made from the meshes too. {error} Make them with `zbuf-occlude generate --format "
            "pairs`."
        ) from error
    standing, _ = in_metres(mesh, entry.label, scan)
    with prepare(standing, "exact") as occluder:
        seen: BoolArray = occluder.visible(block.whole, block.views.eyes)
    seen[~block.mask.any(axis=1)] = False
    return seen


def choose_pairs(mask: BoolArray, n_pairs: int, span: tuple[float, float], rng: np.random.Generator) -> list[Pair]:
    """Choose pairs of views by the overlap of what they see.

    Parameters
    ----------
    mask : (k, n) bool
        True where a view sees one of n points that are uniform over the surface.
    n_pairs : int
        Maximum number of pairs.
    span : (float, float)
        Least and greatest overlap.
    rng : Generator

    Returns
    -------
    list of Pair
        Pairs without repeats. Overlaps are drawn evenly over the span; each chooses the pair with the nearest overlap.
    """
    seen = mask.astype(np.float32)
    common = seen @ seen.T  # counts below 2^24 are exact
    overlaps = common / np.maximum(np.diag(common), 1.0)[:, None]
    np.fill_diagonal(overlaps, np.nan)
    sources, targets = np.nonzero((overlaps >= span[0]) & (overlaps <= span[1]))
    found = overlaps[sources, targets]
    wanted = span[0] + (span[1] - span[0]) * (rng.permutation(n_pairs) + rng.random(n_pairs)) / n_pairs
    chosen = list[Pair]()
    for overlap in wanted[: len(found)]:
        nearest = int(np.nanargmin(np.abs(found - overlap)))
        chosen.append(Pair(int(sources[nearest]), int(targets[nearest]), float(found[nearest])))
        found[nearest] = np.nan
    return chosen


def _placed(plan: Plan, block: StoredSampling) -> FloatArray:
    """Return the points of an object in the layout's frame."""
    whole = block.points if plan.config.scan is None else block.whole
    centre, factor = np.zeros(3), 1.0
    if plan.config.scale == "object":
        centre, factor = object_transform(whole, block.views, block.longest_side)
    axes = find_format(plan.format).to_frame(plan.config).astype(np.float64)
    return np.asarray((block.points.positions - centre) * factor @ axes.T)


def _motion(rng: np.random.Generator, most: float) -> tuple[NDArray[np.float64], float]:
    """Draw a rigid motion (4, 4): about any axis by an angle up to `most`, and any way up to `SHIFT`; and the angle."""
    axis, way = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    angle, (x, y, z) = rng.random() * most, axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    found = np.eye(4)
    found[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    found[:3, 3] = way * rng.random() * SHIFT
    return found, angle


def _range_of(config: DatasetConfig) -> tuple[float, float]:
    assert config.overlap is not None
    return config.overlap[0], config.overlap[1]


def check(plan: Plan) -> None:
    """Raise OptionError unless a plan has a range of overlaps, several views, and points on the surface."""
    config = plan.config
    if config.overlap is None:
        raise OptionError("pairs must have a range of overlaps; got none. Give --overlap A..B.")
    if len(plan.views) < 2:
        raise OptionError(f"pairs must be of 2 views of an object, at least; got {len(plan.views)}. See --views.")
    if config.scan is not None and config.scan.scene != "none":
        raise OptionError("pairs of scans must be of the object alone, whose overlap is known. Leave --scene out.")
    check_one_frame(plan)

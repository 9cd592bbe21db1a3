"""Records: the data of one cloud, drawn from the points that a view sees, in memory and as the arrays of a file.

With ``--sample-size all`` clouds are of unequal size. In memory a field that has a row per point is then of objects:
``records["data"][i]`` is (n_i, 3). In files the points of all clouds stand one after the other, and
``offsets`` (n + 1,) says where each cloud's begin and end.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray, IntArray
from zbuf_occlude.base.jit.compiler import njit
from zbuf_occlude.base.precompiler import Compilation
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.plan import BOXES, DatasetConfig
from zbuf_occlude.geometry.colors import GREY
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.sensors.boxes import BOX, HEIGHT, WIDTH
from zbuf_occlude.sensors.returns import SCAN_COLUMNS
from zbuf_occlude.views import Views, from_angles

Records = NDArray[Any]
Fields = dict[str, tuple[str, tuple[int, ...]]]
"""Type, and shape of a row, of fields that have a row per point."""

SCAN_FIELDS: Fields = {each.name: (each.record_dtype, each.shape) for each in SCAN_COLUMNS}
"""Fields of a scan's points: metres, radians, seconds; normals in the frame of the positions (docs/sensors.md)."""
ATTRIBUTE_FIELDS: dict[str, Fields] = {"normals": {"normal": ("<f4", (3,))}, "colors": {"color": ("|u1", (3,))}}
"""Fields of a point on a surface, by attribute."""
IDS = np.dtype([("mesh_id", "<i4"), ("variation", "<i4"), ("view_id", "<i4")])
"""Fields that identify a cloud."""
OFFSETS = "offsets"
ALL = -1
"""Size of clouds that keep every visible point."""


@dataclass(frozen=True, eq=False)
class ScanPoints(SurfacePoints):
    """The points of several scans one after the other, with the sensor's data of each; or all points of the target.

    Parameters
    ----------
    columns : mapping of name to (n, ...)
        Values of each point, as `SCAN_FIELDS`; none for the whole target.
    facts : mapping of name to (k,)
        Fields of each scan's record.
    """

    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    facts: Mapping[str, NDArray[Any]] = field(default_factory=dict)


def mask_of_scans(lengths: NDArray[np.intp]) -> BoolArray:
    """Return the mask (k, n) of the points of each of k scans that stand one after the other; `lengths` is (k,)."""
    scans = np.arange(len(lengths))
    return np.asarray(np.repeat(scans, lengths) == scans[:, None])


def record_type(config: DatasetConfig) -> np.dtype[Any]:
    """Return the type of a cloud's record; the fields become the datasets of the HDF5 file.

    data : (sample_size, 3) float32, ``(p - centre) * factor`` for the visible points p in the chosen frame
    label : (1,) int64, index into the sorted class names
    face_ids : (sample_size,) int32, the face each point lies on
    mesh_id, variation, view_id : int32
    view : (3,) float32, azimuth and elevation in radians, distance in world units
    pose : (4, 4) float64, world space to the camera's frame, with the configured axes
    centre : (3,) float64; factor : float64
    n_visible : int32, visible points before the subset was drawn
    visible_fraction : float32, of the object's points; of a scan what others do not hide of the object

    With attributes (`DatasetConfig.attributes`), a row per point,

    normal : float32, unit normal of the point's face in the frame of the positions, turned towards the camera, or as
        the face is wound where hidden points are kept too
    color : uint8, red, green and blue, sRGB

    Of scans (`DatasetConfig.scan`), positions are metres and the world's origin is the middle of the object's box;
    besides there are (unless complete) `SCAN_FIELDS`, a row per point, and

    size : float64, metres of the object's longest side
    hidden : float32, share of the object that others hide; hidden_reached : int32, 0 where it is not as asked for, else
    1

    With boxes,

    boxes : `BOX`, a row for each instance; rows of no object, and of ground and walls, are 0
    picture : (375, 1242) uint8, grey
    """
    scanned: list[tuple[Any, ...]] = [("size", "<f8"), ("hidden", "<f4"), ("hidden_reached", "<i4")]
    scanned = scanned if config.scan and not config.complete else []
    if BOXES in config.attributes and config.scan is not None:
        scanned += [("boxes", BOX, (config.scan.most_objects,)), ("picture", "|u1", (HEIGHT, WIDTH))]
    size = config.sample_size
    points: dict[str, tuple[Any, ...]] = {
        name: (name, object) if size is None else (name, kind, (size, *shape))
        for name, (kind, shape) in point_fields(config).items()
    }
    return np.dtype(
        [
            points.pop("data"),
            ("label", "<i8", (1,)),
            points.pop("face_ids"),
            *IDS.descr,
            ("view", "<f4", (3,)),
            ("pose", "<f8", (4, 4)),
            ("centre", "<f8", (3,)),
            ("factor", "<f8"),
            ("n_visible", "<i4"),
            ("visible_fraction", "<f4"),
            *points.values(),
            *scanned,
        ]
    )


def point_fields(config: DatasetConfig) -> Fields:
    """Return the fields of a record that have a row per point."""
    return {"data": ("<f4", (3,)), "face_ids": ("<i4", ()), **further_fields(config)}


def further_fields(config: DatasetConfig) -> Fields:
    """Return the fields of a record besides data and face_ids that have a row per point."""
    of_attributes = {name: row for each in config.attributes for name, row in ATTRIBUTE_FIELDS.get(each, {}).items()}
    if config.scan is None or config.complete:
        return of_attributes
    one_return = config.scan.sensor.noise_model.returns != "all"
    left_out = {"clean_range": not config.scan.keep_clean, "time": not config.scan.takes_time}
    left_out |= dict.fromkeys(("return_number", "share"), one_return)
    return {name: row for name, row in SCAN_FIELDS.items() if not left_out.get(name)} | of_attributes


def gather_clouds(
    points: SurfacePoints,
    mask: BoolArray,
    views: Views,
    longest_side: float,
    config: DatasetConfig,
    key: str,
    variation: int,
    *,
    which: ArrayLike | None = None,
) -> Records:
    """Return a record for every view that sees a point.

    Parameters
    ----------
    points : SurfacePoints
        n points of the object, world space.
    mask : (k, n) bool
        Visible points of each view.
    views : Views
        k views in world units.
    longest_side : float
        The object's, world units.
    config : DatasetConfig
    key : str
        The mesh's; decides the random subsets together with the seed, `variation` and the view.
    variation : int
    which : (m,) int, optional
        Indices of the views wanted, all of them seeing something; by default all that do.

    Returns
    -------
    (at most k,) records of `record_type`; label and mesh_id are left for the caller. The order of the points within a
    cloud is random, as loaders that take the first n expect; farthest points are in the order in which they were found.
    """
    seeing = np.flatnonzero(mask.any(axis=1)) if which is None else np.asarray(which)
    records = np.zeros(len(seeing), dtype=record_type(config))
    poses, in_camera_frame, upright = config.poses_of(views), config.frame == "camera", np.eye(4)
    in_scans = isinstance(points, ScanPoints) and not config.complete
    whole, factor = np.zeros(3), 1.0
    if config.scale == "object":
        whole, factor = object_transform(points, views, longest_side)
    centred, factor = config.scale in ("cloud", "metres"), np.nan if config.scale == "cloud" else factor
    size = ALL if config.sample_size is None else config.sample_size
    seed = seed_of(config.seed, key, variation, 0).generate_state(1, np.uint64)[0]
    records["variation"], records["view_id"], records["pose"] = variation, seeing, poses[seeing]
    with np.errstate(over="ignore"):  # beyond float32 a distance is infinite
        records["view"] = np.stack([views.azimuth, views.elevation, views.distance], axis=1)[seeing]
    data, face_ids = records["data"], records["face_ids"]
    centres, factors, n_visible = np.empty((len(records), 3)), np.empty(len(records)), np.empty(len(records), int)
    for row, view in enumerate(seeing.tolist()):
        frame, centres[row] = (poses[view], poses[view, :3, :3] @ whole) if in_camera_frame else (upright, whole)
        if in_camera_frame and config.scale == "object":
            centres[row] += poses[view, :3, 3]
        chosen, n_visible[row] = draw_visible(mask[view], size, seed, view)
        if config.subset == "fps" and 0 < size < n_visible[row]:
            visible, rng = np.flatnonzero(mask[view]), np.random.default_rng([int(seed), view])
            chosen = visible[farthest_points(points.positions[visible], size, rng)].astype(np.int32)
        if size == ALL:
            data[row], face_ids[row] = np.empty((len(chosen), 3), np.float32), np.empty(len(chosen), np.int32)
        filled = np.empty((len(chosen), 3)), data[row], face_ids[row]
        factors[row] = _place(points.positions, points.face_ids, chosen, frame, centred, centres[row], factor, *filled)
        if in_scans:
            _fill_scan(records[row], points, chosen, config, view, poses[view] if in_camera_frame else None)
        elif config.attributes:
            _fill_attributes(records[row], points.select(chosen), config, views.eyes[view], poses[view])
    records["centre"], records["factor"], records["n_visible"] = centres, factors, n_visible
    records["visible_fraction"] = 1.0 - records["hidden"] if in_scans else n_visible / len(points)
    return records


def object_transform(points: SurfacePoints, views: Views, longest_side: float) -> tuple[FloatArray, float]:
    """Return the centre of the object's box, which scans have at the origin, and the factor of a longest side of 1."""
    return np.zeros(3) if isinstance(points, ScanPoints) else np.asarray(views.target), 1.0 / longest_side


def stored_bounds(mesh: Mesh, distance: float, config: DatasetConfig) -> FloatArray:
    """Return a box (2, 3) with the coordinates of a mesh that are stored in float32, where they keep their unit.

    `distance` is that of the farthest camera. Clouds of scale "cloud" and "object" are about as large as 1.
    """
    place = np.zeros(3)
    if config.scale == "mesh":
        place = np.full(3, distance) if config.frame == "camera" else mesh.centre
    return np.asarray(mesh.bounds - mesh.centre + place)


def _fill_attributes(
    record: Any, points: SurfacePoints, config: DatasetConfig, eye: FloatArray, pose: FloatArray
) -> None:
    if "normals" in config.attributes:
        normals = points.normals if config.complete else points.normals_towards(eye)
        turned = normals @ pose[:3, :3].T if config.frame == "camera" else normals
        record["normal"] = turned.astype(np.float32)
    if "colors" in config.attributes:
        record["color"] = colors_of(points)


def _fill_scan(
    record: Any, points: Any, chosen: IntArray, config: DatasetConfig, view: int, pose: FloatArray | None
) -> None:
    for name, (kind, _) in further_fields(config).items():
        values = points.columns[name][chosen]
        record[name] = (values @ pose[:3, :3].T if name == "normal" and pose is not None else values).astype(kind)
    for name, values in points.facts.items():
        record[name] = values[view]


def colors_of(points: SurfacePoints) -> NDArray[np.uint8]:
    """Return the colours (n, 3) of points; grey where they have none."""
    return np.full((len(points), 3), GREY, np.uint8) if points.colors is None else points.colors


def object_positions(record: Any, pose: FloatArray, config: DatasetConfig) -> FloatArray:
    """Return the points (n, 3) of a record, seen with a `pose`, where they are on its mesh.

    Those of scans, and of complete clouds before a sensor, are on the mesh as it stands there.
    """
    positions = record["data"] / record["factor"] + record["centre"]
    return np.asarray((positions - pose[:3, 3]) @ pose[:3, :3] if config.frame == "camera" else positions)


def draw_points(visible: NDArray[np.intp], size: int | None, rng: np.random.Generator) -> NDArray[np.intp]:
    """Draw `size` of the visible points (None: all) in random order; some repeat only if there are fewer."""
    shuffled = rng.permutation(visible)
    if size is None or len(visible) >= size:
        return shuffled[:size]
    return rng.permutation(np.concatenate([shuffled, rng.choice(visible, size - len(visible))]))


def farthest_points(positions: FloatArray, size: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Return `size` of more positions (n, 3), each the farthest from all before it, the first at random.

    Costs size * n distances: 13 ms for 2,048 of 10,000.
    """
    chosen = np.full(size, rng.integers(len(positions)), dtype=np.intp)
    near_origin = np.ascontiguousarray((positions - positions.mean(axis=0)).T)
    _choose_farthest(*near_origin, np.full(len(positions), np.inf), chosen)
    return chosen


def unit_box_transform(positions: FloatArray) -> tuple[FloatArray, float]:
    """Return the centre of the bounding box and the factor that makes its longest side 1 (1 for a single place)."""
    columns = np.ascontiguousarray(positions.T)  # along which minima are found a dozen times as fast
    low, high = columns.min(axis=1), columns.max(axis=1)
    longest = float((high - low).max())
    return (low + high) / 2.0, 1.0 / longest if longest > 0 else 1.0


def to_arrays(records: Records, config: DatasetConfig) -> dict[str, NDArray[Any]]:
    """Return the arrays that a file holds: a field each; of ragged clouds all points in a row, and `OFFSETS`.

    The arrays are views of the records, so no memory is used twice.
    """
    fields = {name: records[name] for name in records.dtype.names or ()}
    if config.sample_size is not None:
        return fields
    for name, (kind, shape) in point_fields(config).items():
        fields[name] = np.concatenate([np.empty((0, *shape), kind), *records[name]]).astype(kind, copy=False)
    return {**fields, OFFSETS: np.cumsum([0, *map(len, records["data"])], dtype=np.int64)}


def read_rows(arrays: Any, rows: ArrayLike, config: DatasetConfig) -> Records:
    """Return the records of some rows of what `to_arrays` returned, in NumPy's arrays or HDF5's.

    Offsets that do not fit the points are a ValueError.
    """
    chosen, points = np.asarray(rows), point_fields(config)
    ascending, back = np.unique(chosen, return_inverse=True)  # as h5py wants them
    records: Records = np.empty(len(ascending), record_type(config))
    if config.sample_size is not None:
        in_a_row = len(ascending) > 0 and ascending[-1] - ascending[0] + 1 == len(ascending)
        wanted = slice(ascending[0], ascending[-1] + 1) if in_a_row else ascending  # h5py reads a slice at once
        for name in records.dtype.names or ():
            records[name] = arrays[name][wanted]
        return records if np.array_equal(chosen, ascending) else records[back]
    offsets = np.asarray(arrays[OFFSETS])
    if len(offsets) != len(arrays["label"]) + 1 or (np.diff(offsets) < 1).any() or offsets[-1] > len(arrays["data"]):
        raise ValueError("offsets do not fit the points")
    for name in records.dtype.names or ():
        if name not in points:
            records[name] = arrays[name][ascending]
            continue
        for row, number in enumerate(ascending):
            records[name][row] = np.array(arrays[name][offsets[number] : offsets[number + 1]], points[name][0])
    return records[back]


def read_archive(file: Any, config: DatasetConfig) -> Records:
    """Return the records in a NumPy archive of what `to_arrays` returned."""
    with np.load(file) as archive:
        arrays = {name: archive[name] for name in archive.files}  # each access by name reads the array
        return read_rows(arrays, np.arange(len(arrays["label"])), config)


def pad_or_truncate(positions: NDArray[Any], n_points: int) -> NDArray[Any]:
    """Return `n_points` points of a cloud, whose order is random: the first ones, or all, padded with repeats."""
    return np.asarray(positions[np.arange(n_points) % len(positions)])


def draw_visible(mask: BoolArray, size: int, seed: np.uint64, view: int) -> tuple[IntArray, int]:
    """Draw `size` (or `ALL`) of the points (n,) that a view sees, in random order; they repeat where there are fewer.

    Views of one seed have sequences of their own. Returns the indices (size,), and how many are visible.

    References
    ----------
    Fisher and Yates's shuffle, ended when there are enough; numbers by SplitMix64 (Steele, Lea, Flood: Fast splittable
    pseudorandom number generators, OOPSLA 2014, doi:10.1145/2660193.2660195), brought into a range without bias as
    in Lemire: Fast random integer generation in an interval, 2019, doi:10.1145/3230636.
    """
    chosen = np.empty(len(mask) if size == ALL else size, dtype=np.int32)
    n_visible = _draw(mask, size == ALL, seed, view, np.empty(len(mask) + 1, dtype=np.int32), chosen)
    return chosen[:n_visible] if size == ALL else chosen, n_visible


def _compile() -> None:
    """Compile what draws and places the points of a cloud, by a cloud of one point."""
    point, seen = SurfacePoints.free(np.zeros((1, 3))), np.ones((1, 1), dtype=bool)
    gather_clouds(point, seen, from_angles(0.0, 0.0), 1.0, DatasetConfig(), "", 0)


@njit(cache=True, nogil=True)
def _draw(mask: Any, whole: Any, seed: Any, view: Any, visible: Any, chosen: Any) -> Any:
    """List what is visible, and shuffle the first places, as many as are chosen; return how many are visible.

    One place more of the list is written to than there are points.
    """
    n_visible = 0
    for i in range(len(mask)):
        visible[n_visible] = i
        n_visible += mask[i]
    state, size = _mixed(seed ^ _mixed(np.uint64(view) + np.uint64(1))), n_visible if whole else len(chosen)
    n_once = min(size, n_visible)
    for i in range(n_once):
        state, j = _below(state, n_visible - i)
        visible[i], visible[i + j] = visible[i + j], visible[i]
        chosen[i] = visible[i]
    for i in range(n_once, size):
        state, j = _below(state, n_visible)
        chosen[i] = visible[j]
    if n_once < size:  # else the repeated points would come last
        for i in range(size):
            state, j = _below(state, size - i)
            chosen[i], chosen[i + j] = chosen[i + j], chosen[i]
    return n_visible


@njit(cache=True, nogil=True)
def _choose_farthest(x: Any, y: Any, z: Any, squared: Any, chosen: Any) -> None:
    """Fill `chosen` after its first place; `squared` (n,), infinite at first, becomes the distances from the chosen."""
    for place in range(1, len(chosen)):
        last = chosen[place - 1]
        for i in range(len(x)):
            dx, dy, dz = x[i] - x[last], y[i] - y[last], z[i] - z[last]
            squared[i] = min(squared[i], dx * dx + dy * dy + dz * dz)
        farthest = 0
        for i in range(len(x)):
            if squared[i] > squared[farthest]:
                farthest = i
        chosen[place] = farthest


@njit(cache=True, nogil=True)
def _place(
    positions: Any,
    face_ids: Any,
    chosen: Any,
    frame: Any,
    centred: Any,
    centre: Any,
    factor: Any,
    turned: Any,
    data: Any,
    faces: Any,
) -> Any:
    """Place the chosen points (m,) in a cloud: fill `data` with ``(p - centre) * factor``, and `faces`; return factor.

    `frame` (4, 4) leads from world space to the cloud's axes. With `centred`, `centre` is filled with that of the
    cloud's own box. Where `factor` is NaN, the longest side of that box becomes 1. `turned` (m, 3) is overwritten.
    """
    low_x = low_y = low_z = np.inf
    high_x = high_y = high_z = -np.inf
    for i in range(len(chosen)):
        p = positions[chosen[i]]
        x, y, z = _turned(frame[0], p), _turned(frame[1], p), _turned(frame[2], p)
        low_x, low_y, low_z = min(x, low_x), min(y, low_y), min(z, low_z)
        high_x, high_y, high_z = max(x, high_x), max(y, high_y), max(z, high_z)
        turned[i, 0], turned[i, 1], turned[i, 2] = x, y, z
        faces[i] = face_ids[chosen[i]]
    if centred:
        centre[0], centre[1], centre[2] = (low_x + high_x) / 2.0, (low_y + high_y) / 2.0, (low_z + high_z) / 2.0
    if np.isnan(factor):
        longest = max(high_x - low_x, high_y - low_y, high_z - low_z)
        factor = 1.0 / longest if longest > 0.0 else 1.0
    for i in range(len(chosen)):
        for axis in range(3):
            data[i, axis] = (turned[i, axis] - centre[axis]) * factor
    return factor


@njit(inline="always")
def _turned(row: Any, p: Any) -> Any:
    return row[0] * p[0] + row[1] * p[1] + row[2] * p[2] + row[3]


@njit(inline="always")
def _mixed(z: Any) -> Any:
    """SplitMix64's finish: a permutation of the numbers of 64 bits that leaves no trace of their order."""
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(inline="always")
def _below(state: Any, n: Any) -> Any:
    """Return the next state, and a number from 0 to n - 1, all equally likely; n is less than 2^32."""
    n = np.uint64(n)
    low_bits = np.uint64(0xFFFFFFFF)
    state += np.uint64(0x9E3779B97F4A7C15)
    product = (_mixed(state) >> np.uint64(32)) * n
    if (product & low_bits) < n:
        least = (np.uint64(1 << 32) - n) % n
        while (product & low_bits) < least:
            state += np.uint64(0x9E3779B97F4A7C15)
            product = (_mixed(state) >> np.uint64(32)) * n
    return state, np.int64(product >> np.uint64(32))


DRAWING = Compilation(_draw, _compile)
"""Compilation of what draws the points of clouds."""

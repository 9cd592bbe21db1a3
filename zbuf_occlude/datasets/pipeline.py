"""The flow for one mesh: surface points -> views -> visibility mask; or places of a sensor -> first hits."""

import logging
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.arrays import BoolArray, FloatArray
from zbuf_occlude.base.provenance import seed_of
from zbuf_occlude.datasets.counts import FEW, QualityCounts, WorstView
from zbuf_occlude.datasets.plan import BOXES, DatasetConfig, Plan
from zbuf_occlude.datasets.records import ScanPoints, further_fields, mask_of_scans
from zbuf_occlude.geometry.colors import GREY, Bytes, barycentric
from zbuf_occlude.geometry.far_faces import far_faces
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.sampling import SurfacePoints, curve_order, sample_surface
from zbuf_occlude.sensors.boxes import BOX, as_label, boxes_of
from zbuf_occlude.sensors.capture import Capture, Seeds, captured_scenes, captures, in_metres, n_raised, sensor_views
from zbuf_occlude.sensors.casting import cast, prepare_scene
from zbuf_occlude.sensors.emptiness import why_empty
from zbuf_occlude.sensors.returns import SCAN_COLUMNS, Scan
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.scene import Scene
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import prepare
from zbuf_occlude.visibility.interface import CONTACT, contact_advice

CHECKED_POINTS = 64
"""Minimum number of checked points of a checked view, where it has as many."""

MAX_TESTS = 1_000_000_000
"""Maximum of checked pairs times faces for one sampling: about a second of the oracle's time."""

CHECKED_SCANS = 4
"""Maximum number of checked scans of a variation; fewer where there are many meshes (`Plan.n_checked`)."""


IN_ONE_PLACE = "all points that it sees are in one place"
"""Reason for leaving out a cloud that would be the origin alone when centred and scaled."""

SCAN_ARRAYS = {each.name: each.attribute for each in SCAN_COLUMNS}
"""Attribute of a `Scan` for each field of a record that has a row per point, except colours."""

_LOG = logging.getLogger(__name__)


class Sampling(NamedTuple):
    """One sampling of a mesh, and the points that each view sees."""

    points: SurfacePoints  # n points; for scans those of all views, one after the other
    mask: BoolArray  # (k, n): points that each view sees
    views: Views  # k, world units
    longest_side: float  # of the object, world units
    counts: QualityCounts  # of its clouds, and of answers checked by the oracle
    renderer: str  # "none" without OpenGL
    blank: Mapping[int, str] = MappingProxyType({})  # reasons by view without a cloud


def samplings(plan: Plan, mesh: Mesh, mesh_id: int, gl: Any) -> Iterator[Sampling]:
    """Yield the samplings, or the scans, of a mesh, variation by variation.

    All randomness comes from the mesh's key and the configuration's seed.
    """
    entry, scan = plan.meshes[mesh_id], plan.config.scan
    if scan is not None:
        return _scan(mesh, entry.label, scan, plan, entry.key)
    return _occlude(mesh, plan.config, plan.views_of(entry.key), entry.key, gl, plan.n_checked)


def _occlude(mesh: Mesh, config: DatasetConfig, views: Views, key: str, gl: Any, n_checked: int) -> Iterator[Sampling]:
    views = views.around(mesh.centre, mesh.longest_side)
    with ExitStack() as stack:
        occluder, renderer = None, "none"
        if not config.complete:
            options = dict(config.method_options or {})
            # the manifest counts views inside the mesh and meshes with far faces
            occluder = stack.enter_context(prepare(mesh, config.method, gl=gl, warn=False, **options))
            renderer = occluder.renderer
        for variation in range(config.variations):
            points, counts = sample(mesh, config, seed_of(config.seed, key, variation)), QualityCounts()
            if occluder is None:
                mask = np.ones((len(views), len(points)), dtype=bool)
            else:
                mask = occluder.visible(points, views.eyes)
                rng = np.random.default_rng(seed_of(config.seed, key + "/check", variation))
                counts += check(mesh, points, views, mask, rng, n_checked, WorstView(0.0, key, variation, 0))
                if variation == 0:
                    counts += QualityCounts(n_inside=int(mesh.in_box(views.eyes).sum()))
            if views.fov_bounds is not None and not config.complete:
                mask = mask & views.in_frustum(points.positions)
            n_visible = np.array([np.count_nonzero(seen) for seen in mask])  # fast, unlike along an axis
            n_distinct, blank = n_visible.copy(), dict[int, str]()
            for view in np.flatnonzero(n_visible < FEW).tolist():
                n_distinct[view] = count_distinct(points.positions[mask[view]])
                if n_distinct[view] < 2:
                    blank[view] = "it sees none of the points" if n_visible[view] == 0 else IN_ONE_PLACE
                    mask[view], n_visible[view] = False, 0
            counts += count_clouds(n_visible, n_distinct, config)
            yield Sampling(points, mask, views, mesh.longest_side, counts, renderer, blank)


def count_clouds(n_visible: NDArray[np.intp], n_distinct: NDArray[np.intp], config: DatasetConfig) -> QualityCounts:
    """Count the clouds of views that see `n_visible` (k,) points in `n_distinct` places (k,), or in `FEW` and more.

    Views without a cloud have 0 visible points, those left out for too few points more than one place.
    """
    sparse = (n_visible == 0) & (n_distinct > 1)
    return QualityCounts(
        n_clouds=int((n_visible > 0).sum()),
        n_blind_views=int(((n_visible == 0) & ~sparse).sum()),
        n_sparse=int(sparse.sum()),
        n_with_repeats=int(((n_visible > 0) & (n_visible < (config.sample_size or 0))).sum()),
        n_few=int(((n_visible > 0) & (n_distinct < FEW)).sum()),
    )


def count_distinct(positions: FloatArray, enough: int = FEW) -> int:
    """Count distinct positions (n, 3), but stop at `enough` and at `FEW`."""
    enough = max(enough, FEW)
    first = len(np.unique(positions[: 4 * enough], axis=0))
    return first if first >= enough or len(positions) <= 4 * enough else len(np.unique(positions, axis=0))


def why_no_cloud(capture: Capture, scan: ScanConfig, places: Views, view: int, n_distinct: int) -> str:
    """Return the reason why a scan of `n_distinct` distinct points gives no cloud."""
    if n_distinct > 1:
        return f"only {n_distinct} distinct points, fewer than --least-points {scan.least_points}"
    if n_distinct == 1:
        return IN_ONE_PLACE
    return why_empty(capture, scan.sensor.of_view(places, view), scan.method, scan.keep == "all").reason


def sample(mesh: Mesh, config: DatasetConfig, seed: np.random.SeedSequence) -> SurfacePoints:
    """Sample the object once for a variation; `density` counts points per area with the longest side taken as 1.

    The points come face by face, and within a face in Morton order: neighbours in space are neighbours in memory,
    which makes every method fast and packed datasets small. (The order within a cloud is random all the same.)
    """
    if config.density is None:
        points = sample_surface(mesh, n_points=config.n_points, seed=seed)
    else:
        points = sample_surface(mesh, density=config.density / mesh.longest_side**2, seed=seed)
        if not len(points):  # a density so low that Algorithm 1 draws nothing still has to give a cloud
            points = sample_surface(mesh, n_points=1, seed=seed)
    return points.select(curve_order(points, mesh.bounds[0], mesh.longest_side))


def count_mesh(mesh: Mesh, config: DatasetConfig) -> QualityCounts:
    """Count dropped faces, far faces, and missing colours or windows; the log names them."""
    lacking = "colors" in config.attributes and (mesh.colors is None or not mesh.colors.is_whole)
    for reason in mesh.colors.warnings if lacking and mesh.colors is not None else ():
        _LOG.warning("%s: %s", mesh.name, reason)
    shares = {} if config.scan is None else config.scan.transparent
    opaque = bool(shares) and not (mesh.colors is not None and mesh.colors.transparent(shares).transmittance.any())
    keeps_contact = config.scan is None and not config.complete and "contact" not in (config.method_options or {})
    far = far_faces(mesh) if keeps_contact else None
    if far is not None:
        _LOG.warning("%s. %s", far.summary(mesh), contact_advice(far, mesh))
    return QualityCounts(
        faces_dropped=mesh.dropped,
        n_without_colors=int(lacking),
        n_without_windows=int(opaque),
        n_with_far_faces=int(far is not None),
    )


def check(
    mesh: Mesh,
    points: SurfacePoints,
    views: Views,
    mask: BoolArray,
    rng: np.random.Generator,
    n_checked: int,
    place: WorstView,
) -> QualityCounts:
    """Compare a random few of the answers with the oracle's, and count the differences view by view.

    At least one view is checked, with `CHECKED_POINTS` points or more each; `place` names mesh and variation.
    """
    n_pairs = min(n_checked, max(CHECKED_POINTS, MAX_TESTS // len(mesh.faces)))
    n_views = min(max(1, n_pairs // CHECKED_POINTS), len(views))
    some_views = rng.choice(len(views), n_views, replace=False)
    some_points = rng.choice(len(points), min(-(-n_pairs // n_views), len(points)), replace=False)
    with prepare(mesh, "oracle", warn=False) as oracle:
        truth = oracle.visible(points.select(some_points), views.eyes[some_views])
    answer = mask[np.ix_(some_views, some_points)]
    return QualityCounts.of_views(answer & ~truth, ~answer & truth, some_views, place)


def _scan(mesh: Mesh, label: str, scan: ScanConfig, plan: Plan, key: str) -> Iterator[Sampling]:
    """Yield the scans of a mesh; for complete clouds the whole object, without a scan.

    A checked pair (`QualityCounts`) is a ray; false visible: its hit lies behind the oracle's, false hidden: before it.
    """
    config = plan.config
    standing, size = in_metres(mesh, label, scan)
    floor = float(standing.bounds[0, 2])
    for variation in range(config.variations):
        seeds = partial(_seed, config.seed, key, variation)
        places = _places(mesh, size, floor, scan, plan, key, seeds)
        raised = QualityCounts(n_raised=n_raised(plan.views_of(key), places, scan))
        if config.complete:
            yield _complete(standing_points(mesh, label, config, scan, key, variation), places, size, raised, config)
            continue
        rng = np.random.default_rng(seed_of(config.seed, key + "/check", variation))
        n_checked = min(CHECKED_SCANS, -(-plan.n_checked // CHECKED_POINTS), len(places))
        checked = set(rng.choice(len(places), n_checked, replace=False).tolist())
        found, counts, renderer, blank = list[tuple[Scan, dict[str, Any]]](), raised, "none", dict[int, str]()
        n_distinct = np.empty(len(places), np.intp)
        for number, capture in enumerate(captures(standing, scan, places, floor, seeds, plan.pool)):
            renderer = capture.occluder.renderer
            if number in checked and len(capture.scan):
                counts += _check_rays(capture, rng, key, variation, number)
            facts = {"size": size, "hidden": capture.hidden, "hidden_reached": capture.reached}
            facts |= _boxes(capture, label, config)
            kept = capture.scan
            counts += QualityCounts(**capture.cut._asdict())
            n_distinct[number] = count_distinct(kept.positions, scan.least_points)
            if n_distinct[number] < max(2, scan.least_points):
                blank[number] = why_no_cloud(capture, scan, places, number, int(n_distinct[number]))
                kept = kept.select(np.empty(0, np.intp))
            found.append((kept, facts))
        lengths = np.array([len(kept) for kept, _ in found])
        counts += count_clouds(lengths, n_distinct, config)
        counts += QualityCounts(n_inside=int(standing.in_box(places.eyes).sum()))
        points = _joined(found, mesh, standing, config)
        yield Sampling(points, mask_of_scans(lengths), places, size, counts, renderer, blank)


def _complete(points: ScanPoints, places: Views, size: float, counts: QualityCounts, config: DatasetConfig) -> Sampling:
    """Return the sampling of a whole object, of which each place has all points; its clouds are added to `counts`."""
    mask = np.ones((len(places), len(points)), dtype=bool)
    n_visible = mask.sum(axis=1)
    return Sampling(points, mask, places, size, counts + count_clouds(n_visible, n_visible, config), "none")


def _joined(found: list[tuple[Scan, dict[str, Any]]], mesh: Mesh, standing: Mesh, config: DatasetConfig) -> ScanPoints:
    """Return the points of some scans one after the other, with the facts of each scan."""
    scans = [each for each, _ in found]
    return ScanPoints(
        np.concatenate([each.positions for each in scans]),
        np.concatenate([np.where(each.instances == 0, each.face_ids, -1) for each in scans]),
        np.concatenate([each.normals for each in scans]),
        columns={
            name: np.concatenate([_column(name, each, mesh, standing) for each in scans])
            for name in further_fields(config)
        },
        facts={name: np.array([facts[name] for _, facts in found]) for name in found[0][1]},
    )


def _places(mesh: Mesh, size: float, floor: float, scan: ScanConfig, plan: Plan, key: str, seeds: Seeds) -> Views:
    """Return the positions of the sensor about a mesh that is `size` metres long."""
    views = plan.views_of(key)
    if views.rotations is not None:  # cameras of a file, placed in the mesh's coordinates
        eyes = (views.eyes - mesh.centre) * (size / mesh.longest_side)
        views = Views.from_cameras(eyes, views.rotations, views.fov_bounds, sizes=views.sizes)
    return sensor_views(views, size, floor, scan, seeds)


def scanned_scenes(plan: Plan, scan: ScanConfig, mesh_id: int, variation: int) -> Iterator[Scene]:
    """Yield the whole scene that each view of a variation of a mesh scans; MeshError where its file has changed."""
    entry = plan.meshes[mesh_id]
    mesh = entry.load()
    standing, size = in_metres(mesh, entry.label, scan)
    floor, seeds = float(standing.bounds[0, 2]), partial(_seed, plan.config.seed, entry.key, variation)
    places = _places(mesh, size, floor, scan, plan, entry.key, seeds)
    return captured_scenes(standing, scan, places, floor, seeds, plan.pool)


def _boxes(capture: Capture, label: str, config: DatasetConfig) -> dict[str, Any]:
    """Return the fields of the attribute boxes; `label` is the target's."""
    if BOXES not in config.attributes or config.scan is None:
        return {}
    boxes = np.zeros(config.scan.most_objects, BOX)
    boxes[: len(capture.scene.placed)], picture = boxes_of(capture.scene, capture.occluder, capture.pose, capture.scan)
    boxes["label"][0] = as_label(label)
    return {"boxes": boxes, "picture": picture}


def standing_points(
    mesh: Mesh, label: str, config: DatasetConfig, scan: ScanConfig, key: str, variation: int
) -> ScanPoints:
    """Sample the whole of a mesh, as `pipeline.sample` does, where and as large as it stands before the sensor."""
    points = sample(mesh, config, seed_of(config.seed, key, variation))
    _, size = in_metres(mesh, label, scan)
    positions = (points.positions - mesh.centre) * (size / mesh.longest_side)
    return ScanPoints(positions, points.face_ids, points.normals, points.colors, facts={"size": np.array([size])})


def _column(name: str, scan: Scan, mesh: Mesh, standing: Mesh) -> NDArray[Any]:
    return _colors_met(scan, mesh, standing) if name == "color" else np.asarray(getattr(scan, SCAN_ARRAYS[name]))


def _colors_met(scan: Scan, mesh: Mesh, standing: Mesh) -> Bytes:
    """Return the colours (n, 3) of the points where a scan's rays met the target; other points are grey."""
    colors = np.full((len(scan), 3), GREY, dtype=np.uint8)
    mine = np.flatnonzero(scan.instances == 0)
    if mesh.colors is not None and len(mine):
        face_ids = scan.face_ids[mine]
        met = scan.starts[mine] + scan.clean_ranges[mine, None] * scan.directions[mine]
        colors[mine] = mesh.colors.at(face_ids, barycentric(standing.corners[face_ids], met))
    return colors


def _check_rays(capture: Capture, rng: np.random.Generator, key: str, variation: int, view: int) -> QualityCounts:
    """Compare a random few of a scan's rays with the oracle's answers, and count the differences."""
    scan = capture.scan
    some = rng.choice(len(scan), min(CHECKED_POINTS, len(scan)), replace=False)
    starts, directions = scan.starts[some], scan.directions[some]
    found = cast(capture.occluder, starts, directions, scan.times[some]).distances[:, 0]
    with prepare_scene(capture.scene, "oracle") as oracle:
        truth = cast(oracle, starts, directions, scan.times[some]).distances[:, 0]
    within = CONTACT * capture.scene.mesh.diagonal
    with np.errstate(invalid="ignore"):  # both miss
        behind, before = found - truth > within, truth - found > within
    place = WorstView(0.0, key, variation, view)
    return QualityCounts.of_views(behind[None], before[None], np.array([view]), place)


def _seed(seed: int, key: str, variation: int, what: str, view: int) -> np.random.SeedSequence:
    return seed_of(seed, f"{key}/{what}", variation, view)

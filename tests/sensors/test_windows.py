"""Windows: a share of each beam returns at the glass, the rest goes on; closed forms, and scans without glass."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import ACROSS, box, soup, stacked
from zbuf_occlude.geometry.colors import Material, SurfaceColors
from zbuf_occlude.meshes.shapes import traffic
from zbuf_occlude.sensors import make
from zbuf_occlude.sensors.capture import in_metres
from zbuf_occlude.sensors.noise import ROUGH_BACKSCATTER
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes import Placed, Scene, moved

PASSING = 0.7


def glazed(*shares: float) -> zo.Mesh:
    """Panes at x = 2, 4, ... that let some shares pass, and a wall at x = 10."""
    panes = [ACROSS * 8.0 + [2.0 * (i + 1), 0, 0] for i in range(len(shares))]
    materials = tuple(
        Material((0.5, 0.5, 0.5), name=f"glass{i}", transmittance=each) for i, each in enumerate((*shares, 0.0))
    )
    ids = np.repeat(np.arange(len(shares) + 1, dtype=np.int32), 2)
    return replace(stacked(*panes, ACROSS * 40.0 + [10.0, 0, 0]), colors=SurfaceColors(materials, ids))


def lidar(**numbers: Any) -> zo.sensors.Sensor:
    return make("vlp-16", range_min=0, columns=90, azimuths=[-10, 10], **numbers)


def test_a_pane_before_a_wall_returns_its_share_of_each_beam() -> None:
    mesh = glazed(PASSING)
    found = zo.scan(mesh, lidar(noise=0, returns="all"))
    pane, wall = (found.select(found.return_numbers == number) for number in (1, 2))
    assert len(pane) == len(wall) == 90 * 16
    assert (found.n_returns == 2).all()
    assert pane.points[:, 0] == pytest.approx(2.0, rel=1e-12)
    assert wall.points[:, 0] == pytest.approx(10.0, rel=1e-12)
    assert pane.shares == pytest.approx(1.0 - PASSING)
    assert wall.shares == pytest.approx(PASSING)
    opaque = zo.scan(stacked(ACROSS * 40.0 + [10.0, 0, 0]), lidar(noise=0))
    albedo = ((128 / 255 + 0.055) / 1.055) ** 2.4  # of sRGB 0.5
    assert wall.intensities == pytest.approx(opaque.intensities / 0.2 * albedo * PASSING**2, rel=1e-4)
    assert pane.intensities == pytest.approx(
        albedo * np.cos(pane.incidences) / pane.ranges**2 * (1 - PASSING), rel=1e-6
    )


@pytest.mark.parametrize(
    ("returns", "transmittance", "depth"),
    [("first", 0.7, 2.0), ("last", 0.7, 10.0), ("strongest", 0.97, 10.0), ("strongest", 0.96, 2.0)],
)
def test_which_return_is_kept_is_the_sensors(returns: str, transmittance: float, depth: float) -> None:
    """Behind a pane that lets T pass comes T^2 / 100 back, of the pane (1 - T) / 4: equal at T = 0.962."""
    found = zo.scan(glazed(transmittance), lidar(noise=0, returns=returns))
    assert found.points[:, 0] == pytest.approx(depth)


def test_pane_behind_pane_and_beams_of_five_rays() -> None:
    shares = (0.9, 0.5, 0.0001)
    sensor = lidar(sigma=0, detection_range=0, step=0, divergence=0.003, echo_separation=0.5, returns="all")
    found = zo.scan(glazed(*shares), sensor)
    for number, (before, own, depth) in enumerate(
        [(1, 0.9, 2), (0.9, 0.5, 4), (0.45, 0.0001, 6), (0.000045, 0, 10)], 1
    ):
        mine = found.select(found.return_numbers == number)
        assert len(mine) == 90 * 16
        assert mine.shares == pytest.approx(before * (1 - own))
        assert mine.points[:, 0] == pytest.approx(depth, rel=1e-4)
        assert mine.intensities * mine.ranges**2 / np.cos(mine.incidences) == pytest.approx(
            mine.intensities[0] * mine.ranges[0] ** 2 / np.cos(mine.incidences[0]), rel=1e-6
        )
    assert found.n_returns.min() == found.n_returns.max() == 4


@pytest.mark.parametrize("transmittance", [0.999999, 0.9, 0.5, 0.000001])
@pytest.mark.parametrize("divergence", [0.0, 0.002])
def test_a_pane_and_a_wall_just_behind_it_are_one_echo(transmittance: float, divergence: float) -> None:
    """Both have one albedo: 1 - T of the light returns at the pane and T^2 from behind it, of each ray."""
    colors = SurfaceColors(
        (Material((0.5,) * 3, name="glass", transmittance=transmittance), Material((0.5,) * 3)), np.arange(4) // 2
    )
    mesh = replace(stacked(*(ACROSS * 40.0 + [x, 0, 0] for x in (10.0, 10.2))), colors=colors)
    found = zo.scan(mesh, lidar(sigma=0, detection_range=0, step=0, drop=0, divergence=divergence, echo_separation=0.5))
    albedo = ((128 / 255 + 0.055) / 1.055) ** 2.4  # of sRGB 0.5
    reflected = found.intensities * found.clean_ranges**2 / np.cos(found.incidences)
    assert len(found) == 90 * 16
    assert reflected == pytest.approx(albedo * (1 - transmittance + transmittance**2), rel=1e-6)
    assert (found.n_returns == 1).all()


def test_of_several_echoes_the_nearest_is_a_pixels_depth() -> None:
    """A pane before a wall, no jump beside any pixel but those of the border: its pixels alone are lost."""
    camera = make("pinhole:width=30,height=20,fov=60,returns=all,edge_loss=1")
    found = zo.scan(glazed(0.5), camera)
    inner = (found.rings > 0) & (found.rings < 19) & (found.columns > 0) & (found.columns < 29)
    assert len(found) == inner.sum() == 2 * 28 * 18
    two_eyes = camera.with_numbers(edge_loss=0, match_window=5, baseline=[0, 0.05, 0])
    seen = zo.scan(glazed(0.5), two_eyes)
    by_echo = [seen.select(seen.return_numbers == number) for number in (1, 2)]
    assert len(by_echo[0]) > 400
    assert set(zip(by_echo[0].rings, by_echo[0].columns, strict=True)) <= set(
        zip(by_echo[1].rings, by_echo[1].columns, strict=True)
    )


def test_behind_glass_everything_is_as_without_it() -> None:
    """Random triangles, some of them windows: last returns are the first hits of the rest alone, by the oracle."""
    mesh = soup(400, 0.3, seed=5)
    ids = (np.arange(400) % 3 == 0).astype(np.int32)
    colors = SurfaceColors((Material((1, 1, 1)), Material((1, 1, 1), name="glass", transmittance=0.5)), ids)
    rest = zo.Mesh(mesh.vertices, mesh.faces[ids == 0])
    sensor, pose = lidar(noise=0, returns="all"), zo.sensors.look_at([-3.0, 0.4, 0.5], [0.5, 0.5, 0.5])
    found = zo.scan(replace(mesh, colors=colors), sensor, pose)
    truth = zo.scan(rest, sensor, pose, method="oracle")
    solid = found.select(ids[found.face_ids] == 0)
    assert np.array_equal(np.flatnonzero(ids == 0)[truth.face_ids], solid.face_ids)
    assert solid.ranges == pytest.approx(truth.ranges, rel=1e-14)
    first = found.select(found.return_numbers == 1)
    assert np.array_equal(first.face_ids, zo.scan(mesh, sensor, pose, method="oracle").face_ids)
    # every ray against every triangle: a signed volume each side, a plane's distance
    starts, ahead = mesh.corners - pose[:3, 3], sensor.rays().directions @ pose[:3, :3].T
    a, b, c = (starts[:, i] for i in range(3))
    sides = np.stack([ahead @ np.cross(*pair).T for pair in ((a, b), (b, c), (c, a))])
    through = (sides > 0).all(axis=0) | (sides < 0).all(axis=0)
    away = np.where(through, np.einsum("fi,fi->f", mesh.face_normals, a) / (ahead @ mesh.face_normals.T), np.inf)
    ends = np.where(ids == 0, away, np.inf).min(axis=1)
    expected = ((away < ends[:, None]) & (ids == 1)).sum(axis=1) + (ends < np.inf)
    beams = found.columns * 16 + found.rings
    assert np.array_equal(np.bincount(beams, minlength=len(ahead)), expected)
    assert solid.n_returns.max() >= 4


def test_glass_hides_nothing_and_drives_with_its_van() -> None:
    """A moving van with a window: the driver is seen through it where both are by then."""
    side = SurfaceColors((Material((1, 1, 1), name="window", transmittance=0.8),), np.zeros(2, np.int32))
    window = replace(stacked(ACROSS * [1, 2, 2]), colors=side)
    placed = [
        Placed(window, "window", moved(to=(8.0, 0.0, 0.0)), velocity=(20.0, 0.0, 0.0)),
        Placed(box((0.5, 0.5, 0.5)), "driver", moved(to=(9.0, 0.0, 0.0)), velocity=(20.0, 0.0, 0.0)),
    ]
    scene = Scene.joined(placed)
    found = zo.scan(scene, lidar(noise=0, returns="all"))
    driver, glass = found.select(found.instances == 1), found.select(found.instances == 0)
    assert driver.points[:, 0] == pytest.approx(8.75 + 20.0 * driver.times, rel=1e-12)
    assert glass.points[:, 0] == pytest.approx(8.0 + 20.0 * glass.times, rel=1e-12)
    assert (driver.return_numbers == 2).all()
    assert set(driver.columns) < set(glass.columns)
    from zbuf_occlude.sensors.casting import prepare_scene

    points = zo.sample_surface(scene.mesh, n_points=500, seed=0)
    with prepare_scene(scene, "exact") as occluder, zo.prepare(placed[1].mesh, "oracle") as alone:
        seen = occluder.visible(points, [0.0, 0.0, 0.0])
        local = zo.SurfacePoints(
            points.positions - [9.0, 0, 0], np.where(points.face_ids > 1, points.face_ids - 2, -1), points.normals
        )
        assert np.array_equal(seen, alone.visible(local, [-9.0, 0.0, 0.0]))


def test_dark_glass_scatters_its_share_back() -> None:
    """The factor multiplies the albedo: intensities are as much weaker, and so many fewer returns are detected."""
    factor, reach, wall = 0.1, 40.0, stacked(ACROSS * 40.0 + [10.0, 0, 0])
    dark = replace(wall, colors=SurfaceColors((Material((1.0, 1, 1), scattering=factor),), np.zeros(2, np.int32)))
    scenes = [Scene.joined([Placed(mesh, "wall", albedo=0.3)]) for mesh in (wall, dark)]
    assert scenes[0].scattering is None
    assert scenes[1].is_opaque_and_static
    plain, found = (zo.scan(scene, lidar(noise=0)) for scene in scenes)
    assert found.intensities == pytest.approx(factor * plain.intensities, rel=1e-12)
    assert found.points == pytest.approx(plain.points)
    sensor = lidar(sigma=0, step=0, divergence=0, detection_range=reach)
    cosines = np.cos(plain.incidences)
    backscatter = cosines + ROUGH_BACKSCATTER * (1.0 - cosines**2)
    expected = np.exp(-((plain.ranges / reach) ** 2) / (0.3 * factor * backscatter)).sum()
    kept = np.mean([len(zo.scan(scenes[1], sensor, seed=seed)) for seed in range(20)])
    assert kept == pytest.approx(expected, abs=4 * np.sqrt(expected / 20))


@pytest.mark.parametrize("scattering", [[0.5], [0.5, 1.5], [np.nan, 1.0]])
def test_a_factor_is_one_per_face_in_0_to_1(scattering: list[float]) -> None:
    wall = stacked(ACROSS * 4.0)
    with pytest.raises(zo.ArgumentError, match="scattering"):
        Scene(wall, np.zeros(2, np.int32), ("wall",), np.ones(1), scattering=np.array(scattering))


def test_windows_of_road_users_reach_datasets() -> None:
    """The mesh of a cloud keeps what its windows scatter; names make the same windows transparent."""
    car, config = traffic.make("car", 0), ScanConfig(make("vlp-16"))
    assert car.colors is not None
    standing, _ = in_metres(car, "car", config)
    assert standing.colors is not None
    assert np.array_equal(standing.colors.scattering, car.colors.scattering)
    assert not standing.colors.transmittance.any()
    clear = car.transparent({"glass": 0.8}).colors
    assert clear is not None
    assert np.array_equal(clear.transmittance == 0.8, car.colors.scattering < 1.0)


def test_a_road_user_alone_is_scanned_as_in_a_scene() -> None:
    """Alone it has the luminance of its colours, in a scene the albedo of the object: both are the typical one."""
    car, pose = traffic.make("car", 0), zo.sensors.look_at([8.0, -6.0, 1.7], [0.0, 0.0, 0.8])
    alone, placed = (zo.scan(each, lidar(noise=0), pose) for each in (car, Scene.joined([Placed(car, "car")])))
    assert len(alone) > 50
    assert alone.intensities == pytest.approx(placed.intensities, rel=0.02)
    assert car.colors is not None
    assert (car.colors.scattering[alone.face_ids] < 1.0).any()


def test_materials_by_name() -> None:
    mesh = glazed(0.3)
    assert len(zo.scan(mesh, lidar(noise=0, returns="all"), transparent={"glass*": 0.5})) == 2 * 90 * 16
    shares = zo.scan(mesh, lidar(noise=0, returns="all"), transparent={"*": None}).shares
    assert set(np.round(shares, 9)) == {0.7, 0.3}
    assert len(zo.scan(mesh, lidar(noise=0, returns="all"), transparent={})) == 90 * 16
    with pytest.raises(zo.ArgumentError, match="glass0, glass1"):
        zo.scan(mesh, "vlp-16", transparent={"window": None})
    for bad in (0.5, {"glass0": 1.5}, {"glass0": "half"}, {3: 0.5}):
        with pytest.raises(zo.ArgumentError, match=r"transparent must|lets pass"):
            zo.scan(mesh, "vlp-16", transparent=bad)
    with pytest.raises(zo.ArgumentError, match="prepare_scene"), zo.prepare(mesh, "exact") as occluder:
        zo.scan(mesh, "vlp-16", occluder=occluder)
    assert len(zo.scan(mesh, lidar(), zo.sensors.look_at([20.0, 0, 0], [40.0, 0, 0]), transparent={"*": 0.5})) == 0

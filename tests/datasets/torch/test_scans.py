"""Scans on the fly: another each time, by torch's seed, alone and in scenes."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import zbuf_occlude as zo
from tests.scenes import box
from zbuf_occlude.geometry.colors import Material, SurfaceColors
from zbuf_occlude.meshes import shapes

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from zbuf_occlude.datasets.torch import OnTheFlyScan  # noqa: E402  (needs torch)

CAR = shapes.make("car", 1)


def test_another_scan_each_time_and_the_same_by_the_same_seed() -> None:
    scan = OnTheFlyScan(200, sensor="vlp-32c", range=(6.0, 12.0), method="embree")
    torch.manual_seed(3)
    one, two = scan(CAR, "car"), scan(CAR, "car")
    torch.manual_seed(3)
    again = scan(CAR, "car")
    assert one.shape == (200, 3)
    assert one.dtype == torch.float32
    assert torch.equal(one, again)
    assert not torch.equal(one, two)
    assert float((one.max(0).values - one.min(0).values).max()) == pytest.approx(1.0, abs=1e-5)


def test_in_a_street_in_metres() -> None:
    scan = OnTheFlyScan(
        *(300,), sensor="hdl-64e", numbers={"noise": 0}, range=(8.0, 8.0), scene="street", hidden=(0.3, 0.3),
        scale="mesh", method="embree", surroundings=shapes.collection(n_members=1),
    )  # fmt: skip
    torch.manual_seed(0)
    cloud = scan(CAR, "car").numpy()
    half = np.ptp(CAR.bounds, axis=0) * 4.5 / CAR.longest_side / 2
    assert (np.abs(cloud) <= half + 1e-4).all()  # on the car's box, and nothing else


def test_it_takes_what_a_command_takes() -> None:
    named = OnTheFlyScan(10, sensor="vlp-16", numbers={"noise": 0}, range="5..6", size="2")
    given = OnTheFlyScan(10, sensor=zo.sensors.make("vlp-16", noise=0), range=(5.0, 6.0), size=2.0)
    assert named.config.to_dict() == given.config.to_dict()
    assert OnTheFlyScan(10, range=5).config.range == (5.0, 5.0)


def test_what_it_refuses() -> None:
    with pytest.raises(zo.OptionError, match="n_points must be a positive int; got 0"):
        OnTheFlyScan(0)
    with pytest.raises(zo.ArgumentError, match="surroundings must be a MeshCollection; got list"):
        OnTheFlyScan(10, scene="street", surroundings=[CAR])  # type: ignore[arg-type]
    for span in ("far", (5,), (5, "6"), True):
        with pytest.raises(zo.OptionError, match="range must be a number, or two"):
            OnTheFlyScan(10, range=span)
    for size in ("banana", {"car": "big"}, -1, True, (1, 2)):
        with pytest.raises(zo.OptionError, match="size must be 'file', metres"):
            OnTheFlyScan(10, size=size)
    with pytest.raises(zo.ArgumentError, match="numbers must be a mapping"):
        OnTheFlyScan(10, numbers="noise=0")  # type: ignore[arg-type]
    with pytest.raises(zo.OptionError, match=r"'gizmo' has none\. Give OnTheFlyScan size=\{'gizmo': METRES\}, or"):
        OnTheFlyScan(10)(CAR, "gizmo")
    with pytest.raises(zo.ArgumentError, match="a mesh must have vertices and faces; got int"):
        OnTheFlyScan(10)(3, "car")
    far = OnTheFlyScan(10, sensor="pinhole:width=2,height=2,fov=60", range=(900.0, 900.0), method="embree")
    with pytest.raises(zo.MeshError, match="car_0001 did not from 8 places: no ray of pinhole meets it"):
        far(CAR, "car")
    glass = SurfaceColors((Material((1.0, 1.0, 1.0), name="glass"),), np.zeros(len(CAR.faces), np.int32))
    clear = zo.Mesh(CAR.vertices, CAR.faces, "pane", colors=glass)
    with pytest.raises(zo.MeshError, match=r"every material of pane lets all light pass\. Give one a share below 1"):
        OnTheFlyScan(10, transparent={"glass": 1.0})(clear, "car")
    assert OnTheFlyScan(10, transparent={"glass": 0.5}, method="embree")(clear, "car").shape == (10, 3)


def test_scans_of_too_few_points_give_way(tmp_path: Path) -> None:
    """Twelve rays meet a plate, wherever it is seen from: fewer than the default of 16."""
    (tmp_path / "rays.csv").write_text("azimuth,elevation\n" + "".join(f"{-1.1 + 0.2 * i},0\n" for i in range(12)))
    given: dict[str, Any] = {"sensor": tmp_path / "rays.csv", "range": 9.0, "size": 2.0, "method": "exact"}
    with pytest.raises(zo.MeshError, match="only 12 distinct points, fewer than --least-points 16"):
        OnTheFlyScan(10, **given)(box(), "box")
    for least in (0, 12):
        assert OnTheFlyScan(10, least_points=least, **given)(box(), "box").shape == (10, 3)
    with pytest.raises(zo.OptionError, match="least_points must be an int from 0; got -1"):
        OnTheFlyScan(10, least_points=-1)


def test_views_of_a_specification() -> None:
    """From +x alone only that side of a long box is seen, half its length from its middle."""
    given: dict[str, Any] = {"sensor": "vlp-32c", "numbers": {"noise": 0}, "range": 6.0, "size": 4.0, "method": "exact"}
    cloud = OnTheFlyScan(300, views="ring:1@0", scale="mesh", **given)(box((4.0, 1.0, 1.0)), "box").numpy()
    assert np.allclose(cloud[:, 0], 2.0, atol=1e-5)
    torch.manual_seed(1)
    either = OnTheFlyScan(300, views="ring:2@0", scale="mesh", **given)
    sides = {round(float(either(box((4.0, 1.0, 1.0)), "box")[0, 0])) for _ in range(12)}
    assert sides == {-2, 2}
    assert OnTheFlyScan(9, views="drive:1", **given)(CAR, "car").shape == (9, 3)
    with pytest.raises(zo.OptionError, match="views must be paper100"):
        OnTheFlyScan(10, views="round")

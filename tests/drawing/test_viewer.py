"""The viewer in a real browser: the camera is dragged, and the page shows the count that the definition gives."""

import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import trimesh

from tests.browser import Page, open_page
from tests.needs import need
from zbuf_occlude.base.errors import OptionError
from zbuf_occlude.geometry.camera import view_matrices
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes import shapes
from zbuf_occlude.meshes.sampling import sample_surface
from zbuf_occlude.sensors import SENSORS, scan
from zbuf_occlude.visibility import prepare

need("viser")

from zbuf_occlude.drawing.viewer import ONLOOKER, CloudsViewer, MeshViewer, StoredCloud, Viewer  # noqa: E402

N, SIZE = 2000, (900, 480)
PATIENCE = 60.0
SERVED = {"host": "127.0.0.1", "port": 0}


@contextmanager
def served(viewer: Viewer) -> Iterator[None]:
    """Let a viewer run in a thread."""
    thread = threading.Thread(target=viewer.run)
    thread.start()
    try:
        yield
    finally:
        viewer.close()
        thread.join(PATIENCE)
    assert not thread.is_alive()


@pytest.fixture(scope="module")
def chair() -> Mesh:
    return shapes.make("chair", 3)


@pytest.fixture
def viewer(chair: Mesh, tmp_path: Path) -> MeshViewer:
    return MeshViewer(chair, SENSORS, n_points=N, title="chair", out=tmp_path / "seen.ply", **SERVED)


def text(page: Page) -> str:
    return str(page.ask("return document.body.innerText"))


def wait_for(page: Page, is_right: Callable[[str], object]) -> str:
    """Return the page's text as soon as it is right."""
    end = time.monotonic() + PATIENCE
    while not is_right(found := text(page)):
        assert time.monotonic() < end, found
        page.ask("await frame()")
    return found


def visible_in(found: str) -> int:
    matched = re.search(r"([\d,]+) of 2,000 points visible", found)
    return int(matched[1].replace(",", "")) if matched else -1


def truth(mesh: Mesh, eye: np.ndarray) -> int:
    """Return the number of visible points by the oracle."""
    samples = sample_surface(mesh, n_points=N, seed=0)
    return int(prepare(mesh, "oracle").visible(samples, eye).sum())


def pixel_of(position: np.ndarray) -> tuple[float, float]:
    """Return where the page shows a position at first: 45 degrees from bottom to top, from `ONLOOKER` to the centre."""
    x, y, z = view_matrices(ONLOOKER[None], np.zeros(3))[0, :3] @ np.append(position, 1.0)
    scale = SIZE[1] / 2 / np.tan(np.radians(22.5)) / -z
    return SIZE[0] / 2 + x * scale, SIZE[1] / 2 - y * scale


def click(page: Page, label: str) -> None:
    """Click the input beside a label."""
    page.ask(
        f"const label = [...document.querySelectorAll('label')].find((each) => each.innerText === {label!r});\n"
        "document.getElementById(label.htmlFor).click(); await frame()"
    )


@pytest.mark.needs("chromium")
def test_dragging_the_camera_updates_what_it_sees(viewer: MeshViewer, chair: Mesh, tmp_path: Path) -> None:
    with served(viewer), open_page(viewer.url, tmp_path, size=SIZE) as page:
        before, start = visible_in(wait_for(page, lambda found: visible_in(found) > 0)), viewer.pose()[:3, 3]
        assert before == truth(chair, start)
        place = (start - chair.centre) / chair.longest_side
        upwards = np.array([0.0, 0.0, 0.3])  # on the arrow along z

        def has_moved(_: str) -> bool:
            if viewer.pose()[2, 3] == start[2]:  # the arrows may be drawn later than the text
                page.drag(pixel_of(place + 0.8 * upwards), pixel_of(place + 4.0 * upwards))
            return bool(viewer.pose()[2, 3] != start[2])

        wait_for(page, has_moved)
        wait_for(page, lambda found: before != visible_in(found) == truth(chair, viewer.pose()[:3, 3]))
        moved = viewer.pose()[:3, 3] - start
        assert moved[2] > 0.2 * chair.longest_side
        assert np.allclose(moved[:2], 0.0, atol=1e-6 * chair.longest_side), "along the arrow alone"
        page.ask("[...document.querySelectorAll('button')].find((each) => each.innerText === 'Save cloud').click()")
        wait_for(page, lambda found: "saved: " in found)
    assert len(trimesh.load(tmp_path / "seen-1.ply").vertices) == truth(chair, viewer.pose()[:3, 3])


@pytest.mark.needs("chromium")
def test_the_users_own_viewpoint_is_the_camera(viewer: MeshViewer, chair: Mesh, tmp_path: Path) -> None:
    with served(viewer), open_page(viewer.url, tmp_path, size=SIZE) as page:
        wait_for(page, lambda found: visible_in(found) > 0)
        click(page, "My own viewpoint")
        there = ONLOOKER * chair.longest_side + chair.centre
        wait_for(page, lambda found: visible_in(found) == truth(chair, there))
        assert np.allclose(viewer.pose()[:3, 3], there, atol=1e-4 * chair.longest_side)
        page.drag((200, 420), (400, 340))
        wait_for(page, lambda _: np.abs(viewer.pose()[:3, 3] - there).max() > 0.1 * chair.longest_side)
        wait_for(page, lambda found: visible_in(found) == truth(chair, viewer.pose()[:3, 3]))


@pytest.mark.needs("chromium")
def test_a_sensor_scans_with_noise_or_without(chair: Mesh, tmp_path: Path) -> None:
    mesh, sensor = chair.transformed(0.9 / chair.longest_side), SENSORS["realsense-d435"]
    out = tmp_path / "scan.ply"
    viewer = MeshViewer(mesh, SENSORS, sensor=sensor.name, n_points=N, title="chair", out=out, **SERVED)
    expected = [len(scan(mesh, each, viewer.pose())) for each in (sensor, sensor.with_numbers(noise=0.0))]
    assert 1000 < expected[0] < expected[1]
    with served(viewer), open_page(viewer.url, tmp_path, size=SIZE) as page:
        found = wait_for(page, lambda found: f"{expected[0]:,} returns of realsense-d435" in found)
        assert visible_in(found) == truth(mesh, viewer.pose()[:3, 3])
        click(page, "Noise")
        wait_for(page, lambda found: f"{expected[1]:,} returns of realsense-d435" in found)


@pytest.mark.needs("chromium")
def test_clouds_of_a_dataset_are_stepped_through(tmp_path: Path) -> None:
    clouds = np.random.default_rng(0).uniform(-0.5, 0.5, (3, 50, 3))

    def read(number: int) -> StoredCloud:
        facts = {"object": f"chair_{number}", "split": "test"}
        return StoredCloud(lambda path: np.save(path, clouds[number]), "chair", facts, clouds[number], clouds[0], None)

    viewer = CloudsViewer(3, read, title="clouds", out=tmp_path / "cloud.npy", **SERVED)
    with served(viewer), open_page(viewer.url, tmp_path, size=SIZE) as page:
        wait_for(page, lambda found: "object: chair_0" in found)
        for button, number in (("next", 1), ("next", 2), ("next", 0), ("previous", 2)):
            page.ask(f"[...document.querySelectorAll('button')].find((each) => each.innerText === {button!r}).click()")
            wait_for(page, lambda found, number=number: f"object: chair_{number}" in found)


def test_an_address_of_another_machine_is_refused(chair: Mesh, tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"--host .*192\.0\.2\.1"):
        MeshViewer(chair, {}, n_points=N, title="", out=tmp_path / "a.ply", host="192.0.2.1", port=0)

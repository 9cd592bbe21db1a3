"""The pictures of README and docs/: python benchmarks/pictures.py NAME [--out FILE]

hero         a mesh and its camera, the complete cloud, the partial cloud, and an HDL-64E scan
benchmarks   the chart of docs/performance.md, from docs/figures.json
sensors      one car: uniform cloud, a LiDAR's scans at 10, 20 and 40 m, in a street, and by a depth camera
exact_corner lines through a corner, by rounded and by exact volumes
frames       what a frame holds, the visible part, masks, pairs, coverage, voxels, occlusions
view         the page of `zbuf-occlude view` in a headless browser: a car and a camera
shapes       every member of the built-in classes, a picture of each class, in the folder FILE

Without --out it is docs/NAME.png.
"""

import re
import tempfile
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import figures
import matplotlib.colors
import matplotlib.image
import numpy as np
from common import ROOT, run
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb

import zbuf_occlude as zo
from tests.browser import open_page
from zbuf_occlude.base.arrays import FloatArray
from zbuf_occlude.drawing.marks import project_to_picture
from zbuf_occlude.drawing.pictures import canvas, draw_cloud, draw_mesh, new_figure
from zbuf_occlude.drawing.viewer import MeshViewer
from zbuf_occlude.geometry.predicates import blocks
from zbuf_occlude.meshes import shapes
from zbuf_occlude.sensors import SENSORS, Scan, look_at, make
from zbuf_occlude.sensors.capture import captures, in_metres, sensor_views
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes import Placed, Scene, moved
from zbuf_occlude.sensors.scenes.contents import Pool, surroundings

BLUE, ORANGE, GREEN, GREY = "#0b66b0", "#d55e00", "#009e73", "#8a929c"
"""Colours that the colour-blind can tell apart."""
GHOST, SURFACE = "#c9ced6", "#b7bfca"
"""Of hidden points, and of meshes."""
MIDDLE = np.zeros(3)


# ---- README's --------------------------------------------------------------------------------------------------------

LENGTH = 4.5
"""Of the car, metres."""
VIEWER = 14.0 * np.array([np.cos(np.radians(-62.0)), np.sin(np.radians(-62.0)), 0.42])
"""From where the pictures are drawn."""
CAMERA = np.array([-2.0, -2.5, 1.9])
"""Where the car is seen from."""
LIDAR = 10.0 * np.array([CAMERA[0], CAMERA[1], 0.0]) / np.hypot(CAMERA[0], CAMERA[1]) + [0.0, 0.0, 1.0]
"""Where the LiDAR stands: on the camera's side, 10 m away, level."""
ACROSS, UPWARDS = (-3.5, 1.72), (-1.42, 1.8)
"""What a panel shows of the plane through the middle, metres."""
VIEW = {"eye": VIEWER, "target": MIDDLE, "radius": 3.5}


def frustum(eye: FloatArray, target: FloatArray, depth: float = 0.9, half: float = 0.34) -> list[FloatArray]:
    """Return the lines of a camera's frustum, each (2, 3)."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    sides = (x * right + 0.75 * y * up for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1)))
    corners = [eye + depth * forward + half * side for side in sides]
    edges = zip(corners, [*corners[1:], corners[0]], strict=True)
    return [np.array(ends) for ends in (*((eye, corner) for corner in corners), *edges)]


def draw_camera(panel: Axes) -> None:
    """Draw the camera's frustum over what the panel shows."""
    for line in frustum(CAMERA, MIDDLE):
        x, y, _ = project_to_picture(line, eye=VIEWER, target=MIDDLE).T
        panel.plot(x, y, color=ORANGE, linewidth=1.4, solid_capstyle="round")
    x, y, _ = project_to_picture(CAMERA[None], eye=VIEWER, target=MIDDLE)[0]
    panel.plot([x], [y], "o", color=ORANGE, markersize=5)


def hero(out: Path) -> None:
    car = shapes.make("car", 1)
    car = zo.Mesh((car.vertices - car.centre) * (LENGTH / car.longest_side), car.faces)
    points = zo.sample_surface(car, n_points=16_000, seed=0)
    with zo.prepare(car, "exact") as occluder:
        visible = occluder.visible(points, CAMERA[None])[0]
    scan = zo.scan(car, make("hdl-64e"), look_at(LIDAR, [0.0, 0.0, LIDAR[2]]), seed=0)
    figure, axes = new_figure(1, 4, panel=3.4)
    mesh_panel, complete_panel, partial_panel, scan_panel = axes[0]
    draw_mesh(mesh_panel, car, colour=SURFACE, **VIEW)
    draw_cloud(complete_panel, points.positions, normals=points.normals, colour=BLUE, size=2.0, **VIEW)
    draw_cloud(partial_panel, points.positions[~visible], colour=GHOST, size=1.2, **VIEW)
    draw_cloud(partial_panel, points.positions[visible], normals=points.normals[visible], colour=BLUE, size=2.4, **VIEW)
    draw_cloud(scan_panel, points.positions, colour=GHOST, size=0.4, **VIEW)
    draw_cloud(scan_panel, scan.positions, colour=BLUE, size=3.0, **VIEW)
    for panel in (mesh_panel, partial_panel):
        draw_camera(panel)
    titles = (
        f"mesh and camera: {len(car.faces):,} faces",
        f"complete: {len(points.positions):,} points",
        f"partial: {visible.mean():.0%} visible, hidden in grey",
        f"HDL-64E at 10 m: {len(scan.positions):,} returns",
    )
    for panel, title in zip(axes[0], titles, strict=True):
        panel.set_title(title, fontsize=12.5, color="#1f2933")
        panel.set_xlim(*ACROSS)
        panel.set_ylim(*UPWARDS)
    figure.set_size_inches(4 * 3.4, 3.4 * (UPWARDS[1] - UPWARDS[0]) / (ACROSS[1] - ACROSS[0]) + 0.35)
    figure.savefig(out, format="png", dpi=130)


# ---- what benchmarks measured ----------------------------------------------------------------------------------------

KINDS = {
    **dict.fromkeys(("vertex_hsr", "occupancy_grid", "exact_hsr"), GREY),
    **dict.fromkeys(("embree", "pyrender", "hidden_point_removal"), ORANGE),
}
"""Colours of methods that are not this project's own."""


def methods() -> list[tuple[str, float, str]]:
    """Return name, milliseconds per view and wrong answers of each row of the table of methods, the fastest first."""
    rows = []
    for line in figures.read()["methods"]["value"][2:]:
        name, wrong, time = (cell.strip() for cell in line.strip("| ").split("|")[:3])
        if "refine=none" in name:
            continue
        names = re.findall(r"`(\w+)`", name)
        sizes = re.findall(r"\d+", re.sub(r"`\w+`|\(.*\)", "", name))
        times = time.split(" / ")
        shares = wrong.rstrip("% ").split(" / ")
        for i, each in enumerate(times):
            label = f"{names[0]} {sizes[i]}" if sizes else names[i]
            rows.append((label, float(each), f"{shares[min(i, len(shares) - 1)]} %"))
    return sorted(rows, key=lambda row: row[1])


def whole_job() -> list[tuple[str, float, str]]:
    """Return name, seconds and their label of each side of the whole job."""
    lines = figures.read()["whole-job"]["value"][3:6]
    found = [re.match(r"(\S+).*?\s(\d+\.\d+)\s", line) for line in lines]
    named = {"script": "script on Open3D"}
    rows = [(named.get(m[1], m[1]), float(m[2]), f"{float(m[2]):.1f} s") for m in found if m]
    return sorted(rows, key=lambda row: row[1])


def bars(panel: Axes, rows: list[tuple[str, float, str]], title: str) -> None:
    """Draw horizontal bars, the fastest on top, each with its label."""
    kinds = [KINDS.get(name.split()[0], ORANGE if "script" in name else BLUE) for name, _, _ in rows]
    drawn = panel.barh([name for name, _, _ in rows], [value for _, value, _ in rows], color=kinds)
    panel.bar_label(drawn, [label for _, _, label in rows], padding=4, fontsize=9)
    panel.invert_yaxis()
    panel.set_title(title, fontsize=11, loc="left")
    panel.grid(visible=False)


def benchmarks(out: Path) -> None:
    figure, (left, right) = canvas(11.0, 4.4, 2, width_ratios=(3, 2))
    bars(left, methods(), "milliseconds per view (label: wrong answers)")
    left.set_xscale("log")
    left.set_xlim(0.1, 200)
    left.set_xticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    for name, colour in {"this project": BLUE, "the paper's methods": GREY, "other libraries": ORANGE}.items():
        left.bar(0, 0, color=colour, label=name)
    left.legend(loc="upper right", frameon=False)
    bars(right, whole_job(), "seconds: dataset of 175 meshes")
    right.margins(x=0.2)  # room for the labels
    figure.savefig(out, format="png", dpi=110)


# ---- scans -----------------------------------------------------------------------------------------------------------

AZIMUTH = np.radians(-140.0)
FIXED = 9.0 * np.array([np.cos(AZIMUTH + 0.5), np.sin(AZIMUTH + 0.5), 0.35])
"""From where the cloud is drawn, metres."""


def seeds(what: str, view: int, *, seed: int) -> np.random.SeedSequence:
    """Seed the draws of a scan."""
    return np.random.SeedSequence([seed, *what.encode(), view])


def scanned(mesh: zo.Mesh, sensor: str, distance: float, scene: str, seed: int = 0, **given: object) -> Scan:
    """Scan a car that stands as `stand` puts it."""
    scan = ScanConfig(make(sensor), range=(distance,) * 2, scene=scene, **given)  # type: ignore[arg-type]
    drawn, floor = partial(seeds, seed=seed), float(mesh.bounds[0, 2])
    views = zo.Views(np.array([AZIMUTH]), np.array([0.15]), np.array([2.0]))
    pool = Pool(surroundings((), scene), {}, scene, np.random.SeedSequence(1))
    places = sensor_views(views, mesh.longest_side, floor, scan, drawn)
    (capture,) = captures(mesh, scan, places, floor, drawn, pool)
    return capture.scan


def sensors(out: Path) -> None:
    plain = ScanConfig(make("hdl-64e"))
    mesh, _ = in_metres(shapes.make("car", 1), "car", plain)
    eye = 10.0 * np.array([np.cos(AZIMUTH), np.sin(AZIMUTH), 0.1])
    points = zo.sample_surface(mesh, n_points=12_000, seed=0)
    with zo.prepare(mesh, "exact") as occluder:
        uniform = points.positions[occluder.visible(points, eye[None])[0]]
    shown: list[tuple[str, FloatArray, FloatArray | None]] = [("uniform over the visible surface", uniform, None)]
    for distance in (10.0, 20.0, 40.0):
        scan = scanned(mesh, "hdl-64e", distance, "ground")
        shown.append((f"HDL-64E at {distance:.0f} m", scan.positions, None))
    street = scanned(mesh, "hdl-64e", 10.0, "street", seed=2, hidden=(0.35, 0.45), keep="all")
    near = street.select(np.linalg.norm(street.positions, axis=1) < 4.0)
    colours = np.where(near.instances[:, None] == 0, [[0.24, 0.44, 0.71]], colormaps["Set2"](near.instances % 8)[:, :3])
    shown.append(("HDL-64E at 10 m in a street, 40 % hidden", near.positions, colours))
    camera = scanned(mesh, "azure-kinect-nfov", 3.4, "ground")
    shown.append(("Azure Kinect at 3.4 m", camera.positions, None))
    figure, axes = new_figure(2, 3, panel=3.2)
    for panel, (title, positions, values) in zip(axes.flat, shown, strict=True):
        draw_cloud(panel, positions, eye=FIXED, target=MIDDLE, values=values, radius=1.75, size=3.0)
        panel.set_title(f"{title}: {len(positions):,} points", fontsize=9)
    figure.savefig(out, format="png", dpi=110)


# ---- frames ----------------------------------------------------------------------------------------------------------

SIZE = {"width": 480, "height": 400, "fov": 32.0}
COLOURS = np.round(255 * np.array([to_rgb(colour) for colour in (BLUE, ORANGE, GREEN)])).astype(np.uint8)
"""Of the objects."""


def frames(out: Path) -> None:
    chair, table, bottle = (shapes.make(name, 3).normalized() for name in ("chair", "table", "bottle"))
    placed = [
        Placed(chair, "chair"),
        Placed(table, "table", moved(to=(-1.0, -0.15, -0.25), yaw=23.0)),
        Placed(bottle, "bottle", moved(to=(0.3, 0.5, -0.3), scale=0.4)),
    ]
    scene = Scene.joined(placed)
    view = zo.views.from_angles(20, 22, distance=3.6)
    (frame,) = zo.frames(scene, view, **SIZE)
    white = np.full((*frame.depth.shape, 3), 255, np.uint8)
    near, far = frame.depth[frame.mask].min(), frame.depth[frame.mask].max()
    shaded = colormaps["viridis_r"]((np.where(frame.mask, frame.depth, far) - near) / (far - near))[..., :3] * 255
    pictures = {
        "shaded": frame.rgba[..., :3],
        "depth": shaded.astype(np.uint8),
        "normals": ((frame.normals + 1.0) * 127.5).astype(np.uint8),
        "instances": COLOURS[frame.instances],
    }
    figure, axes = new_figure(2, 5, panel=3.0)
    for panel, (title, picture) in zip(axes[0], pictures.items(), strict=False):
        panel.imshow(np.where(frame.mask[..., None], picture, white))
        panel.set_title(title)
    part = zo.visible_mesh(chair, view.eyes[0]).mesh
    draw_mesh(axes[0][4], part, eye=(1.6, -3.4, 2.2), target=MIDDLE, radius=0.75, colour=SURFACE)
    axes[0][4].set_title("its visible part, from aside")
    (alone,) = zo.frames(Scene.joined(placed[1:2]), view, **SIZE)
    picture = white.copy()
    picture[alone.mask] = 0xF2, 0xC9, 0xA5
    picture[frame.instances == 1] = COLOURS[1]
    axes[1][0].imshow(picture)
    axes[1][0].set_title("mask and mask_visib of the table")
    draw_pair(axes[1][1], chair, zo.views.parse("ring:6@25").around(chair.centre, 1.0).eyes[:2])
    found = zo.coverage(chair, zo.views.for_mesh(chair, "fibonacci:8").eyes)
    axes[1][2].set_axis_on()
    axes[1][2].bar(range(8), 100 * found.alone, color="#b8c4ce")
    axes[1][2].plot(range(8), 100 * found.together, color=BLUE, marker="o", markersize=3)
    axes[1][2].set_ylim(0, 100)
    axes[1][2].set_title("% seen: by view, together")
    grid = zo.visibility_grid(chair, view.eyes[0], n=64)
    axes[1][3].imshow(grid.states[:, 32].T, origin="lower", cmap=ListedColormap(["#5b6673", "#e8eef4", ORANGE]))
    axes[1][3].set_title("voxels: hidden, free, surface")
    graph = zo.occlusion_graph(scene, view.eyes[0])
    axes[1][4].set_axis_on()
    axes[1][4].imshow(graph.shares, cmap="Blues", vmin=0, vmax=1)
    for a, b in np.argwhere(graph.shares > 0):
        axes[1][4].text(b, a, f"{graph.shares[a, b]:.0%}", ha="center", va="center")
    axes[1][4].set_xticks(range(3), graph.labels)
    axes[1][4].set_yticks(range(3), graph.labels, rotation=90, va="center")
    axes[1][4].set_title("share of the row hidden by")
    figure.savefig(out, format="png", dpi=90)


def draw_pair(axes: Any, mesh: zo.Mesh, eyes: np.ndarray) -> None:
    """Draw what both of two cameras see, and what one does, from the middle between them."""
    points = zo.sample_surface(mesh, n_points=8_000, seed=0)
    with zo.prepare(mesh, "exact") as occluder:
        first, second = occluder.visible(points, eyes)
    back = eyes.mean(axis=0) / np.linalg.norm(eyes.mean(axis=0))
    right = np.cross([0, 0, 1], back)
    right /= np.linalg.norm(right)
    places = points.positions @ np.stack([right, np.cross(back, right)], axis=1)
    for seen, colour in ((first & ~second, COLOURS[0]), (second & ~first, COLOURS[1]), (first & second, COLOURS[2])):
        axes.scatter(*places[seen].T, s=1.5, color=colour / 255, linewidths=0)
    axes.set_aspect("equal")
    axes.set_title(f"a pair: {(first & second).sum() / first.sum():.0%} overlap, in green")


# ---- a line through a corner -----------------------------------------------------------------------------------------

ULPS = 12
"""Steps of the last digit of two coordinates of a point, either way."""


def exact_corner(out: Path) -> None:
    """Draw which of six faces about a corner block lines that pass it within a few last digits."""
    rng = np.random.default_rng(339)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    angles = np.arange(6) * np.pi / 3 + rng.uniform(-0.3, 0.3, 6)
    ring = np.stack([np.cos(angles), np.sin(angles), rng.uniform(0.1, 0.4, 6)], axis=1)
    corner, ring = np.array([0.31, 0.47, 0.23]), ring @ turn + [0.31, 0.47, 0.23]
    faces = [(corner, ring[i], ring[(i + 1) % 6]) for i in range(6)]
    eye = corner + np.array([0.2, 0.1, 3.7]) @ turn
    behind = eye + 1.7 * (corner - eye)
    steps = np.arange(-ULPS, ULPS + 1)
    rounded, exact = (np.zeros((len(steps), len(steps)), dtype=int) for _ in range(2))
    for i, j in np.ndindex(*rounded.shape):
        point = behind + np.array([steps[j] * np.spacing(behind[0]), steps[i] * np.spacing(behind[1]), 0.0])
        for number, face in enumerate(faces, 1):
            a, b, c = (each - point for each in face)
            volumes = [float((point - eye) @ np.cross(*edge)) for edge in ((b, c), (c, a), (a, b))]
            if min(volumes) >= 0 or max(volumes) <= 0:
                rounded[i, j] = number
            if blocks(tuple(eye), tuple(point), *map(tuple, face), 0.0):
                exact[i, j] = number
    figure, axes = new_figure(1, 2, panel=4.0)
    colours = ListedColormap(["#d62728", *(f"#{k:02x}{k:02x}{k + 24:02x}" for k in (120, 200, 140, 215, 160, 180))])
    for panel, found, title in ((axes[0][0], rounded, "rounded volumes"), (axes[0][1], exact, "exact signs")):
        panel.imshow(found, origin="lower", cmap=colours, vmin=0, vmax=6)
        panel.set_title(f"{title}: {(found == 0).sum()} of {found.size} lines leak")
    figure.savefig(out, format="png", dpi=90)


# ---- built-in shapes -------------------------------------------------------------------------------------------------

COLUMNS = 15


def tile(mesh: zo.Mesh) -> np.ndarray:
    """Draw one mesh, seen from the front and above; (h, w, 3) uint8."""
    figure, axes = new_figure(1, 1, panel=1.5)
    draw_mesh(axes[0, 0], mesh, eye=(2.0, -3.5, 1.6), target=MIDDLE, colour=SURFACE, perspective=False)
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].copy()


def every_shape(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for label in shapes.CLASSES:
        tiles = [tile(shapes.make(label, index).normalized()) for index in range(shapes.MEMBERS)]
        tiles += [np.full_like(tiles[0], 255)] * (-len(tiles) % COLUMNS)
        rows = [np.hstack(tiles[i : i + COLUMNS]) for i in range(0, len(tiles), COLUMNS)]
        matplotlib.image.imsave(folder / f"{label}.png", np.vstack(rows))


ROAD_USERS = {"pedestrian": 16, "cyclist": 8, "car": 4, "van": 4, "truck": 6, "bus": 2}
"""Members of each class in the picture of road users."""


def road_users(out: Path) -> None:
    """Draw road users, windows dark."""
    tiles = []
    for label, count in ROAD_USERS.items():
        for index in range(count):
            mesh = shapes.traffic.make(label, index).normalized()
            colours = np.tile(matplotlib.colors.to_rgb(SURFACE), (len(mesh.faces), 1))
            if mesh.colors is not None:
                colours[mesh.colors.scattering < 1.0] = 0.15
            figure, axes = new_figure(1, 1, panel=1.5)
            view = {"eye": (2.6, -3.0, 0.9), "target": MIDDLE, "perspective": False}
            draw_mesh(axes[0, 0], mesh, face_colours=colours, **view)
            figure.canvas.draw()
            tiles.append(np.asarray(figure.canvas.buffer_rgba())[..., :3].copy())
    rows = [np.hstack(tiles[i : i + 8]) for i in range(0, len(tiles), 8)]
    matplotlib.image.imsave(out, np.vstack(rows))


def view(out: Path) -> None:
    """Take a picture of the page of `zbuf-occlude view` after a move of the camera."""
    mesh = shapes.traffic.make("car", 0)
    with tempfile.TemporaryDirectory() as folder:
        served = {"title": "car.off", "out": Path(folder) / "car.ply", "host": "127.0.0.1", "port": 0}
        viewer = MeshViewer(mesh, SENSORS, n_points=20_000, **served)
        thread = threading.Thread(target=viewer.run)
        thread.start()
        with open_page(viewer.url, Path(folder), size=(1100, 560)) as page:
            while "answered" not in page.ask("return document.body.innerText"):
                page.ask("await frame()")
            page.ask("document.querySelectorAll('.mantine-Notification-closeButton').forEach((each) => each.click())")
            page.wheel((500, 300), -300.0)
            for _ in range(2):  # a further answer, as fast as those that follow
                page.ask(
                    "const label = [...document.querySelectorAll('label')].find((each) => each.innerText === 'Mesh');"
                    "document.getElementById(label.htmlFor).click(); await frame()"
                )
                time.sleep(1.0)
            time.sleep(2.0)
            page.screenshot(out)
        viewer.close()
        thread.join()


PICTURES = {
    "hero": hero,
    "benchmarks": benchmarks,
    "sensors": sensors,
    "frames": frames,
    "exact_corner": exact_corner,
    "view": view,
    "shapes": every_shape,
    "road_users": road_users,
}


def main(name: str, *, out: Path | None = None) -> None:
    PICTURES[name](out or ROOT / "docs" / f"{name}.png")


if __name__ == "__main__":
    run(main, __doc__, name=PICTURES)

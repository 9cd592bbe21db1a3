"""Viewer in the browser: a mesh and what a camera that one drags sees of it, or the clouds of a dataset one by one.

The page is viser's (extra `view`). Its handlers only note what was moved. One loop takes the newest values and answers,
so a slow answer never queues behind older ones.
"""

import io
import socket
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout, suppress
from html import escape
from pathlib import Path
from queue import Empty, SimpleQueue
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray
from viser.transforms import SO3

from zbuf_occlude.base.arrays import FloatArray, unit_vectors
from zbuf_occlude.base.errors import OccludeError, OptionError
from zbuf_occlude.drawing.seen_cloud import MovingCamera, SeenCloud, spacing
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.sensors import Sensor, look_at
from zbuf_occlude.views import Views, from_angles

NO_SENSOR = "none"
START = -35.0, 20.0, 1.7
"""Azimuth and elevation, degrees, and distance in longest sides, at which the camera begins."""
ONLOOKER = np.array([3.1, 2.4, 1.9])
"""Position from which the page shows object and camera first, where the longest side is 1."""
NEAREST, FARTHEST = 0.5, 20.0
"""Ends of the slider of the range, longest sides."""
MAX_POINTS = 200_000
"""End of the slider of the number of points."""
BLUE, GREY, BLACK = (84, 148, 225), (205, 205, 205), (40, 40, 40)
LIGHT = np.array([0.36, -0.48, 0.8])
"""Direction from which points are lit."""
MARK, HIDDEN_MARK = 0.7, 0.45
"""Diameters of a visible and a hidden point, in mean distances of neighbours."""
MIN_DIAMETER, MAX_DIAMETER = 0.0025, 0.02
"""Bounds of the diameter of a point, longest sides."""
OPENING = np.radians(40.0), 4 / 3
"""Field of view and aspect of the frustum of a sensor that is no pinhole, whose field has another shape."""
FRUSTUM = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Rotation from viser's frustum (x right, y down, z forward) to a sensor's frame (x forward, y left, z up)."""


class StoredCloud(NamedTuple):
    """A cloud of a dataset.

    save : function of Path, writes it as it is stored
    title : str, its class
    facts : mapping of str to str, its object, split, view and so on
    points, hidden : (n, 3) and (m, 3) float, of it and of its object's hidden part, where the longest side is 1
    eye : (3,) float or None, position of its camera among these points, if known
    """

    save: Callable[[Path], None]
    title: str
    facts: Mapping[str, str]
    points: FloatArray
    hidden: FloatArray
    eye: FloatArray | None


class Viewer(ABC):
    """A page with a cloud, its hidden part, a camera and a button that saves the cloud.

    Parameters
    ----------
    title : str
    out : Path
        Name of the files of saved clouds, to which a number is added.
    host, port
        Address on which the page is served; port 0 is any free one, and a port in use the next free one.

    Raises
    ------
    OptionError
        A host or port that this machine cannot serve.
    """

    def __init__(self, title: str, out: Path, *, host: str, port: int) -> None:
        _check_address(host, port)
        self._out = out
        self._write: Callable[[Path], None] | None = None  # writes the cloud that is shown
        self._events: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        with redirect_stdout(io.StringIO()):  # viser prints a panel
            self._server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
        self._server.gui.configure_theme(show_logo=False, show_share_button=False)  # which asks a server of others
        self._server.initial_camera.look_at = (0.0, 0.0, 0.0)
        self._server.initial_camera.position = ONLOOKER
        self._server.initial_camera.fov = np.radians(45.0)
        self._gui, scene = self._server.gui, self._server.scene
        self._status = self._gui.add_html("")
        nothing = np.zeros((1, 3), np.float32)
        looks: dict[str, Any] = {"precision": "float32", "point_shape": "circle", "point_shading": "flat"}
        self._seen_points = scene.add_point_cloud("/visible", nothing, BLUE, visible=False, **looks)
        self._hidden_points = scene.add_point_cloud("/hidden", nothing, GREY, visible=False, **looks)

    @property
    def url(self) -> str:
        """Address of the page."""
        host = self._server.get_host()
        return f"http://{f'[{host}]' if ':' in host else host}:{self._server.get_port()}"

    def run(self) -> None:
        """Answer what is moved in the page, until `close`."""
        while events := self._next_events():
            self._answer(*events)

    def close(self) -> None:
        """End `run` and the server."""
        self._events.put(None)
        with redirect_stdout(io.StringIO()):
            self._server.stop()

    @abstractmethod
    def _show(self) -> tuple[str, ...]:
        """Draw the present state and set `_write`; return lines that describe it, the first in bold."""

    def _answer(self, *events: Callable[[], None]) -> None:
        """Take what has changed and show the answer, or what is wrong."""
        try:
            for event in dict.fromkeys(events):
                event()
            self._say(*self._show())
        except (OccludeError, OSError) as error:
            self._say(str(error))

    def _next_events(self) -> list[Callable[[], None]]:
        """Wait for an event; return all that came since, or none after `close`."""
        events = list[Callable[[], None] | None]()
        while not events:
            with suppress(Empty):  # a signal just before an endless wait would not end it
                events.append(self._events.get(timeout=1.0))
        while not self._events.empty():
            events.append(self._events.get())
        return [] if None in events else [event for event in events if event is not None]

    def _on_change(self, *handles: Any, take: Callable[[], None] | None = None) -> None:
        """Answer when a user changes one of some inputs; values that are set by this program are no events."""

        def note(event: viser.GuiEvent[Any]) -> None:
            if event.client_id is not None:
                self._events.put(take or _draw_again)

        for handle in handles:
            handle.on_update(note)

    def _add_saving(self) -> None:
        """Add the button that saves the cloud."""
        self._gui.add_button(
            "Save cloud", hint=f"Write {self._out.name} with a number into {self._out.parent}"
        ).on_click(lambda _: self._events.put(self._save))
        self._saved = self._gui.add_html("")

    def _save(self) -> None:
        """Write the cloud into the first file that does not exist."""
        if self._write is None:
            return
        number = 1
        while (path := self._out.with_stem(f"{self._out.stem}-{number}")).exists():
            number += 1
        self._write(path)
        self._saved.content = _paragraphs(f"saved: {path.absolute()}")

    def _say(self, first: str, *others: str) -> None:
        self._status.content = _paragraphs(first, *others, is_bold=True)

    def _draw_points(self, handle: Any, points: FloatArray, colours: NDArray[np.uint8] | None, gap: float) -> None:
        """Show points, with their own colours if there are any, so large that those a gap apart nearly touch."""
        handle.visible = bool(len(points))
        if len(points):  # browsers complain of an empty cloud
            handle.points = points.astype(np.float32)
            mark = HIDDEN_MARK if handle is self._hidden_points else MARK
            handle.point_size = float(np.clip(mark * gap, MIN_DIAMETER, MAX_DIAMETER))
            if colours is not None:
                handle.colors = colours


class MeshViewer(Viewer):
    """A page with a mesh and a camera that one drags; what it sees is updated at every move.

    Parameters
    ----------
    mesh : Mesh
        In metres, if sensors are to see it.
    sensors : mapping of str to Sensor
        The sensors to choose from.
    sensor : str, optional
        The one chosen first.
    n_points : int
        Number of points sampled on the surface at first.
    title, out, host, port
        As of `Viewer`.

    Raises
    ------
    MeshError
        As `prepare`.
    OptionError
        As `Viewer`.
    """

    def __init__(
        self,
        mesh: Mesh,
        sensors: Mapping[str, Sensor],
        *,
        sensor: str = NO_SENSOR,
        n_points: int,
        title: str,
        out: Path,
        host: str,
        port: int,
    ) -> None:
        self._camera = MovingCamera(mesh)
        self._sensors = sensors
        self._rotation: FloatArray = np.eye(3)
        self._onlooker: viser.CameraHandle | None = None
        super().__init__(title, out, host=host, port=port)
        self._add_inputs(sensor, n_points)
        scene = self._server.scene
        vertices, faces = self._to_page(mesh.vertices).astype(np.float32), mesh.faces
        looks: dict[str, Any] = {"opacity": 0.25, "flat_shading": True, "side": "double", "cast_shadow": False}
        self._mesh = scene.add_mesh_simple("/mesh", vertices, faces, color=GREY, **looks)
        self._gizmo = scene.add_transform_controls("/camera", scale=0.35, disable_rotations=True, depth_test=False)
        self._frustum = scene.add_camera_frustum("/camera/frustum", *OPENING, scale=0.14, color=BLACK, thickness=0.01)
        self._gizmo.on_update(lambda _: self._events.put(self._take_gizmo))
        self._server.on_client_connect(self._watch_onlooker)
        self._answer(self._take_sliders)

    def close(self) -> None:
        """End `run`, the server and the query."""
        super().close()
        self._camera.close()

    def _add_inputs(self, sensor: str, n_points: int) -> None:
        """Add the inputs of the panel."""
        gui, mesh = self._gui, self._camera.mesh
        azimuth, elevation, distance = START
        with gui.add_folder("Camera"):
            self._azimuth = gui.add_slider("Azimuth", -180.0, 180.0, 0.1, azimuth, hint="Degrees from +x towards +y")
            self._elevation = gui.add_slider(
                "Elevation", -90.0, 90.0, 0.1, elevation, hint="Degrees above the xy plane"
            )
            places = 2 - int(np.floor(np.log10(mesh.longest_side)))
            nearest, farthest, start = (round(n * mesh.longest_side, places) for n in (NEAREST, FARTHEST, distance))
            hint = "From the centre, in the mesh's unit; metres for a sensor"
            self._range = gui.add_slider("Range", nearest, farthest, 10.0**-places, start, hint=hint)
            self._follows = gui.add_checkbox("My own viewpoint", False, hint="The camera is where you look from")
            self._aims = gui.add_checkbox("Aimed at the object", True, hint="Off: turn it by its rings")
        with gui.add_folder("Points"):
            most = max(MAX_POINTS, n_points)
            self._n_points = gui.add_slider(
                "Number", min(100, n_points), most, 1, n_points, hint="On the whole surface"
            )
            self._sensor = gui.add_dropdown("Sensor", [NO_SENSOR, *self._sensors], initial_value=sensor)
            self._noise = gui.add_checkbox("Noise", True, hint="Noise and losses of the sensor")
            self._shows_hidden = gui.add_checkbox("Hidden points", True, hint="In grey")
            self._shows_mesh = gui.add_checkbox("Mesh", True)
            self._add_saving()
        self._on_change(self._azimuth, self._elevation, self._range, take=self._take_sliders)
        self._on_change(self._follows, self._aims, take=self._take_modes)
        self._on_change(self._n_points, self._sensor, self._noise, self._shows_hidden, self._shows_mesh)

    def _watch_onlooker(self, client: viser.ClientHandle) -> None:
        self._onlooker = client.camera
        client.camera.on_update(self._note_onlooker)

    def _note_onlooker(self, camera: viser.CameraHandle) -> None:
        self._onlooker = camera
        if self._follows.value:
            self._events.put(self._take_onlooker)

    def _take_gizmo(self) -> None:
        """Take the place to which the camera was dragged, and where it is turned by hand its rotation."""
        if not self._aims.value:
            self._rotation = np.asarray(SO3(self._gizmo.wxyz).as_matrix())
        self._set_sliders(self._gizmo.position)

    def _take_sliders(self) -> None:
        """Take the place of the sliders."""
        distance = self._range.value / self._camera.mesh.longest_side
        self._gizmo.position = from_angles(self._azimuth.value, self._elevation.value, distance).eyes[0]

    def _take_onlooker(self) -> None:
        """Take the place and rotation from which the user looks at the page."""
        if self._onlooker is not None:
            self._rotation = np.asarray(SO3(self._onlooker.wxyz).as_matrix() @ FRUSTUM.T)
            self._gizmo.position = self._onlooker.position
            self._set_sliders(self._onlooker.position)

    def _take_modes(self) -> None:
        """Take who moves and turns the camera: the user's own viewpoint, the object, or the rings."""
        if self._follows.value:
            self._take_onlooker()
        self._gizmo.visible = not self._follows.value
        self._gizmo.disable_rotations = self._aims.value
        self._gizmo.wxyz = (1.0, 0.0, 0.0, 0.0) if self._aims.value else SO3.from_matrix(self._rotation).wxyz

    def _set_sliders(self, position: FloatArray) -> None:
        """Show a position of the page in the sliders."""
        view = Views.from_cameras(np.asarray(position)[None], np.eye(3)[None])
        _set_value(self._azimuth, float(np.degrees(view.azimuth[0])))
        _set_value(self._elevation, float(np.degrees(view.elevation[0])))
        _set_value(self._range, float(view.distance[0] * self._camera.mesh.longest_side))

    def _to_page(self, positions: FloatArray) -> FloatArray:
        """Return positions of the mesh's coordinates where the page has them: centred, the longest side 1."""
        return np.asarray((positions - self._camera.mesh.centre) / self._camera.mesh.longest_side)

    def pose(self) -> FloatArray:
        """Return the pose (4, 4) of the camera, from a sensor's frame to the mesh's coordinates."""
        mesh, position = self._camera.mesh, np.asarray(self._gizmo.position)
        if self._aims.value:
            self._rotation = look_at(position, np.zeros(3))[:3, :3]
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = self._rotation, position * mesh.longest_side + mesh.centre
        return pose

    def _show(self) -> tuple[str, ...]:
        pose, sensor = self.pose(), self._sensors.get(self._sensor.value)
        began = perf_counter()
        seen = self._camera.see(pose, self._n_points.value, sensor, has_noise=self._noise.value)
        seconds = perf_counter() - began
        self._write = seen.cloud.save
        gap = spacing(self._camera.mesh, seen.n_sampled) / self._camera.mesh.longest_side
        hidden = seen.hidden if self._shows_hidden.value else seen.hidden[:0]
        with self._server.atomic():
            self._draw_points(self._seen_points, self._to_page(seen.cloud.points), _lit(seen.cloud.normals), gap)
            self._draw_points(self._hidden_points, self._to_page(hidden), None, gap)
            self._mesh.visible = self._shows_mesh.value
            self._noise.visible = sensor is not None
            self._draw_frustum(sensor)
        return (*_description(seen, sensor), f"answered in {1e3 * seconds:.1f} ms")

    def _draw_frustum(self, sensor: Sensor | None) -> None:
        """Turn the frustum as the camera; it has the field of view of a pinhole."""
        turned = self._rotation @ FRUSTUM if self._aims.value else FRUSTUM
        self._frustum.wxyz = SO3.from_matrix(turned).wxyz
        opening, aspect = OPENING
        if sensor is not None and sensor.kind == "pinhole":
            (fx, _, _), (_, fy, _) = sensor.intrinsics[:2]
            width, height = sensor.pattern["width"] / fx, sensor.pattern["height"] / fy
            opening, aspect = 2.0 * np.arctan(height / 2.0), width / height
        self._frustum.fov, self._frustum.aspect = float(opening), float(aspect)


class CloudsViewer(Viewer):
    """A page with the clouds of a dataset, one at a time.

    Parameters
    ----------
    n_clouds : int
    read : function of int
        Returns the cloud of a number, from 0.
    title, out, host, port
        As of `Viewer`.

    Raises
    ------
    OptionError
        As `Viewer`.
    """

    def __init__(
        self, n_clouds: int, read: Callable[[int], StoredCloud], *, title: str, out: Path, host: str, port: int
    ) -> None:
        self._read, self._n_clouds = read, n_clouds
        super().__init__(title, out, host=host, port=port)
        gui = self._gui
        self._number = gui.add_slider("Cloud", 0, max(n_clouds - 1, 0), 1, 0)
        steps = gui.add_button_group("Step", ("previous", "next"))
        steps.on_click(lambda _: self._step(1 if steps.value == "next" else -1))
        self._shows_hidden = gui.add_checkbox("Hidden part", True, hint="In grey, where the dataset has it")
        self._add_saving()
        self._on_change(self._number, self._shows_hidden)
        scene, nothing = self._server.scene, np.zeros((1, 2, 3), np.float32)
        self._frustum = scene.add_camera_frustum("/camera", *OPENING, scale=0.22, color=BLACK, thickness=0.01)
        self._axis = scene.add_line_segments("/axis", nothing, BLACK, thickness=1.0, thickness_units="screen")
        self._answer()

    def _step(self, by: int) -> None:
        _set_value(self._number, (self._number.value + by) % self._n_clouds)
        self._events.put(_draw_again)

    def _show(self) -> tuple[str, ...]:
        found = self._read(self._number.value)
        self._write = found.save
        hidden = found.hidden if self._shows_hidden.value else found.hidden[:0]
        gap = 1.0 / np.sqrt(max(len(found.points), 1))  # as of a surface as large as one side of the box
        with self._server.atomic():
            self._draw_points(self._seen_points, found.points, _by_distance(found.points, found.eye), gap)
            self._draw_points(self._hidden_points, hidden, None, gap)
            self._frustum.visible = self._axis.visible = found.eye is not None
            if found.eye is not None:
                near = 0.8 * found.eye / np.linalg.norm(found.eye)  # outside the box
                self._axis.points = np.stack([found.eye, near])[None].astype(np.float32)
                self._frustum.position = found.eye
                self._frustum.wxyz = SO3.from_matrix(look_at(found.eye, np.zeros(3))[:3, :3] @ FRUSTUM).wxyz
        return (found.title, *(f"{name}: {value}" for name, value in found.facts.items()))


def _draw_again() -> None:
    """Take nothing, as an event: what is shown is drawn again."""


def _set_value(handle: Any, value: float) -> None:
    """Show a value in an input; viser declares the property so that mypy takes it for read-only."""
    handle.value = value


def _description(seen: SeenCloud, sensor: Sensor | None) -> tuple[str, str]:
    """Return two lines on what is seen."""
    n_visible = seen.n_sampled - len(seen.hidden)
    visible = f"{n_visible:,} of {seen.n_sampled:,} points visible"
    if sensor is None:
        return visible, f"{n_visible / seen.n_sampled:.1%} of the surface"
    return f"{len(seen.cloud):,} returns of {sensor.name}", visible


def _lit(normals: FloatArray) -> NDArray[np.uint8]:
    """Return the colours (n, 3) of points with these normals: blue, the lighter the more they face the light."""
    shade = 0.5 + 0.5 * np.abs(unit_vectors(normals) @ LIGHT)
    return np.asarray((shade[:, None] * BLUE).astype(np.uint8))


def _by_distance(points: FloatArray, eye: FloatArray | None) -> NDArray[np.uint8]:
    """Return the colours (n, 3) of points: blue, the nearer to the camera the lighter, or else the higher."""
    far = -points[:, 2] if eye is None else np.linalg.norm(points - eye, axis=1)
    shade = np.interp(far, [far.min(), far.max()], [1.0, 0.5])
    return np.asarray((shade[:, None] * BLUE).astype(np.uint8))


def _paragraphs(*lines: str, is_bold: bool = False) -> str:
    """Return lines of text as HTML, the first in bold if asked."""
    texts = [escape(line) for line in lines]
    if is_bold:
        texts[0] = f"<b>{texts[0]}</b>"
    return f'<div style="padding: 0.3em 0.7em; font-size: 0.9em; overflow-wrap: anywhere">{"<br>".join(texts)}</div>'


def _check_address(host: str, port: int) -> None:
    """Raise OptionError for a host or port on which nothing can be served; a port in use is none."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, socket.SOCK_STREAM) as trial:
            trial.bind((address[0], 0))
    except OSError as error:
        raise OptionError(
            f"--host must be an address of this machine, such as 127.0.0.1 or 0.0.0.0; {host!r} is not: "
            f"{error.strerror}."
        ) from None

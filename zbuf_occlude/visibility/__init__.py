"""The table of methods, and `prepare`, the one way to use them. A new method is one file and one row here."""

from collections.abc import Callable
from inspect import signature
from typing import Any

from zbuf_occlude.errors import ArgumentError, OptionError, did_you_mean, find_row
from zbuf_occlude.geometry.mesh import MeshLike, as_mesh, box_around
from zbuf_occlude.geometry.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import Method, VisibilityQuery


class Methods(tuple[Method, ...]):
    """The rows of the table in their order; ``METHODS["exact"]`` is the row of a name."""

    def __getitem__(self, which: Any) -> Any:  # a name, or what a tuple takes
        return find_method(which) if isinstance(which, str) else super().__getitem__(which)


METHODS = Methods(
    (
        Method(
            "depth_buffer",
            "the mesh drawn into a depth buffer for each eye, the points tested against it, all on the GPU",
            "zbuf_occlude.visibility.depth_buffer:prepare",
            needs_gl=True,
        ),
        Method(
            "exact",
            "image space made exact on the CPU: the oracle's answers, and nearly always faster than a ray caster",
            "zbuf_occlude.visibility.exact:prepare",
            exact=True,
        ),
        Method(
            "oracle",
            "exact CPU reference, float64, brute force over all faces: slow, simple, the definition",
            "zbuf_occlude.visibility.oracle:prepare",
            exact=True,
        ),
        Method(
            "exact_gl",
            "image space made exact on the GPU: an irregular z-buffer in compute shaders, equal to the oracle",
            "zbuf_occlude.visibility.exact_gl:prepare",
            exact=True,
            needs_gl=True,
            no_first_hits="its entries are sample points; rays have none",
        ),
        Method(
            "embree",
            "ray casting with Intel Embree, float32: an independent check and the peer to beat",
            "zbuf_occlude.visibility.embree:prepare",
            extra="embree",
            requires="embreex",
        ),
        Method(
            "warp",
            "ray casting with NVIDIA Warp, float64 where it decides: equal to the oracle; CUDA or CPU",
            "zbuf_occlude.visibility.warp:prepare",
            exact=True,
            extra="warp",
            requires="warp",
        ),
        Method(
            "pyrender",
            "depth images by pyrender in a process of its own, and the depth test: the peer in image space",
            "zbuf_occlude.visibility.pyrender:prepare",
            extra="pyrender",
            requires="pyrender",
            libraries=("libEGL.so.1", "libGL.so.1", "libXrender.so.1"),
            no_first_hits="its pixels lie where its camera has them, not where the rays go",
        ),
        Method(
            "vertex_hsr",
            "paper 3.3: every face with a hidden vertex is dropped; large faces can be divided first",
            "zbuf_occlude.visibility.vertex_hsr:prepare",
            no_first_hits="it keeps or drops whole faces, and looks at no ray",
        ),
        Method(
            "vertex_hsr_culled",
            "the same with far faces excluded by distance: first or second suggestion of paper 3.6",
            "zbuf_occlude.visibility.vertex_hsr_culled:prepare",
            no_first_hits="it keeps or drops whole faces, and looks at no ray",
        ),
        Method(
            "exact_hsr",
            "paper 3.5: every point against all faces by planes and perpendicular planes",
            "zbuf_occlude.visibility.exact_hsr:prepare",
            no_first_hits="the paper asks whether a point is hidden, not what hides it first",
        ),
        Method(
            "occupancy_grid",
            "paper 3.6, third suggestion: occluded cells of an n x n x n grid",
            "zbuf_occlude.visibility.occupancy_grid:prepare",
            no_first_hits="its cells name no face",
        ),
        Method(
            "hidden_point_removal",
            "Katz 2007 through Open3D: convex hull of the flipped cloud, faces unknown",
            "zbuf_occlude.visibility.hidden_point_removal:prepare",
            needs_faces=False,
            extra="open3d",
            requires="open3d",
            libraries=("libusb-1.0.so.0", "libX11.so.6", "libGL.so.1"),
            no_first_hits="it knows points and no faces",
        ),
    )
)


def find_method(name: str) -> Method:
    """Return the row of a name.

    Raises
    ------
    OptionError
        No such method; the message lists those there are.
    """
    return find_row("method", name, METHODS)


def check_keywords(function: Callable[..., Any], method: str, options: dict[str, Any]) -> None:
    """Raise OptionError for a keyword that neither a public function nor the method that it passes options to has."""
    own = [
        name for name, parameter in signature(function).parameters.items() if parameter.kind is parameter.KEYWORD_ONLY
    ]
    known = [*own, *find_method(method).options()]
    for name in options:
        if name not in known:
            raise OptionError(
                f"{function.__name__} must be given its own options or those of {method!r}, {', '.join(known)}; "
                f"got {name!r}.{did_you_mean(name, known)}"
            )


def prepare(
    mesh: MeshLike | SurfacePoints, method: str = "depth_buffer", *, gl: Any = None, **options: Any
) -> VisibilityQuery:
    """Make a mesh ready to answer line-of-sight questions by one method.

    Parameters
    ----------
    mesh : Mesh or SurfacePoints
        Or anything else that is a mesh (`as_mesh`): a path, a mesh of trimesh or Open3D, (vertices, faces). A point
        cloud for methods that do not look at faces (`Method.needs_faces`).
    method : str
        A name of the table `METHODS`.
    gl : GlContext, optional
        For methods that need GL; without it the occluders of a thread share one, which closes when the thread ends.
    **options
        The method's own; ``zbuf-occlude methods`` lists them.

    Returns
    -------
    VisibilityQuery

    Raises
    ------
    ArgumentError
        `mesh` is none, or a cloud without points.
    OptionError
        Unknown method, unknown option, a value out of range, or a point cloud for a method that needs faces.
    UnavailableError
        A package the method needs is not installed.
    GlError
        The method needs GL and no context could be opened.

    Examples
    --------
    >>> mesh = zo.load_mesh("chair.off")
    >>> points = zo.sample_surface(mesh, n_points=1000)
    >>> with zo.prepare(mesh, "exact") as occluder:
    ...     mask = occluder.visible(points, zo.views.for_mesh(mesh, "ring:8@20"))
    >>> mask.shape
    (8, 1000)
    """
    if not isinstance(mesh, SurfacePoints):
        mesh = as_mesh(mesh)
    row = find_method(method)
    row.check_options(options)
    factory = row.load()
    if isinstance(mesh, SurfacePoints):
        if row.needs_faces:
            without = ", ".join(method.name for method in METHODS if not method.needs_faces)
            raise OptionError(f"method must be one that needs no faces for a point cloud, {without}; got {row.name!r}.")
        if len(mesh) == 0:
            raise ArgumentError("a point cloud must have points; this one has none.")
        mesh = box_around(mesh.positions)
    if row.needs_gl and gl is None:
        from zbuf_occlude.gl.context import GlContext  # late: nothing touches GL at import

        gl = GlContext.of_thread()
    occluder: VisibilityQuery = factory(mesh, gl=gl, **options) if row.needs_gl else factory(mesh, **options)
    occluder.contact_given = "contact" in options
    return occluder

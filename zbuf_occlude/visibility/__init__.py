"""Table of methods, and `prepare`, which prepares a mesh for one. A new method is one file and one row here."""

from collections.abc import Callable
from inspect import signature
from typing import Any

from zbuf_occlude.base.errors import ArgumentError, OptionError, did_you_mean, find_row
from zbuf_occlude.base.precompiler import PRECOMPILER, Compilation
from zbuf_occlude.geometry.mesh import box_around
from zbuf_occlude.meshes.conversion import MeshLike, as_mesh
from zbuf_occlude.meshes.sampling import SurfacePoints
from zbuf_occlude.visibility.interface import Method, VisibilityQuery


class Methods(tuple[Method, ...]):
    """Rows of the table in order; ``METHODS["exact"]`` is the row of a name."""

    def __getitem__(self, which: Any) -> Any:  # a name, or what a tuple takes
        return find_method(which) if isinstance(which, str) else super().__getitem__(which)


METHODS = Methods(
    (
        Method(
            "depth_buffer",
            "depth buffer of the mesh for each eye and a depth test of the points, all on the GPU",
            needs_gl=True,
        ),
        Method(
            "exact",
            "exact image-space visibility on the CPU: the oracle's answers, mostly faster than a ray caster",
            exact=True,
        ),
        Method(
            "oracle",
            "exact CPU reference, float64, brute force over all faces: slow, and simple",
            exact=True,
        ),
        Method(
            "exact_gl",
            "exact image-space visibility on the GPU: an irregular z-buffer in compute shaders, as the oracle",
            exact=True,
            needs_gl=True,
            ray_casting_unsupported_reason="its entries are sample points, and a ray has none",
        ),
        Method(
            "embree",
            "ray casting with Intel Embree, float32: an independent check, for comparison",
            requires="embreex",
        ),
        Method(
            "warp",
            "ray casting with NVIDIA Warp, decided in float64: equal to the oracle; CUDA or CPU",
            exact=True,
            requires="warp",
        ),
        Method(
            "pyrender",
            "depth images by pyrender in a process of its own and a depth test, for comparison in image space",
            requires="pyrender",
            libraries=("libEGL.so.1", "libGL.so.1", "libXrender.so.1"),
            ray_casting_unsupported_reason="its rays are those of its camera's pixels",
        ),
        Method(
            "vertex_hsr",
            "paper 3.3: every face with a hidden vertex is removed; large faces can be divided first",
            ray_casting_unsupported_reason="it keeps or drops whole faces and tests no rays",
        ),
        Method(
            "vertex_hsr_culled",
            "vertex_hsr with far faces excluded by distance: first or second suggestion of paper 3.6",
            ray_casting_unsupported_reason="it keeps or drops whole faces and tests no rays",
        ),
        Method(
            "exact_hsr",
            "paper 3.5: every point against all faces by planes and perpendicular planes",
            ray_casting_unsupported_reason="it tests whether a point is hidden, not which face hides it first",
        ),
        Method(
            "occupancy_grid",
            "paper 3.6, third suggestion: occluded cells of an n x n x n grid",
            ray_casting_unsupported_reason="its cells have no face ids",
        ),
        Method(
            "hidden_point_removal",
            "Katz 2007 through Open3D: convex hull of the flipped cloud, without faces",
            needs_faces=False,
            requires="open3d",
            libraries=("libusb-1.0.so.0", "libX11.so.6", "libGL.so.1"),
            ray_casting_unsupported_reason="it uses points and no faces",
        ),
    )
)


def find_method(name: str) -> Method:
    """Return the row of a method.

    Raises
    ------
    OptionError
        No such method; the message lists the methods.
    """
    return find_row("method", name, METHODS)


def check_keywords(function: Callable[..., Any], method: str, options: dict[str, Any]) -> None:
    """Raise OptionError for a keyword that is neither the function's own nor an option of the method."""
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


def precompile(method: str, *wanted: str | Compilation) -> None:
    """Start a second process that compiles what this process needs last; this one compiles the rest meanwhile.

    `wanted` are questions of `exact`, "points", "rays" (of one origin) or "scattered rays", and further compilations.
    What is needed last comes first. Where all was compiled before, there is no second process. Questions of other
    methods compile little, and are ignored.
    """
    if method == "exact":
        from zbuf_occlude.engines.exact.bvh import BUILDING  # late: these import numba
        from zbuf_occlude.engines.exact.rays import RAYS, SCATTERED_RAYS
        from zbuf_occlude.engines.exact.search import SEARCH

        of_question = {"points": SEARCH, "rays": RAYS, "scattered rays": SCATTERED_RAYS}
        wanted = *(of_question[each] if isinstance(each, str) else each for each in wanted), BUILDING
    PRECOMPILER.launch(*(each for each in wanted if isinstance(each, Compilation)))


def prepare(
    mesh: MeshLike | SurfacePoints,
    method: str = "depth_buffer",
    *,
    gl: Any = None,
    warn: bool = True,
    **options: Any,
) -> VisibilityQuery:
    """Prepare a mesh for line-of-sight questions by one method.

    Parameters
    ----------
    mesh : Mesh or SurfacePoints
        Or any other mesh (`as_mesh`): a path, a mesh of trimesh or Open3D, (vertices, faces). A point cloud for methods
        that do not use faces (`Method.needs_faces`).
    method : str
        Name in the table `METHODS`.
    gl : GlContext, optional
        OpenGL context, for methods that need one. By default the queries of a thread share a context, which closes when
        the thread ends.
    warn : bool
        Warn of eyes inside the mesh's bounding box and, unless `contact` is given, of faces far from all others.
    **options
        Options of the method; ``zbuf-occlude methods`` lists them.

    Returns
    -------
    VisibilityQuery

    Raises
    ------
    ArgumentError
        `mesh` is not a mesh, or a cloud without points.
    OptionError
        Unknown method, unknown option, a value out of range, or a point cloud for a method that needs faces.
    UnavailableError
        A package that the method needs is not installed.
    GlError
        The method needs OpenGL and no context could be opened.

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
            raise ArgumentError("The point cloud has no points.")
        mesh = box_around(mesh.positions)
    if row.needs_gl and gl is None:
        from zbuf_occlude.engines.gl.context import GlContext  # late: nothing touches GL at import

        gl = GlContext.of_thread()
    query: VisibilityQuery = factory(mesh, gl=gl, **options) if row.needs_gl else factory(mesh, **options)
    if warn:
        query.warn_once(far_faces="contact" not in options)
    return query

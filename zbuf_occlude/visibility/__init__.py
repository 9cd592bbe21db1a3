"""The table of methods, and `prepare`, the one way to use them. A new method is one file and one row here."""

from typing import Any

from zbuf_occlude.errors import OptionError
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.visibility.interface import Method, Occluder

METHODS: tuple[Method, ...] = (
    Method(
        "oracle",
        "exact CPU judge, float64, brute force over all faces: slow, simple, the definition",
        "zbuf_occlude.visibility.oracle:prepare",
        exact=True,
    ),
    Method(
        "embree",
        "ray casting with Intel Embree, float32: an independent check and the peer to beat",
        "zbuf_occlude.visibility.embree:prepare",
        extra="embree",
        requires="embreex",
    ),
)


def find_method(name: str) -> Method:
    """Return the row of a name.

    Raises
    ------
    OptionError
        No such method; the message lists those there are.
    """
    for method in METHODS:
        if method.name == name:
            return method
    raise OptionError(f"method must be one of {', '.join(m.name for m in METHODS)}; got {name!r}.")


def prepare(mesh: Mesh, method: str = "depth_buffer", *, gl: Any = None, **options: Any) -> Occluder:
    """Make a mesh ready to answer line-of-sight questions by one method.

    Parameters
    ----------
    mesh : Mesh
    method : str
        A name of the table `METHODS`.
    gl : GlContext, optional
        For methods that need GL; without it a context is opened, and closed with the occluder.
    **options
        The method's own; ``zbuf-occlude methods`` lists them.

    Returns
    -------
    Occluder

    Raises
    ------
    OptionError
        Unknown method, unknown option, or a value out of range.
    UnavailableError
        A package the method needs is not installed.
    GlError
        The method needs GL and no context could be opened.
    """
    row = find_method(method)
    row.check_options(options)
    factory = row.load()
    if not row.needs_gl:
        return factory(mesh, **options)
    if gl is not None:
        return factory(mesh, gl=gl, **options)
    from zbuf_occlude.gl.context import GlContext  # late: nothing touches GL at import

    owned = GlContext.open()
    try:
        occluder = factory(mesh, gl=owned, **options)
    except BaseException:
        owned.close()
        raise
    occluder.owns(owned)
    return occluder

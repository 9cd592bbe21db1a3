"""The exceptions of zbuf_occlude: one tree under OccludeError, each also a standard exception.

Every message has the same form: what must be; what it is; what to do.
"""


class OccludeError(Exception):
    """Base of everything this package raises on purpose."""


class ArgumentError(OccludeError, ValueError):
    """An array or a value passed in has the wrong shape, type or range."""


class MeshError(OccludeError, ValueError):
    """A mesh (file) cannot be used; the message names it."""


class OptionError(OccludeError, ValueError):
    """A method, an option or a specification is unknown or out of range."""


class UnavailableError(OccludeError, RuntimeError):
    """Something named correctly cannot run here: a package, a library or a driver is missing."""


class GlError(OccludeError, RuntimeError):
    """No OpenGL context could be made, or OpenGL reported an error."""


class DatasetError(OccludeError, RuntimeError):
    """A dataset folder or file is not what it should be."""

"""zbuf_occlude: complete triangle meshes in, occluded point clouds out.

    mesh -> surface points -> views -> visibility mask -> occluded cloud -> dataset

Importing this package touches no GPU and imports no optional dependency.
"""

from zbuf_occlude import numba_cache, scenes, sensors, views
from zbuf_occlude.errors import (
    ArgumentError,
    DatasetError,
    GlError,
    MeshError,
    OccludeError,
    OptionError,
    UnavailableError,
)
from zbuf_occlude.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.meshes.files import load_mesh
from zbuf_occlude.sampling import SurfacePoints, sample_surface
from zbuf_occlude.scenes import Scene
from zbuf_occlude.sensors import scan
from zbuf_occlude.views import Views
from zbuf_occlude.visibility import METHODS, prepare

__version__ = "0.1.0"

numba_cache.ensure_writable()  # before any module compiles a function

__all__ = [
    "METHODS",
    "ArgumentError",
    "DatasetError",
    "GlError",
    "Mesh",
    "MeshCollection",
    "MeshError",
    "OccludeError",
    "OptionError",
    "Scene",
    "SurfacePoints",
    "UnavailableError",
    "Views",
    "load_mesh",
    "prepare",
    "sample_surface",
    "scan",
    "scenes",
    "sensors",
    "views",
]

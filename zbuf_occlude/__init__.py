"""zbuf_occlude: complete triangle meshes in, occluded point clouds out.

    cloud = zo.occlude("chair.off", azimuth=30, elevation=20, n_points=2048)
    cloud.save("partial.ply")

    mesh -> surface points -> views -> visibility mask -> occluded cloud -> dataset

Importing this package opens no GPU and imports no dependency: each name is loaded when it is first used.
"""

import importlib
import typing

from zbuf_occlude.base import interrupts

interrupts.end_quietly()

if typing.TYPE_CHECKING:  # at run time `__getattr__` loads each name when it is first used
    from zbuf_occlude import sensors, views
    from zbuf_occlude.base.errors import (
        ArgumentError,
        DatasetError,
        GlError,
        MeshError,
        OccludeError,
        OptionError,
        UnavailableError,
    )
    from zbuf_occlude.datasets.real.crops import crop_objects
    from zbuf_occlude.geometry.mesh import Mesh
    from zbuf_occlude.meshes.collection import MeshCollection
    from zbuf_occlude.meshes.load import load_mesh
    from zbuf_occlude.meshes.sampling import SurfacePoints, sample_surface
    from zbuf_occlude.partial import PartialCloud, depth_image, occlude
    from zbuf_occlude.sensors import Frame, frames, scan, scenes, write_bop, write_frames
    from zbuf_occlude.sensors.inspection import coverage, visible_faces
    from zbuf_occlude.sensors.scenes import Scene
    from zbuf_occlude.sensors.scenes.occlusion_graph import occlusion_graph
    from zbuf_occlude.studies.compare.scan_comparison import compare_scans
    from zbuf_occlude.studies.learn.models import load_classifier
    from zbuf_occlude.views import Views
    from zbuf_occlude.visibility import METHODS, prepare
    from zbuf_occlude.visibility.visible_space import blockers, visibility_grid
    from zbuf_occlude.visibility.visible_surface import visible_mesh, visible_vertices

__version__ = "0.1.0"

__all__ = [
    "METHODS",
    "ArgumentError",
    "DatasetError",
    "Frame",
    "GlError",
    "Mesh",
    "MeshCollection",
    "MeshError",
    "OccludeError",
    "OptionError",
    "PartialCloud",
    "Scene",
    "SurfacePoints",
    "UnavailableError",
    "Views",
    "blockers",
    "compare_scans",
    "coverage",
    "crop_objects",
    "depth_image",
    "frames",
    "load_classifier",
    "load_mesh",
    "occlude",
    "occlusion_graph",
    "prepare",
    "sample_surface",
    "scan",
    "scenes",
    "sensors",
    "views",
    "visibility_grid",
    "visible_faces",
    "visible_mesh",
    "visible_vertices",
    "write_bop",
    "write_frames",
]

_HOMES = {
    "base.errors": (
        "ArgumentError",
        "DatasetError",
        "GlError",
        "MeshError",
        "OccludeError",
        "OptionError",
        "UnavailableError",
    ),
    "studies.compare.scan_comparison": ("compare_scans",),
    "datasets.real.crops": ("crop_objects",),
    "studies.learn.models": ("load_classifier",),
    "geometry.mesh": ("Mesh",),
    "meshes.collection": ("MeshCollection",),
    "meshes.load": ("load_mesh",),
    "partial": ("PartialCloud", "depth_image", "occlude"),
    "meshes.sampling": ("SurfacePoints", "sample_surface"),
    "sensors.inspection": ("coverage", "visible_faces"),
    "sensors.scenes": ("Scene",),
    "sensors.scenes.occlusion_graph": ("occlusion_graph",),
    "sensors": ("Frame", "frames", "scan", "scenes", "write_bop", "write_frames"),
    "views": ("Views",),
    "visibility": ("METHODS", "prepare"),
    "visibility.visible_space": ("blockers", "visibility_grid"),
    "visibility.visible_surface": ("visible_mesh", "visible_vertices"),
}
"""Public names by module."""
_MODULES = {"sensors": "sensors", "torch": "datasets.torch", "views": "views"}
"""Public modules; `torch` is not in `__all__`, because it needs an extra."""


def __getattr__(name: str) -> typing.Any:
    """Load a public name when it is first used."""
    if name in _MODULES:
        return importlib.import_module(f"{__name__}.{_MODULES[name]}")
    home = next((module for module, names in _HOMES.items() if name in names), None)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__", "torch"])

"""The table of formats: those in which workers write clouds, and published layouts that are exported from these.

A format's module, in this folder, has

    file_name(split, number) -> str                 name of a file
    write(path, records, plan, number) -> FileDigest  writes the clouds of a file, whole or not at all
    read(out, plan, files) -> CloudReader           reads clouds back, when and as far as they are asked for
    finish(out, plan, names)                        optional: writes lists of files

The module of `packed`, which keeps whole objects, has `archive_name` and `Shard` instead of `file_name` and `write`.

A layout's module, in `zbuf_occlude.datasets.export`, has

    export(source, out) -> Exported                 writes all files, from the clouds of a dataset
    check(plan)                                     optional: raises if loaders could not read what the plan gives
    read(out, plan, files) -> CloudReader           optional: reads clouds back, to be looked at
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.base.errors import OptionError, find_row
from zbuf_occlude.datasets.plan import ATTRIBUTES, BOXES, CLASSES_OF, DatasetConfig, Plan
from zbuf_occlude.meshes.collection import MeshCollection
from zbuf_occlude.sensors.scan_config import span_of


@dataclass(frozen=True)
class Format:
    """One row of the table of formats. Its module is imported when the format is used, not before."""

    name: str  # and name of its module, unless `module` is given
    summary: str
    exported_from: str = ""  # format of the clouds that a layout is made from; `packed` where it needs whole objects
    whole_objects: bool = False  # keeps all points of the objects, rounded, and not only those drawn for each cloud
    attributes: tuple[str, ...] = ATTRIBUTES  # attributes that its clouds may have
    complete: bool = False  # holds clouds of whole surfaces alone
    of_views: bool = False  # holds clouds of views alone, no complete ones
    from_meshes: bool = False  # its export reads the meshes again, so that nothing is converted to it
    ragged: bool = False  # its clouds may be of unequal size (`--sample-size all`)
    least_tested: int = 0  # test clouds below which the loaders' own test ends in an error
    axes: tuple[str, str, str] = ("x", "y", "z")  # axes of its frame, in those of the frame "object", z up
    longest_side: float = 1.0  # length in its frame of the side that is scaled to 1
    options: Mapping[str, Any] = field(default_factory=dict)  # defaults of `generate`, by its parameters' names
    module: str = ""  # module of its functions, or after a colon the object there that has them as methods

    @property
    def class_list(self) -> tuple[str, ...]:
        """Classes that its labels count, a published list; () where they count those of the meshes."""
        return CLASSES_OF.get(self.name, ())

    @property
    def storage(self) -> "Format":
        """The format of the files that workers write."""
        return find_format(self.exported_from) if self.exported_from else self

    @property
    def keeps_points(self) -> bool:
        """True where all points of the objects are kept for it."""
        return self.storage.whole_objects

    def load(self) -> Any:
        """Import the format's module; return the module or the object that has its functions."""
        folder = "export" if self.exported_from else "formats"
        place, _, name = (self.module or f"{folder}.{self.name}").partition(":")
        module = import_module(f"zbuf_occlude.datasets.{place}")
        return getattr(module, name) if name else module

    def names(self, plan: Plan) -> Iterator[str]:
        """Yield the names of all files that shards of a plan may have."""
        module = self.storage.load()
        if self.keeps_points:
            yield from map(module.archive_name, range(len(plan.shards)))
        else:
            yield from (module.file_name(file.split, file.number) for file in plan.files)

    def choose_meshes(self, meshes: MeshCollection) -> MeshCollection:
        """Return the meshes of its classes, with a remark on those left out; OptionError where none is of them."""
        outside = self._outside(meshes)
        if not outside:
            return meshes
        found = [entry for entry in meshes if entry.label in self.class_list]
        if not found:
            raise OptionError(
                f"{self.name} must have meshes of its {len(self.class_list)} classes, {', '.join(self.class_list)}; "
                f"got {outside}. Name them so by --labels FILE."
            )
        left_out = f"{len(meshes) - len(found):,} of {len(meshes):,} meshes are left out"
        return MeshCollection(found, (*meshes.remarks, f"{self.name} has no class {outside}: {left_out}"))

    def _outside(self, meshes: MeshCollection) -> str:
        """Return the names of the classes that its labels do not count; "" for none."""
        outside = [label for label in meshes.classes if label not in self.class_list] if self.class_list else []
        return ", ".join(outside[:10]) + (f" and {len(outside) - 10} more" if len(outside) > 10 else "")

    def axes_in(self, frame: str) -> tuple[str, str, str]:
        """Return the axes of its clouds, by those of `frame`: its own, or those where these were chosen."""
        return self.axes if frame == "object" else ("x", "y", "z")

    def to_frame(self, config: DatasetConfig) -> NDArray[np.float32]:
        """Return the matrix (3, 3) from a configuration's frame to its own; chosen axes and a mesh's scale stay."""
        axes = self.axes_in(config.frame)
        turned = np.array([np.eye(3)["xyz".index(axis[-1])] * (-1 if axis[0] == "-" else 1) for axis in axes])
        return (turned * (1.0 if config.scale in ("metres", "mesh") else self.longest_side)).astype(np.float32)

    def check(self, plan: Plan) -> None:
        """Raise OptionError or UnavailableError unless a plan can be written in this format."""
        if plan.config.sample_size is None and not self.ragged:
            raise OptionError(
                f"--format {self.name} holds clouds of one size; got --sample-size all. Give a number of points, or "
                f"choose {', '.join(row.name for row in FORMATS if row.ragged)}."
            )
        for name in plan.config.attributes:
            if name not in self.attributes:
                formats = " or ".join(row.name for row in FORMATS if name in row.attributes)
                raise OptionError(f"{name} must go with --format {formats}; got {self.name}. Leave them out.")
        if plan.config.complete and self.of_views:
            formats = ", ".join(row.name for row in FORMATS if not row.of_views)
            raise OptionError(
                f"--format {self.name} holds what views see; got --complete. Leave it out, or choose {formats}."
            )
        if outside := self._outside(plan.meshes):
            raise OptionError(f"{self.name} must have meshes of its classes alone; got {outside}. Leave them out.")
        getattr(self.load(), "check", lambda plan: None)(plan)

    def finish(self, out: Path, plan: Plan, names: Mapping[str, list[str]]) -> None:
        """Write the lists of files that its loaders begin with, if any; `names` has those of the files by split."""
        getattr(self.load(), "finish", lambda *arguments: None)(out, plan, names)

    def redrawn(self, config: DatasetConfig) -> DatasetConfig:
        """Return the configuration with which clouds of this format are drawn from all points of objects."""
        drawn = {name: value for name, value in self.options.items() if name in ("sample_size", "scale", "overlap")}
        if config.scale != "cloud":
            drawn.pop("scale", None)
        if drawn.get("sample_size") == "all":
            drawn["sample_size"] = None
        if "overlap" in drawn:
            drawn["overlap"] = config.overlap or span_of("overlap", drawn["overlap"])
        return replace(config, complete=self.complete or config.complete, **drawn)


Y_UP, MIRRORED = ("x", "z", "-y"), ("-x", "z", "y")
_WITH_BOXES = (*ATTRIBUTES, BOXES)
_WHOLE_SCANS = {"keep": "all", "sample_size": "all", "scale": "mesh"}
_OF_A_CAMERA = {**_WHOLE_SCANS, "sensor": "pinhole:width=640,height=480,fov=32", "size": "file"}


def _layout_of_pairs(name: str, summary: str, views: str, **values: Any) -> Format:
    """Return the row of a layout of partial and complete clouds, in `export/completion.py`."""
    options = {"views": views, "scale": "object", **values.pop("options", {})}
    module = "export.completion:" + name.replace("-", "_").upper()
    given: dict[str, Any] = {"exported_from": "packed", "axes": Y_UP, "of_views": not values.get("complete"), **values}
    return Format(name, summary, **given, options=options, module=module)


FORMATS: tuple[Format, ...] = (
    Format(
        "hdf5",
        "the PointNet layout: data (n, size, 3) and label, 2,048 clouds per file",
        ragged=True,
        attributes=_WITH_BOXES,
    ),
    Format(
        "packed",
        "all points of the objects and a bit for each point and view: some fifty times as many clouds in a megabyte",
        whole_objects=True,
        ragged=True,
        module="packed",
    ),
    Format("webdataset", "tar shards for streaming", ragged=True),
    Format("npz", "NumPy archives of 2,048 clouds", ragged=True),
    Format("ply", "a file for each cloud, for viewers", "hdf5", ragged=True),
    Format(
        "frames",
        "pictures of each view: depth, mask, normals, instances, colours; transforms.json, cameras.json",
        "hdf5",
        from_meshes=True,
        ragged=True,
        options=_OF_A_CAMERA,
        of_views=True,
        module="export.renderings:FRAMES",
    ),
    Format(
        "bop",
        "scenes of several objects for 6D poses: rgb, depth, mask, mask_visib, models, scene_gt.json",
        "hdf5",
        from_meshes=True,
        ragged=True,
        options={**_WHOLE_SCANS, "sensor": "pinhole:width=640,height=480,fov=50"},
        of_views=True,
        module="export.renderings:BOP",
    ),
    Format(
        "organized-pcd",
        "organised clouds of each view, NaN where nothing is measured: PCD, camera_info.yaml, cameras.json",
        "hdf5",
        from_meshes=True,
        ragged=True,
        options=_OF_A_CAMERA,
        of_views=True,
        module="export.renderings:ORGANIZED",
    ),
    Format(
        "mcap",
        "messages of ROS 2: PointCloud2, CameraInfo, Image of colour and depth, TF",
        "hdf5",
        from_meshes=True,
        ragged=True,
        options=_OF_A_CAMERA,
        of_views=True,
        module="export.renderings:MCAP",
    ),
    Format(
        "kitti",
        "LiDAR frames with labelled boxes: velodyne, label_2, calib, image_2, ImageSets",
        "hdf5",
        attributes=_WITH_BOXES,
        ragged=True,
        options={
            **_WHOLE_SCANS,
            "sensor": "hdl-64e",
            "scene": "street",
            "range_": "6..40",
            "views": "ring:8@0",
            "attributes": "boxes",
        },
        of_views=True,
        module="export.kitti",
    ),
    Format("huggingface", "Parquet shards and a card, for datasets.load_dataset", "hdf5", ragged=True),
    Format(
        "scanobjectnn",
        "data, label, mask; 15 classes",
        "hdf5",
        axes=Y_UP,
        module="export.classification:SCANOBJECTNN",
    ),
    Format(
        "modelnet40-c",
        "data_occlusion_VIEW.npy, label.npy; 40 classes",
        "hdf5",
        axes=MIRRORED,
        longest_side=2.0,
        module="export.classification:MODELNET40_C",
    ),
    Format(
        "modelnet-o",
        "CLASS/{train,test}/OBJECT_NUMBER.xyz; 40 classes",
        "hdf5",
        options={"scale": "object"},
        module="export.classification:MODELNET_O",
    ),
    Format(
        "modelnet40-normal",
        "CLASS/CLASS_NUMBER.txt: x,y,z[,nx,ny,nz]; 40 classes",
        "hdf5",
        axes=MIRRORED,
        module="export.classification:MODELNET40_NORMAL",
    ),
    _layout_of_pairs(
        "pcn",
        "pairs as PCD files, 16,384 complete points, 8 views",
        "fibonacci:8",
        least_tested=10,
        ragged=True,
    ),
    _layout_of_pairs(
        "completion3d",
        "pairs as HDF5 files, 2,048 points, 1 view",
        "random:1",
        least_tested=10,
        options={"sample_size": 2_048},
    ),
    _layout_of_pairs(
        "mvp",
        "pairs in HDF5, 2,048 points, 26 views; 16 classes",
        "fibonacci:26",
        options={"sample_size": 2_048},
    ),
    _layout_of_pairs(
        "epn3d",
        "pairs as arrays, 2,048 points, 6 views",
        "fibonacci:6",
        options={"sample_size": 2_048},
    ),
    Format(
        "voxels",
        "partial and complete signed distances, 32 voxels a side, for PatchComplete",
        "hdf5",
        from_meshes=True,
        axes=Y_UP,
        options={"views": "fibonacci:8"},
        of_views=True,
        module="export.voxels",
    ),
    Format(
        "pairs",
        "pairs of views for registration, as MVP's benchmark has them",
        "packed",
        axes=Y_UP,
        options={"views": "fibonacci:26", "scale": "object", "overlap": "0.3..0.7"},
        of_views=True,
        module="export.registration",
    ),
    _layout_of_pairs(
        "projected-shapenet",
        "pairs as PCD files and arrays, 8,192 complete points, 16 views",
        "fibonacci:16",
        ragged=True,
    ),
    _layout_of_pairs(
        "shapenet55",
        "complete clouds of 8,192 points",
        "ring:1@0",
        exported_from="hdf5",
        complete=True,
        least_tested=10,
        options={"sample_size": 8_192},
    ),
)


def find_format(name: str) -> Format:
    """Return the row of a name; an unknown one is an OptionError."""
    return find_row("format", name, FORMATS)

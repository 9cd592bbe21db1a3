"""Sequences: drives in the layouts of published datasets.

A layout is a module with `write(out, sequence, rig, sweeps)`, which writes the sweeps of a drive as they come and
yields each when it is written, and `check(out, sequence, rig)`, which raises before any work where it cannot.
"""

from importlib import import_module
from types import MappingProxyType
from typing import Any

LAYOUTS = MappingProxyType({
    "semantickitti": "SemanticKITTI: velodyne, labels, poses, times, calibration; the sensors of a rig in one cloud",
    "nuscenes": "nuScenes: tables, key frames and sweeps of each LiDAR, boxes",
})  # fmt: skip
"""The layouts and what they hold."""


def load_layout(name: str) -> Any:
    """Return the module of a layout."""
    return import_module(f"zbuf_occlude.datasets.sequences.{name}")

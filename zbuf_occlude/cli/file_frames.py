"""Messages on the frame of files that were read: up axis, unit, and a warning where meshes lie on their side."""

from collections.abc import Sequence
from pathlib import Path

from zbuf_occlude.cli.shell import echo
from zbuf_occlude.geometry.mesh import Mesh
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.meshes.load import default_up
from zbuf_occlude.meshes.stance import Stances, stances, stands_on
from zbuf_occlude.sensors.scan_config import ScanConfig
from zbuf_occlude.sensors.scenes.sizes import FILE


def taken_as(entries: Sequence[MeshEntry], up: str | None, unit: str | None, lengths: str = "") -> str:
    """Return a text on the up axis and the unit of the files of some meshes; "" where none is from a file.

    `lengths` is the text on lengths where they do not follow from the files.
    """
    axes = {entry.up for entry in entries if entry.path is not None}
    if not axes:
        return ""
    if up is not None:
        axis = f"{up} up, as --up says"
    elif axes == {"y"}:
        axis = "y up, as their format or layout says"
    else:
        axis = "z up, assumed (else give --up y)" + (", y of some by their format or layout" if "y" in axes else "")
    in_unit = f"in {unit}, lengths are metres" if unit else "lengths in their own unit (metres with --unit)"
    return f"{axis}; {lengths or in_unit}"


def lengths_of(scan: ScanConfig | None, unit: str | None) -> str:
    """Return a text on the lengths of meshes for a sensor; "" without a sensor or with a unit."""
    if scan is None or unit is not None:
        return ""
    if scan.size == FILE:
        return "metres by --size file (else give --unit)"
    return "metres by --size or class (else give --unit)"


def print_frame(path: Path, mesh: Mesh, up: str | None, unit: str | None) -> None:
    """Print the frame of a file and the length of its mesh; warn where the mesh seems to lie on its side."""
    assumed = up is None and default_up(path) == "z"
    axis = "z up, assumed (else give --up y)" if assumed else f"{up or 'y'} up"
    length = f"{mesh.longest_side:.4g}" + (f" m long, as it is in {unit}" if unit else " long, in its own unit")
    echo(f"{path} read as: {axis}; {length}")
    if assumed and stands_on(mesh) == "y":
        _warn(Stances(1, 0, 1))


def warn_of_lying(entries: Sequence[MeshEntry], up: str | None) -> None:
    """Warn where most meshes seem to lie on their side and no up axis was given."""
    assumed = [entry for entry in entries if entry.path is not None and entry.up == "z"]
    if up is None and assumed and (found := stances(assumed)).suggest_y_up:
        _warn(found)


def _warn(found: Stances) -> None:
    """Print the warning of meshes that seem to lie on their side."""
    if found.n == 1:
        said = "the mesh seems to lie on its side: it stands on its y axis"
    else:
        said = f"most meshes seem to lie on their side: of {found.n} checked, {found.on_y} stand on their y axis, "
        said += f"{found.on_z} on z"
    echo(f"warning: {said}. Give --up y; or --up z where z is up.", err=True)

"""Commands `methods`, `sensors` and `doctor`: tables of methods and sensors, and a check of this machine."""

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click
import numpy as np

from zbuf_occlude import sensors
from zbuf_occlude.base import atomic
from zbuf_occlude.base.errors import UnavailableError
from zbuf_occlude.base.extras import tried
from zbuf_occlude.cli.shared_options import suffix_of
from zbuf_occlude.cli.shell import Command, echo
from zbuf_occlude.engines.gl.context import ENVIRONMENT
from zbuf_occlude.engines.gl.devices import FIXES
from zbuf_occlude.engines.gl.probe import Probe, probe_all
from zbuf_occlude.sensors import Sensor
from zbuf_occlude.visibility import METHODS
from zbuf_occlude.visibility.interface import Method


@click.command(cls=Command)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def methods_command(as_json: bool) -> None:
    """List the methods of hidden-surface removal.

    An exact method equals the oracle on every point outside the boundary band (docs/conventions.md).
    """
    rows: list[dict[str, Any]] = []
    for method in METHODS:
        try:
            options = method.options()
        except UnavailableError:
            options = {}
        rows.append(
            {
                "name": method.name,
                "summary": method.summary,
                "exact": method.exact,
                "needs_gl": method.needs_gl,
                "extra": method.extra,
                "missing": method.missing(),
                "ray_casting_unsupported_reason": method.ray_casting_unsupported_reason,
                "options": options,
            }
        )
    if as_json:
        echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        flags = (
            ("exact", row["exact"]),
            ("GL", row["needs_gl"]),
            ("first hits", not row["ray_casting_unsupported_reason"]),
        )
        tags = ", ".join(tag for tag, on in flags if on)
        echo(f"{row['name']}{f'  [{tags}]' if tags else ''}\n    {row['summary']}")
        if row["options"]:
            echo("    --set " + " ".join(f"{name}={default}" for name, default in row["options"].items()))
        if row["missing"]:
            echo(f"    cannot run here: {row['missing']}")


MAX_SHOWN = 8
"""Maximum entries printed of a list of numbers."""


@click.command(cls=Command)
@click.argument("name", required=False)
@click.option("--picture", type=click.Path(path_type=Path), help="Plot of the rays as PNG; needs NAME.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def sensors_command(name: str | None, picture: Path | None, as_json: bool) -> None:
    """List the sensors, or show all parameters of one with their sources.

    NAME is one of the list, a YAML or CSV file of your own (see docs/sensors.md), or a name with parameters, such as
    pinhole:width=320,height=240,fov=60.

    \b
    Examples:
      zbuf-occlude sensors
      zbuf-occlude sensors vlp-32c --picture vlp-32c.png
    """
    if picture is not None and name is None:
        raise click.UsageError("--picture needs NAME, the sensor whose rays it shows.")
    if picture is not None:
        suffix_of(picture, (".png",))
    table = list(sensors.SENSORS.values()) if name is None else [sensors.make(name)]
    if as_json:
        echo(json.dumps([_document(sensor) for sensor in table], indent=2))
    elif name is None:
        for sensor in table:
            echo(f"{sensor.name:20} {sensor.kind:14} {sensor.summary}")
    else:
        echo("\n".join(_sensor_lines(table[0])))
    if picture is not None:
        _plot_rays(table[0], picture)
        echo(f"its {len(table[0].rays()):,} rays: {picture}")


def _document(sensor: Sensor) -> dict[str, Any]:
    numbers = {
        name: {"value": value, "source": sensor.sources.get(name, "")} for name, value in sensor.numbers().items()
    }
    return {"name": sensor.name, "kind": sensor.kind, "summary": sensor.summary, "numbers": numbers}


def _sensor_lines(sensor: Sensor) -> list[str]:
    rays = sensor.rays()
    elevations = np.degrees(np.arcsin(rays.directions[:, 2]))
    lines = [
        f"{sensor.name} ({sensor.kind}): {sensor.summary}",
        f"{len(rays):,} rays, elevations {elevations.min():.2f} to {elevations.max():.2f} degrees",
    ]
    for name, value in sensor.numbers().items():
        source = sensor.sources.get(name, "")
        lines.append(f"  {name} = {_format_value(value)}" + (f"    [{source}]" if source else ""))
    return lines


def _format_value(value: Any) -> str:
    if isinstance(value, list):
        shown = ", ".join(map(_format_value, value[:MAX_SHOWN]))
        return f"[{shown}, ... {len(value)} in all]" if len(value) > MAX_SHOWN else f"[{shown}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _plot_rays(sensor: Sensor, path: Path) -> None:
    from zbuf_occlude.drawing.pictures import blank_figure

    rays = sensor.rays()
    azimuth = np.degrees(np.arctan2(rays.directions[:, 1], rays.directions[:, 0]))
    elevation = np.degrees(np.arcsin(rays.directions[:, 2]))
    figure = blank_figure(10, 4.5)
    whole, near = figure.subplots(1, 2)
    middle = float(np.median(elevation))
    for axes, half in ((whole, None), (near, 3.0)):
        within = np.ones(len(rays), bool) if half is None else (abs(azimuth) < half) & (abs(elevation - middle) < half)
        step = max(1, int(within.sum()) // 60_000)
        shown = np.flatnonzero(within)[::step]
        axes.scatter(
            azimuth[shown], elevation[shown], s=0.5 if half is None else 6, c=rays.rings[shown], cmap="viridis"
        )
        axes.set_xlabel("azimuth, degrees")
        axes.set_ylabel("elevation, degrees")
        axes.invert_xaxis()  # as seen from the sensor
    whole.set_title(f"{sensor.name}: {len(rays):,} rays, coloured by ring", fontsize=10)
    near.set_title("the middle six degrees", fontsize=10)
    near.set_aspect("equal")
    atomic.write(path, lambda file: figure.savefig(file, format="png", dpi=110))


@click.command(cls=Command)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def doctor_command(as_json: bool) -> None:
    """Report which OpenGL backends work, their renderers, and which methods can run.

    Every backend, and every package that a method needs, is tried in a separate process. ZBUF_OCCLUDE_GL (egl, osmesa,
    or egl:INDEX) selects a backend; without it the first one that works is used. The exit code is 0 where `generate`
    can run, by depth_buffer or by exact (which needs no OpenGL), else 1.
    """
    probes = probe_all()
    named = os.environ.get(ENVIRONMENT, "").strip()
    works = any(probe.works for probe in probes if is_selected(probe, named))
    no_gl = "" if works else "needs OpenGL; see above"
    compiled = tried("numba", "zbuf_occlude.engines.exact.bvh")
    methods = {
        method.name: reason_missing(method) or (no_gl if method.needs_gl else "") or compiled for method in METHODS
    }
    able = next((name for name in ("depth_buffer", "exact") if not methods[name]), "")
    if as_json:
        echo(json.dumps({"gl": [asdict(p) for p in probes], "methods": methods}, indent=2))
    else:
        echo("OpenGL backends")
        for probe in probes:
            echo("\n".join(backend_lines(probe)))
        if named:
            echo(f"  {ENVIRONMENT} names {named}, which {'works' if works else 'does not work'}")
        echo("methods")
        for name, reason in methods.items():
            echo(f"  {name:22} {reason or 'ready'}")
        verdict = f"can run: {able} is its default here" if able else f"cannot run: exact {methods['exact']}"
        echo(f"generate {verdict}")
        if able == "exact":
            echo(
                "  exact is complete: no method is more exact, and without a GPU none is faster. depth_buffer is meant "
                f"for a GPU; on Debian: {FIXES['egl']}"
            )
    if not able:
        raise SystemExit(1)


def is_selected(probe: Probe, named: str) -> bool:
    """Return whether a probe is of the backend that the environment names; True where it names none."""
    backend, _, index = named.partition(":")
    return not named or (probe.backend == backend and index in ("", str(probe.device_index)))


def reason_missing(method: Method) -> str:
    """Return the reason why a method cannot run here, or ""; its package is imported in a separate process."""
    return method.missing() or (tried(method.requires, method.module) if method.requires else "")


def backend_lines(probe: Probe) -> list[str]:
    """Return the lines of the report on one backend."""
    place = probe.backend if probe.device_index is None else f"{probe.backend}, device {probe.device_index}"
    if not probe.works:
        lines = [f"  {place}: does not work: {probe.reason}"]
    else:
        facts: list[Any] = ["software" if probe.is_software else "hardware"]
        facts += [] if probe.cuda_device is None else [f"CUDA device {probe.cuda_device}"]
        lines = [f"  {place}: works ({', '.join(facts)})", f"    {probe.renderer}, OpenGL {probe.version}"]
        lines += [f"    {probe.reason}"] if probe.reason else []
    return [*lines, *([f"    fix: {probe.fix}"] if probe.fix else [])]

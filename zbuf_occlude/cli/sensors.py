"""`zbuf-occlude sensors`: the table of sensors, one sensor's numbers with their sources, a picture of its rays."""

import json
from pathlib import Path
from typing import Any

import click
import numpy as np

from zbuf_occlude import sensors
from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.options import suffix_of
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.sensors import Sensor

MOST_SHOWN = 8
"""Of a number that is a list, this many entries are printed."""


@click.command(cls=Command)
@click.argument("name", required=False)
@click.option("--picture", type=click.Path(path_type=Path), help="Where the rays go, as a PNG; needs NAME.")
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def command(name: str | None, picture: Path | None, as_json: bool) -> None:
    """List the sensors, or show all numbers of one, each with where it is from.

    NAME is one of the list, a YAML or CSV file of your own (docs/sensors.md says how), or a name with numbers, such as
    pinhole:width=320,height=240,fov=60.

    \b
    Examples:
      zbuf-occlude sensors
      zbuf-occlude sensors vlp-32c --picture vlp-32c.png
    """
    if picture is not None and name is None:
        raise click.UsageError("--picture shows one sensor's rays; name the sensor.")
    if picture is not None:
        suffix_of(picture, (".png",))
    table = list(sensors.SENSORS.values()) if name is None else [sensors.make(name)]
    if as_json:
        echo(json.dumps([_document(sensor) for sensor in table], indent=2))
    elif name is None:
        for sensor in table:
            echo(f"{sensor.name:20} {sensor.kind:9} {sensor.summary}")
    else:
        echo("\n".join(_described(table[0])))
    if picture is not None:
        _draw(table[0], picture)
        echo(f"its {len(table[0].rays()):,} rays: {picture}")


def _document(sensor: Sensor) -> dict[str, Any]:
    numbers = {
        name: {"value": value, "source": sensor.sources.get(name, "")} for name, value in sensor.numbers().items()
    }
    return {"name": sensor.name, "kind": sensor.kind, "summary": sensor.summary, "numbers": numbers}


def _described(sensor: Sensor) -> list[str]:
    rays = sensor.rays()
    elevations = np.degrees(np.arcsin(rays.directions[:, 2]))
    lines = [
        f"{sensor.name} ({sensor.kind}): {sensor.summary}",
        f"{len(rays):,} rays, elevations {elevations.min():.2f} to {elevations.max():.2f} degrees",
    ]
    for name, value in sensor.numbers().items():
        source = sensor.sources.get(name, "")
        lines.append(f"  {name} = {_short(value)}" + (f"    [{source}]" if source else ""))
    return lines


def _short(value: Any) -> str:
    if isinstance(value, list):
        shown = ", ".join(map(_short, value[:MOST_SHOWN]))
        return f"[{shown}, ... {len(value)} in all]" if len(value) > MOST_SHOWN else f"[{shown}]"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _draw(sensor: Sensor, path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rays = sensor.rays()
    azimuth = np.degrees(np.arctan2(rays.directions[:, 1], rays.directions[:, 0]))
    elevation = np.degrees(np.arcsin(rays.directions[:, 2]))
    figure = Figure(figsize=(10, 4.5), layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
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
        axes.invert_xaxis()  # as one looks out of the sensor
    whole.set_title(f"{sensor.name}: {len(rays):,} rays, coloured by ring", fontsize=10)
    near.set_title("six degrees of it", fontsize=10)
    near.set_aspect("equal")
    figure.savefig(path, format="png", dpi=110)

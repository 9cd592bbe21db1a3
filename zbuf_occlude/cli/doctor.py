"""`zbuf-occlude doctor`: what works on this machine, and the one command that would fix what does not."""

import json
from dataclasses import asdict
from typing import Any

import click

from zbuf_occlude.gl.probe import Probe, probe_all
from zbuf_occlude.visibility import METHODS


@click.command()
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def command(as_json: bool) -> None:
    """Say which OpenGL backends work, on which renderer, and which methods can run.

    Every backend is tried in a process of its own. ZBUF_OCCLUDE_GL chooses one (egl, osmesa, or egl:INDEX).
    Exit code 0 when a backend works, 1 when none does.
    """
    probes = probe_all()
    methods = {method.name: verdict(method.missing(), method.needs_gl, probes) for method in METHODS}
    if as_json:
        click.echo(json.dumps({"gl": [asdict(p) for p in probes], "methods": methods}, indent=2))
    else:
        click.echo("OpenGL backends")
        for probe in probes:
            click.echo("\n".join(describe(probe)))
        click.echo("methods")
        for name, reason in methods.items():
            click.echo(f"  {name:22} {reason or 'ready'}")
    if not any(probe.works for probe in probes):
        raise SystemExit(1)


def verdict(missing: str, needs_gl: bool, probes: tuple[Probe, ...]) -> str:
    """Say why a method cannot run; empty when it can."""
    if missing:
        return missing
    return "needs OpenGL; see above" if needs_gl and not any(probe.works for probe in probes) else ""


def describe(probe: Probe) -> list[str]:
    """Say what is known of one backend, a line for each fact."""
    place = probe.backend if probe.device_index is None else f"{probe.backend}, device {probe.device_index}"
    if not probe.works:
        lines = [f"  {place}: does not work: {probe.reason}"]
    else:
        facts: list[Any] = ["software" if probe.is_software else "hardware"]
        facts += [] if probe.cuda_device is None else [f"CUDA device {probe.cuda_device}"]
        lines = [f"  {place}: works ({', '.join(facts)})", f"    {probe.renderer}, OpenGL {probe.version}"]
    return [*lines, *([f"    fix: {probe.fix}"] if probe.fix else [])]

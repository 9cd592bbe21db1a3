"""`zbuf-occlude doctor`: what works on this machine, and the one command that would fix what does not."""

import json
import os
from dataclasses import asdict
from typing import Any

import click

from zbuf_occlude.cli.echo import echo
from zbuf_occlude.cli.panels import Command
from zbuf_occlude.extras import tried
from zbuf_occlude.gl.context import ENVIRONMENT
from zbuf_occlude.gl.probe import Probe, probe_all
from zbuf_occlude.visibility import METHODS
from zbuf_occlude.visibility.interface import Method


@click.command(cls=Command)
@click.option("--json", "as_json", is_flag=True, help="As JSON, for programs.")
def command(as_json: bool) -> None:
    """Say which OpenGL backends work, on which renderer, and which methods can run.

    Every backend, and every package that a method needs, is tried in a process of its own. Without ZBUF_OCCLUDE_GL
    (egl, osmesa, or egl:INDEX) the first backend that works is taken. Exit code 0 when that, or the one that
    ZBUF_OCCLUDE_GL names, works, 1 when not.
    """
    probes = probe_all()
    named = os.environ.get(ENVIRONMENT, "").strip()
    works = any(probe.works for probe in probes if serves(probe, named))
    no_gl = "" if works else "needs OpenGL; see above"
    methods = {method.name: lacking(method) or (no_gl if method.needs_gl else "") for method in METHODS}
    if as_json:
        echo(json.dumps({"gl": [asdict(p) for p in probes], "methods": methods}, indent=2))
    else:
        echo("OpenGL backends")
        for probe in probes:
            echo("\n".join(describe(probe)))
        if named:
            echo(f"  {ENVIRONMENT} names {named}, which {'works' if works else 'does not work'}")
        echo("methods")
        for name, reason in methods.items():
            echo(f"  {name:22} {reason or 'ready'}")
    if not works:
        raise SystemExit(1)


def serves(probe: Probe, named: str) -> bool:
    """Whether a probe is of the backend that the environment names, if it names one."""
    backend, _, index = named.partition(":")
    return not named or (probe.backend == backend and index in ("", str(probe.device_index)))


def lacking(method: Method) -> str:
    """Say what a method needs and this machine lacks; its package is imported in a process of its own."""
    module, _, _ = method.factory.partition(":")
    return method.missing() or (tried(method.requires, module) if method.requires else "")


def describe(probe: Probe) -> list[str]:
    """Say what is known of one backend, a line for each fact."""
    place = probe.backend if probe.device_index is None else f"{probe.backend}, device {probe.device_index}"
    if not probe.works:
        lines = [f"  {place}: does not work: {probe.reason}"]
    else:
        facts: list[Any] = ["software" if probe.is_software else "hardware"]
        facts += [] if probe.cuda_device is None else [f"CUDA device {probe.cuda_device}"]
        lines = [f"  {place}: works ({', '.join(facts)})", f"    {probe.renderer}, OpenGL {probe.version}"]
        lines += [f"    {probe.reason}"] if probe.reason else []
    return [*lines, *([f"    fix: {probe.fix}"] if probe.fix else [])]

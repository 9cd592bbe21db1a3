"""Programs in processes of their own, and waiting for the end of processes that are not ours to wait for."""

import os
import select
import subprocess
import sys
from pathlib import Path
from textwrap import dedent


def python(*arguments: object, cwd: Path | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run this Python, ten minutes at most as kernels may have to be compiled, with these variables besides its own."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        env={**os.environ, **environment},
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def run_program(
    code: str, *arguments: object, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    """Run a program likewise."""
    return python("-c", dedent(code), *arguments, cwd=cwd, **environment)


def ended(pid: int, seconds: float = 30.0) -> bool:
    """Whether a process ends within this many seconds; one that nobody reaped has ended too."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([descriptor], [], [], seconds)[0])
    finally:
        os.close(descriptor)

"""Entry point of ``zbuf-occlude`` and ``python -m zbuf_occlude``, which turns errors into exit codes."""

import gc
import io
import os
import sys

import click

from zbuf_occlude.base import interrupts
from zbuf_occlude.base.errors import OccludeError, OptionError
from zbuf_occlude.base.extras import culprit, reason
from zbuf_occlude.base.limits import memory_allowed
from zbuf_occlude.cli import group
from zbuf_occlude.cli.shell import echo, one_line

FAILED, USAGE, INTERRUPTED = 1, 2, 130
RESUMING = ("compare", "convert", "generate", "paper", "train")
"""Commands that go on, when called again, where they were interrupted."""


def main() -> None:
    """Run the command line; exit 0 done, 1 failed, 2 usage, 3 some meshes failed, 4 time was up, 130 interrupted."""
    gc.set_threshold(100_000, 20, 100)  # rare collections save a quarter of the time to plan 100,000 meshes
    _open_closed_streams()
    # child processes (workers, probes) must not import modules from the current folder
    os.environ["PYTHONSAFEPATH"] = "1"
    # a killed worker leaves a semaphore of numba's, about which Python's resource tracker would warn at exit
    warnings = [os.environ.get("PYTHONWARNINGS", ""), "ignore::UserWarning:multiprocessing.resource_tracker"]
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, warnings))
    # idle threads of NumPy's OpenBLAS would spin for a tenth of a second
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # file names may be in no valid encoding
            stream.reconfigure(errors="backslashreplace")
    try:
        with interrupts.raised():
            code = group.main(prog_name="zbuf-occlude", standalone_mode=False)
    except click.ClickException as error:
        echo(f"error: {one_line(error)}", err=True)
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        resumes = not set(sys.argv[1:2]).isdisjoint(RESUMING)
        again = "what was finished is kept, and the same command resumes" if resumes else "the same command begins anew"
        echo(f"error: interrupted; {again}.", err=True)
        code = INTERRUPTED
    except OptionError as error:
        echo(f"error: {error}", err=True)
        code = USAGE
    except OccludeError as error:
        echo(f"error: {error}", err=True)
        code = FAILED
    except ImportError as error:
        package = culprit(error)
        if not package:
            raise
        echo(f"error: this {reason(package, error)}", err=True)
        code = FAILED
    except MemoryError as error:
        detail = f" ({error})" if str(error) else ""
        echo(f"error: out of memory; the limit is {memory_allowed()}{detail}. Reduce points, views or size.", err=True)
        code = FAILED
    except BrokenPipeError:  # the reader of standard output closed it
        sys.stderr.close()
        code = FAILED
    except OSError as error:  # such as a full disk, or a read-only folder
        echo(f"error: {error.strerror or error}{f': {error.filename}' if error.filename else ''}", err=True)
        code = FAILED
    if "torch" not in sys.modules:  # Triton reports objects that are left at exit
        gc.freeze()  # skip the final garbage collection, a tenth of a second
    sys.exit(code if isinstance(code, int) else 0)


def _open_closed_streams() -> None:
    """Open standard streams that the caller closed on the null device; else the next open file would become one."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # gets the lowest free number, which is this one
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


if __name__ == "__main__":
    main()

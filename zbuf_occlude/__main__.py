"""Entry point of ``zbuf-occlude`` and ``python -m zbuf_occlude``: the only place that turns errors into exit codes."""

import gc
import io
import os
import sys

import click

from zbuf_occlude import interrupts
from zbuf_occlude.cli import group
from zbuf_occlude.cli.shell import echo, one_line
from zbuf_occlude.errors import OccludeError, OptionError
from zbuf_occlude.extras import culprit, reason
from zbuf_occlude.limits import memory_allowed

FAILED, USAGE, INTERRUPTED = 1, 2, 130


def main() -> None:
    """Run the command line; exit 0 done, 1 failed, 2 usage, 3 done but some meshes failed, 130 interrupted."""
    gc.set_threshold(100_000, 20, 100)  # a quarter of the time in which 100,000 meshes are planned: all objects stay
    _open_closed_streams()
    # children (workers, probes) import from where Python's packages are, never from whatever folder a person is in
    os.environ["PYTHONSAFEPATH"] = "1"
    # a worker that had to be killed leaves a semaphore of numba's, of which Python's tracker would warn at the very end
    warnings = [os.environ.get("PYTHONWARNINGS", ""), "ignore::UserWarning:multiprocessing.resource_tracker"]
    os.environ["PYTHONWARNINGS"] = ",".join(filter(None, warnings))
    # threads of NumPy's OpenBLAS, which nothing here has work for, would turn idly for a tenth of a second
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names of files may be in no encoding at all
            stream.reconfigure(errors="backslashreplace")
    try:
        interrupts.install_signal_handlers()
        code = group.main(prog_name="zbuf-occlude", standalone_mode=False)
    except click.ClickException as error:
        echo(f"error: {one_line(error)}", err=True)
        code = error.exit_code
    except (click.Abort, KeyboardInterrupt):
        echo("error: interrupted; what was finished is kept, and the same command resumes.", err=True)
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
        said = f"{memory_allowed()}; it does not{f' ({error})' if str(error) else ''}"
        echo(f"error: it must fit in {said}. Ask for less: points, views, size.", err=True)
        code = FAILED
    except BrokenPipeError:  # the reader of our standard output went away
        sys.stderr.close()
        code = FAILED
    except OSError as error:  # a full disk, a folder that must not be written
        echo(f"error: {error.strerror or error}{f': {error.filename}' if error.filename else ''}", err=True)
        code = FAILED
    if "torch" not in sys.modules:  # Triton counts what of it is left at the end, and says so at length
        gc.freeze()  # at the end nothing is looked through for what nobody needs, a tenth of a second
    sys.exit(code if isinstance(code, int) else 0)


def _open_closed_streams() -> None:
    """Have standard streams that the caller closed lead nowhere; else the next file opened would be taken for one."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest free number: this one
            setattr(sys, name, os.fdopen(number, "w" if number else "r", closefd=False))


if __name__ == "__main__":
    main()

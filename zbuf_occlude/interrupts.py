"""What an interrupt does to the command line: while it is imported, and from then on."""

import os
import signal
import sys

PROGRAM, PACKAGE = "zbuf-occlude", "zbuf_occlude"


def end_quietly() -> None:
    """Have an interrupt end this process without a word, not with a traceback, if it is the command line that begins.

    For the package's first line; `heard` says when that is over. In everybody else's processes nothing changes.
    """
    name = os.path.basename(sys.argv[0]) if sys.argv else ""
    begins = name.startswith(PROGRAM) or (name == "-m" and PACKAGE in sys.orig_argv)
    if begins and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def heard() -> None:
    """Have all that asks this process to end raise KeyboardInterrupt, but for what it was started to ignore.

    Ctrl-C, a scheduler's SIGTERM, the SIGHUP of a terminal that was closed: else temporary folders would stay.
    """
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)  # Windows has no SIGHUP
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)

"""What an interrupt does to the command line: while it is imported, and from then on."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PROGRAM, PACKAGE = "zbuf-occlude", "zbuf_occlude"
_NUMBERS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]  # Windows lacks one


def end_quietly() -> None:
    """Have an interrupt end this process without a word, not with a traceback, if it is the command line that begins.

    The package calls this first, and `install_signal_handlers` ends it. Other programs that import it are left alone.
    """
    name = os.path.basename(sys.argv[0]) if sys.argv else ""
    begins = name.startswith(PROGRAM) or (name == "-m" and PACKAGE in sys.orig_argv)
    if begins and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def install_signal_handlers() -> None:
    """Have all that asks this process to end raise KeyboardInterrupt, but for what it was started to ignore.

    Ctrl-C, a scheduler's SIGTERM, the SIGHUP of a terminal that was closed: else temporary folders would stay.
    """
    for number in _NUMBERS:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


@contextmanager
def held() -> Iterator[None]:
    """Hold interrupts back until the end of a block, which must be short: half of it would harm another process.

    Not by a mask, which is a thread's: another thread would take the signal for this one.
    """
    if threading.current_thread() is not threading.main_thread():  # interrupts are the main thread's
        yield
        return
    came = list[int]()
    before = {number: signal.getsignal(number) for number in _NUMBERS}
    for number, handler in before.items():
        if handler not in (signal.SIG_IGN, None):  # None: it is not Python's
            signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        for number in came[:1]:
            signal.raise_signal(number)

"""Handling of signals by the command line, during its import and afterwards."""

import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

PROGRAM, PACKAGE = "zbuf-occlude", "zbuf_occlude"
_NUMBERS = [
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
]  # Windows lacks SIGHUP
PAUSE = 0.01
"""Seconds until a lost interrupt is repeated, in which the destructor or callback ends."""


def end_quietly() -> None:
    """Make Ctrl-C end this process without a traceback while the command line is starting.

    The package calls this on import, and `raised` ends it. Other programs that import the package are
    not affected.
    """
    name = os.path.basename(sys.argv[0]) if sys.argv else ""
    begins = name.startswith(PROGRAM) or (name == "-m" and PACKAGE in sys.orig_argv)
    if begins and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def raised() -> Iterator[None]:
    """Make SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt in a block, which runs the command of this process.

    They come from Ctrl-C, a scheduler, a closed terminal. Without the exception temporary folders would be left.
    Signals that the process was started to ignore stay ignored. After the block they end the process at once, because
    Python would print the exceptions of its exit.
    """
    for number in _NUMBERS:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)
    hook = sys.unraisablehook

    def repeat(lost: "sys.UnraisableHookArgs") -> None:
        """Repeat an interrupt that came in a destructor or a callback, where Python ignores exceptions."""
        if lost.exc_type is KeyboardInterrupt:
            again = threading.Timer(PAUSE, _interrupt_main_thread)
            again.daemon = True
            again.start()
        else:
            hook(lost)

    sys.unraisablehook = repeat
    try:
        yield
    finally:
        sys.unraisablehook = hook
        for number in _NUMBERS:
            if signal.getsignal(number) is signal.default_int_handler:
                signal.signal(number, signal.SIG_DFL)


def _interrupt_main_thread() -> None:
    heard = [number for number in _NUMBERS if signal.getsignal(number) is signal.default_int_handler]
    for number in heard[:1]:  # none after the block
        if hasattr(signal, "pthread_kill"):  # ends a call that waits, too; Windows lacks it
            signal.pthread_kill(threading.main_thread().ident or 0, number)
        else:
            signal.raise_signal(number)


@contextmanager
def held() -> Iterator[None]:
    """Delay interrupts until the end of a block, which must be short and must not be left half done.

    A signal mask would not do: it belongs to one thread, and another thread would receive the signal.
    """
    if threading.current_thread() is not threading.main_thread():  # only the main thread handles signals
        yield
        return
    came = list[int]()
    before = {number: signal.getsignal(number) for number in _NUMBERS}
    for number, handler in before.items():
        if handler not in (signal.SIG_IGN, None):  # None: the handler is not Python's
            signal.signal(number, lambda number, frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        for number in came[:1]:
            signal.raise_signal(number)

"""Python as another system has it, for zbuf_occlude alone: put this folder on PYTHONPATH, name the system in AS_ON.

The package's modules see another `sys.platform`, an `os` and a `signal` without what only Unix or Linux has, no
modules of Unix, and no /proc. On Windows, files that this process holds open or mapped can be neither moved over,
removed nor cut. Children that are spawned see it too; workers cannot be forked.
"""

import builtins
import importlib
import io
import os
import signal
import sys
from types import ModuleType
from typing import Any

SYSTEM = os.environ["AS_ON"]
LINUX = {"os": "sched_ posix_fadvise memfd_ eventfd pidfd_ copy_file_range splice O_DIRECT O_TMPFILE"}
UNIX = {
    "os": "fork register_at_fork sched_ getuid geteuid getgid getegid getgroups setsid setpgid getpgid getsid killpg "
    "nice getpriority setpriority sysconf confstr pathconf statvfs fstatvfs mkfifo mknod chown fchown lchown fchmod "
    "fchdir posix_ pread pwrite preadv pwritev sendfile uname getloadavg wait openpty ttyname sync fdatasync lockf "
    "pipe2 environb O_DIRECTORY O_NOFOLLOW O_CLOEXEC O_NONBLOCK",
    "signal": "SIGKILL SIGALRM SIGHUP SIGQUIT SIGUSR SIGCHLD SIGPIPE SIGSTOP SIGCONT setitimer getitimer alarm ITIMER_ "
    "pthread_ sigwait sigtimedwait siginterrupt pause",
}
NO_MODULES = {"darwin": (), "win32": ("fcntl", "resource", "pwd", "grp", "termios", "tty", "pty", "readline", "syslog")}
LACKING = {"darwin": LINUX, "win32": UNIX}[SYSTEM]

real_import, real_import_module, real_open = builtins.__import__, importlib.import_module, io.open


class Proxy(ModuleType):
    """A module without some names."""

    def __init__(self, module: ModuleType, lacking: str) -> None:
        super().__init__(module.__name__)
        self.__dict__["_real"], self.__dict__["_lacking"] = module, tuple(lacking.split())

    def __getattr__(self, name: str) -> Any:
        if name == "platform" and self._real is sys:
            return SYSTEM
        if name == "__all__" or name.startswith(self._lacking):
            raise AttributeError(f"{self.__name__} has no {name} on {SYSTEM}")
        return getattr(self._real, name)


PROXIES = {module.__name__: Proxy(module, LACKING.get(module.__name__, "-")) for module in (os, signal, sys)}


def of_the_package(name: str, globals: Any = None, *rest: Any, **options: Any) -> Any:
    """Import as always, but for the package's own modules."""
    if ((globals or {}).get("__name__") or "").partition(".")[0] == "zbuf_occlude":
        if name in NO_MODULES[SYSTEM]:
            raise ModuleNotFoundError(f"No module named {name!r} on {SYSTEM}", name=name)
        if name in PROXIES:
            return PROXIES[name]
    return real_import(name, globals, *rest, **options)


def module_of_the_system(name: str, package: str | None = None) -> Any:
    """Import as `importlib.import_module` does, but for the package's own modules."""
    asks = sys._getframe(1).f_globals.get("__name__") or ""
    if asks.partition(".")[0] == "zbuf_occlude" and name in NO_MODULES[SYSTEM]:
        raise ModuleNotFoundError(f"No module named {name!r} on {SYSTEM}", name=name)
    return real_import_module(name, package)


def without_proc(file: Any, *arguments: Any, **options: Any) -> Any:
    """Open as always, but for /proc; of it the processor's kind can be read, so that nothing is compiled anew."""
    refused = isinstance(file, str | os.PathLike) and os.fspath(file)[:6] in ("/proc/", b"/proc/")
    if refused and file != "/proc/cpuinfo":
        raise FileNotFoundError(2, f"there is no /proc on {SYSTEM}", os.fspath(file))
    return real_open(file, *arguments, **options)


def held(path: Any) -> bool:
    """Whether this process has a file open or mapped."""
    name = os.path.realpath(path)
    if not os.path.exists(name) or name.startswith("/dev/shm"):  # what Linux's multiprocessing shares
        return False
    with real_open("/proc/self/maps") as maps:
        if any(line.rstrip().endswith(name) for line in maps):
            return True
    for descriptor in os.listdir("/proc/self/fd"):
        try:
            if os.readlink(f"/proc/self/fd/{descriptor}") == name:
                return True
        except OSError:  # the listing's own
            continue
    return False


def guarded(name: str) -> None:
    """Refuse what Windows refuses of files that are in use."""
    real = getattr(os, name)

    def call(*paths: Any, **options: Any) -> Any:
        for path in paths:
            if isinstance(path, str | os.PathLike) and held(path):
                raise PermissionError(13, "the file is in use by this process", os.fspath(path))
        return real(*paths, **options)

    setattr(os, name, call)


def no_fork(*_: Any) -> Any:
    raise AssertionError(f"nothing is forked on {SYSTEM}")


builtins.__import__, builtins.open, io.open = of_the_package, without_proc, without_proc
importlib.import_module = module_of_the_system
os.fork = no_fork
if SYSTEM == "win32":
    for name in ("replace", "rename", "unlink", "remove", "truncate", "link"):
        guarded(name)

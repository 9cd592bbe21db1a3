"""Where numba keeps compiled functions: a folder that can be written, of these sources; a note of what is there."""

import atexit
import hashlib
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path

_KIND = {"vendor_id", "cpu family", "model", "flags", "CPU implementer", "CPU part", "Features", "cpu", "isa"}
"""What Linux tells of a processor of x86-64, ARM, POWER or RISC-V that does not differ among those of one kind."""


def ensure_writable() -> None:
    """Point NUMBA_CACHE_DIR at a new temporary folder when numba would find no folder to write into, and fail.

    That is so where an administrator installed the package and homes are read-only or missing. The folder is inherited
    by workers and removed when this process ends: functions are then compiled again in each run. (Not a fixed name
    below /tmp: whoever else may write there could have this process run what they left.)
    """
    if _place() is None:
        folder = tempfile.mkdtemp(prefix="zbuf_occlude-numba-")
        os.environ["NUMBA_CACHE_DIR"] = folder
        atexit.register(_remove, folder, os.getpid())


def forget_stale() -> None:
    """Remove what was compiled of other sources than these.

    numba compiles a function anew when its own file changed, not when the file of one that was compiled into it did:
    after an update it would answer as before. What counts for a file is its own text and that of all it imports. Each
    place has a note of its own of the sources that what is there was compiled of: a run with another NUMBA_CACHE_DIR
    removes nothing elsewhere that is of these.
    """
    chosen, status = _place(), _sources()
    now: dict[Path, str] = {}
    for place in dict.fromkeys(map(os.path.realpath, _places())):
        note = Path(place, f"zbuf_occlude-{hashlib.sha1(_here().encode()).hexdigest()}.sources")
        if not note.exists() and (chosen is None or place != os.path.realpath(chosen)):
            continue  # nothing was compiled there, or it cannot be written
        with suppress(OSError):
            then = _read(note)
            if then.get("status") == status:
                continue
            now = now or _digests({Path(path): Path(path).read_text("utf-8", "replace") for path in _files()})
            for source, digest in now.items():
                if then.get(str(source)) != digest:
                    for compiled in _compiled_of(source, place):
                        compiled.unlink(missing_ok=True)
            _write(note, json.dumps({"status": status, **{str(source): digest for source, digest in now.items()}}))


def is_compiled(job: str) -> bool:
    """Whether everything that a job needs was compiled here, of these sources, for this processor (`note_compiled`)."""
    note = _note(job)
    return note is not None and note.exists() and note.read_text() == _stamp()


def note_compiled(job: str) -> None:
    """Note that everything a job needs is compiled; without the note the next run looks again, no more."""
    note = _note(job)
    if note is not None:
        with suppress(OSError):
            note.parent.mkdir(parents=True, exist_ok=True)
            note.write_text(_stamp())


def _note(job: str) -> Path | None:
    place = _place()
    return None if place is None else Path(place, f"zbuf_occlude-{job}-{_processor()}.compiled")


def _processor() -> str:
    """Name the kind of processor that functions are compiled for."""
    with suppress(OSError):  # Linux; to import LLVM for its name takes as long as NumPy
        lines = Path("/proc/cpuinfo").read_text().partition("\n\n")[0].splitlines()
        told = [line for line in lines if line.partition(":")[0].strip() in _KIND]
        if told:
            return hashlib.sha1("\n".join(told).encode()).hexdigest()[:16]
    from llvmlite.binding import get_host_cpu_name  # late, for the package is light to import

    return str(get_host_cpu_name())


def _stamp() -> str:
    """Change when numba or a source does."""
    from importlib.metadata import version  # late, for the package is light to import

    return f"numba {version('numba')}, {_sources()}"


def _sources() -> str:
    """Change when a source does."""
    found = sorted((path, os.stat(path)) for path in _files())
    text = "".join(f"{path} {status.st_mtime_ns} {status.st_size}\n" for path, status in found)
    return f"sources {hashlib.sha1(text.encode(errors='surrogateescape')).hexdigest()}"


def _files() -> Iterator[str]:
    """The package's sources."""
    for folder, _, names in os.walk(_here()):
        yield from (os.path.join(folder, name) for name in names if name.endswith(".py"))


def _compiled_of(source: Path, place: str) -> Iterator[Path]:
    """What numba keeps of a source in a place: in a folder there named after the source's, or beside the source."""
    folder = str(source.parent)
    kept = [Path(place, f"{source.parent.name}_{hashlib.sha1(folder.encode()).hexdigest()}")]
    if place == os.path.realpath(_beside()):
        kept.append(source.parent / "__pycache__")
    for one in kept:
        yield from one.glob(f"{source.stem}.*.nb[ic]")


def _write(note: Path, text: str) -> None:
    """Write a note whole or not at all: who reads half of it takes all for stale."""
    note.parent.mkdir(parents=True, exist_ok=True)
    whole = note.with_suffix(f".{os.urandom(8).hex()}")
    try:
        whole.write_text(text)
        whole.replace(note)
    finally:
        whole.unlink(missing_ok=True)


def _here() -> str:
    """The package's folder."""
    return os.path.dirname(os.path.abspath(__file__))


def _beside() -> str:
    """Beside the package's own sources."""
    return os.path.join(_here(), "__pycache__")


def _read(note: Path) -> dict[str, str]:
    """What was noted of the sources; nothing where there is no such note."""
    try:
        known = json.loads(note.read_text())
    except (OSError, ValueError):
        return {}
    return known if isinstance(known, dict) else {}


_IMPORT = re.compile(r"^[ \t]*(?:from|import)[ \t]+([\w.]+)(?:[ \t]+import[ \t]*(\([^)]*\)|[^\n]*))?", re.MULTILINE)


def _digests(texts: Mapping[Path, str]) -> dict[Path, str]:
    """For each source a digest of its text and of the texts of all that it imports of the package, near and far."""
    root = Path(_here())
    by_name = {".".join(path.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): path for path in texts}
    imported: dict[Path, set[Path]] = {}
    for path, text in texts.items():
        found = imported.setdefault(path, set())
        for module, names in _IMPORT.findall(text):
            module = module.removeprefix("zbuf_occlude").removeprefix(".")
            parts = [".".join(filter(None, (module, name))) for name in re.findall(r"\w+", names)]
            known = [by_name[part] for part in parts if part in by_name]
            found.update(known)
            if len(known) < max(len(parts), 1) and module in by_name:  # some name is no module, but in this one
                found.add(by_name[module])
    digests = {}
    for path in texts:
        reached, left = {path}, [path]
        while left:
            new = imported[left.pop()] - reached
            reached |= new
            left.extend(new)
        whole = "".join(f"{one}\n{texts[one]}" for one in sorted(reached))
        digests[path] = hashlib.sha1(whole.encode(errors="surrogateescape")).hexdigest()
    return digests


def _place() -> str | None:
    """The first folder that numba will find it can write into."""
    return next((place for place in _places() if _is_writable(place)), None)


def _places() -> list[str]:
    """Where numba looks for one."""
    given = os.environ.get("NUMBA_CACHE_DIR")
    users = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return [place for place in (given, _beside(), os.path.join(users, "numba")) if place]


def _is_writable(place: str) -> bool:
    """Whether a folder can be written, or made and then written."""
    path = Path(os.path.abspath(place))
    existing = next(one for one in (path, *path.parents) if one.exists())
    return existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)


def _remove(folder: str, owner: int) -> None:
    if os.getpid() == owner:  # and not a forked child of it
        shutil.rmtree(folder, ignore_errors=True)

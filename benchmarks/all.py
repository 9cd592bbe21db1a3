"""Every measurement that the pages quote: run, written to docs/figures.json, and from there into the pages.

    python benchmarks/all.py [NAME ...] [--cheap] [--pages]

Parts run in the order of the names, or all, one after the other, unattended; one that fails or whose files are not
here leaves the pages as they were, is named in the end, and the exit code is 1. Parts about time want an idle machine.
--cheap: each with less to do, for a look at whether it works; the pages are not touched then.
--pages: only make the blocks of the pages anew, as docs/figures.json has them; tests/test_figures.py holds them to it.
What a part that was stopped has made lies in build/figures/NAME, and `experiment` goes on with it.
"""

import glob
import os
import re
import shutil
import subprocess
import sys
import time
from datetime import date
from pathlib import Path

import figures
from common import ROOT, run
from parts import COMMAND, DATA, OUT, PARTS, PYTHON, Part

from zbuf_occlude.studies.compare.run import machine


def main(*names: str, cheap: bool = False, pages: bool = False) -> int:
    by_name = {part.name: part for part in PARTS}
    chosen = [by_name[name] for name in names] if names else list(PARTS)
    failed = [] if pages else [part.name for part in chosen if not measured(part, cheap=cheap)]
    if not cheap:
        make_pages()
    if failed:
        print(f"failed: {', '.join(failed)}")
    return bool(failed)


def measured(part: Part, *, cheap: bool) -> bool:
    """Run a part and write what it came to; say whether it did."""
    command = part.cheap if cheap else part.command
    print(f"{part.name}: {command}" + ("" if cheap else f" (about {part.minutes} min)"), flush=True)
    for word in map(local, (word for word in command.split() if word.startswith(DATA))):
        if not glob.glob(word, root_dir=ROOT):
            print(f"  left out: {word} is not here")
            return False
    out = ROOT / "build" / "figures" / (f"{part.name}-cheap" if cheap else part.name)
    out.mkdir(parents=True, exist_ok=True)
    began = time.perf_counter()
    done = subprocess.run(words_of(command, out), cwd=ROOT, capture_output=True, text=True, check=False)
    seconds = round(time.perf_counter() - began)
    if done.returncode:
        print(f"  exit code {done.returncode}: {(done.stderr or done.stdout).strip()[-2000:]}")
        return False
    text = (out / part.reads).read_text(encoding="utf-8") if part.reads else done.stdout
    shutil.rmtree(out)
    lines = [line.rstrip() for line in text.strip("\n").splitlines()]
    print(f"  {seconds} s, {len(lines)} lines", flush=True)
    if cheap:
        print("\n".join(lines))
        return True
    known = figures.read()  # anew: another run may have written
    entry = {"command": part.command, "date": date.today().isoformat(), "machine": machine(), "seconds": seconds}
    known[part.name] = {**entry, "text": part.text, "value": lines}
    figures.write(known)
    return True


def words_of(command: str, out: Path) -> list[str]:
    """Return a command's words as they are run: by this Python, `OUT` a folder."""
    first, *others = (local(re.sub(f"^{OUT}/", f"{out}/", word)) for word in command.split())
    files = [sorted(glob.glob(word, root_dir=ROOT)) if "*" in word else [word] for word in others]
    return [sys.executable, *{PYTHON: [], COMMAND: ["-m", "zbuf_occlude"]}[first], *(f for each in files for f in each)]


def local(word: str) -> str:
    """Return a word with the data's folder where it is on this machine."""
    return re.sub(f"^{DATA}", os.environ.get("ZBUF_OCCLUDE_DATA", DATA), word)


def make_pages() -> None:
    """Make the blocks of all pages anew."""
    known = figures.read()
    for page in figures.pages():
        text = page.read_text(encoding="utf-8")
        if (anew := figures.rendered(text, known)) != text:
            page.write_text(anew, encoding="utf-8")
            print(f"{page.relative_to(ROOT)} made anew")


if __name__ == "__main__":
    run(main, __doc__, names=[part.name for part in PARTS])

"""Records written in a format without a folder that they come from, in this process."""

from dataclasses import replace
from pathlib import Path

from zbuf_occlude.dataset.convert import places_in, portions_of
from zbuf_occlude.dataset.finish import files_of
from zbuf_occlude.dataset.folder import SHARDS
from zbuf_occlude.dataset.formats import Format
from zbuf_occlude.dataset.parts import write_contents
from zbuf_occlude.dataset.source import Content, Source


def write(row: Format, source: Source, out: Path) -> dict[str, list[str]]:
    """Write all clouds of a source, part by part; return the names of the files of each split."""
    plan = replace(source.plan, format=row.name)
    portions = portions_of(source, plan)
    places = places_in(source, plan, portions)
    (out / SHARDS).mkdir()
    for part, of_part in portions.items():
        contents = [Content(plan, split, n, source.take(some), source.complete) for split, n, some in of_part]
        write_contents(plan, out, part, contents, places)
    files = files_of(plan, out, sorted(portions)).names
    for path in (out / SHARDS).iterdir():
        path.unlink()
    (out / SHARDS).rmdir()
    return files

"""Tar files for streaming, as WebDataset reads them: train-000000.tar and so on, up to 2,048 clouds each.

A cloud NUMBER consists of

    NUMBER.data.npy      (size, 3) float32; with --sample-size all each cloud has its own size
    NUMBER.face_ids.npy  (size,) int32
    NUMBER.cls           the label as text
    NUMBER.range.npy ... of scans, a file for each further field with a row per point
    NUMBER.json          class, mesh, split, and every other field of the records

Tar's times and owners are fixed, so the same clouds give the same bytes. Writing needs nothing but Python; for reading
there is the package webdataset (extra ``webdataset``), and any program that knows tar.
"""

import io
import json
import tarfile
from pathlib import Path
from typing import IO, Any

import numpy as np

from zbuf_occlude.base import atomic
from zbuf_occlude.base.atomic import FileDigest
from zbuf_occlude.datasets.plan import CLOUDS_PER_FILE, DatasetConfig, Plan
from zbuf_occlude.datasets.records import Records, point_fields, record_type
from zbuf_occlude.datasets.source import CloudReader, kept, source_of_files

TEXTS = 2
"""Members of each cloud that hold no array: its label, and its other fields."""


def file_name(split: str, number: int) -> str:
    """Return the name of a file."""
    return f"{split}-{number:06d}.tar"


def write(path: Path, records: Records, plan: Plan, number: int) -> FileDigest:
    """Write one tar file, whose first cloud has the number `number` times `CLOUDS_PER_FILE`."""

    def fill(file: IO[bytes]) -> None:
        with tarfile.open(fileobj=file, mode="w", format=tarfile.USTAR_FORMAT) as tar:
            for cloud, record in enumerate(records, number * CLOUDS_PER_FILE):
                for ending, content in _members(record, plan):
                    info = tarfile.TarInfo(f"{cloud:09d}.{ending}")  # its times and owners are all zero
                    info.size = len(content)
                    tar.addfile(info, io.BytesIO(content))

    return atomic.write_data(path, fill)


def read(out: Path, plan: Plan, files: dict[str, list[str]]) -> CloudReader:
    """Return the clouds of these files; the last file used is kept in memory."""
    return source_of_files(plan, out, files, _count, kept(lambda path: _read_tar(path, plan.config)))


def _members(record: Any, plan: Plan) -> list[tuple[str, bytes]]:
    entry = plan.meshes[int(record["mesh_id"])]
    arrays = point_fields(plan.config)
    facts = {"class": entry.label, "mesh": entry.key, "split": entry.split}
    for name in record.dtype.names:
        if name not in (*arrays, "label"):
            facts[name] = record[name].tolist()
    members = [("cls", str(int(record["label"][0])).encode()), ("json", json.dumps(facts).encode())]
    for name in arrays:
        buffer = io.BytesIO()
        np.save(buffer, record[name])
        members.append((f"{name}.npy", buffer.getvalue()))
    return members


def _count(path: Path) -> int:
    with tarfile.open(path) as tar:
        return sum(member.name.endswith(".json") for member in tar)


def _read_tar(path: Path, config: DatasetConfig) -> Records:
    records: list[Records] = []
    keys: dict[str, int] = {}
    with tarfile.open(path) as tar:
        for member in tar:
            key, _, ending = member.name.partition(".")
            if key not in keys:
                keys[key] = len(records)
                records.append(np.zeros((), record_type(config)))
            record, file = records[keys[key]], tar.extractfile(member)
            if file is None:
                raise ValueError(f"{member.name} is no file")
            content = file.read()
            if ending == "cls":
                record["label"] = int(content)
            elif ending == "json":
                for name, value in json.loads(content).items():
                    if name in (record.dtype.names or ()):
                        record[name] = value
            else:
                record[ending.removesuffix(".npy")][()] = np.load(io.BytesIO(content))
        n_members = len(tar.getmembers())
    if n_members != (TEXTS + len(point_fields(config))) * len(records):  # tar does not say that it was cut between two
        raise ValueError(f"{n_members} members for {len(records)} clouds")
    return np.stack(records)

"""A group that is done: its final files, and what is known of its clouds, as one JSON file in the folder ``groups``."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from zbuf_occlude.dataset import atomic
from zbuf_occlude.dataset.batch import Batch, Named, is_there
from zbuf_occlude.dataset.counts import Counts
from zbuf_occlude.dataset.folder import GROUPS
from zbuf_occlude.dataset.plan import Plan
from zbuf_occlude.errors import DatasetError
from zbuf_occlude.limits import Limits
from zbuf_occlude.meshes.collection import MeshEntry
from zbuf_occlude.provenance import Origin


@dataclass(frozen=True)
class Group:
    """What is known of a group that is done.

    Parameters
    ----------
    fingerprint : str
        Of its plan.
    counts, failures, given_up, origins, n_clouds
        Of all its batches, as in `Batch`.
    renderers : list of str
    seconds : float
        That its batches took.
    files : mapping of split to list of Named
        Those with clouds; an archive of the format packed may stand under several splits.
    """

    fingerprint: str
    counts: Counts
    failures: Mapping[str, str]
    given_up: Mapping[str, Limits]
    origins: Mapping[str, Origin]
    renderers: list[str]
    seconds: float
    n_clouds: Mapping[str, int]
    files: Mapping[str, list[Named]]

    @classmethod
    def of_batches(cls, plan: Plan, batches: list[Batch], files: Mapping[str, list[Named]]) -> "Group":
        """Sum up the batches of a group whose files are written."""
        return cls(
            fingerprint=plan.fingerprint,
            counts=sum((batch.counts for batch in batches), Counts()),
            failures={key: reason for batch in batches for key, reason in batch.failures.items()},
            given_up={key: limits for batch in batches for key, limits in batch.given_up.items()},
            origins={key: origin for batch in batches for key, origin in batch.origins.items()},
            renderers=sorted({batch.renderer for batch in batches} - {"none"}),
            seconds=sum(batch.seconds for batch in batches),
            n_clouds=dict(sum((Counter(batch.n_clouds) for batch in batches), Counter())),
            files=files,
        )

    def write(self, out: Path, number: int) -> None:
        """Write it; the group is done then."""
        document = {
            **self.__dict__,
            "counts": self.counts.document,
            "given_up": {key: limits.document for key, limits in self.given_up.items()},
            "origins": {key: origin.document for key, origin in self.origins.items()},
            "names": sorted({file.name for of_split in self.files.values() for file in of_split}),
        }
        (out / GROUPS).mkdir(exist_ok=True)
        atomic.write_json(group_path(out, number), {**document, "checksum": _checksum(document)})

    @property
    def made(self) -> dict[str, Origin]:
        """What the meshes that did not fail were made of, by key."""
        return {key: origin for key, origin in self.origins.items() if key not in self.failures}


def group_path(out: Path, number: int) -> Path:
    """Return where what is known of a group is written."""
    return out / GROUPS / f"{number:06d}.json"


def read_group(plan: Plan, out: Path, number: int) -> tuple[Group | None, str]:
    """Return a group that is done; of any other None and, where there is something of it, what is wrong.

    Raises
    ------
    DatasetError
        It belongs to another plan.
    """
    path = group_path(out, number)
    try:
        document = json.loads(path.read_bytes())
        if document.pop("checksum") != _checksum(document):
            return None, f"{path.name} is damaged"
        del document["names"]
        group = Group(
            **{
                **document,
                "counts": Counts.from_document(document["counts"]),
                "given_up": {key: Limits(*limits) for key, limits in document["given_up"].items()},
                "origins": {key: Origin.from_document(each) for key, each in document["origins"].items()},
                "files": {split: [Named(*file) for file in of_split] for split, of_split in document["files"].items()},
            }
        )
    except FileNotFoundError:
        return None, ""
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None, f"{path.name} is damaged"
    if group.fingerprint != plan.fingerprint:
        raise DatasetError(f"{path} must belong to plan {plan.fingerprint}; it is of plan {group.fingerprint}.")
    for file in (file for of_split in group.files.values() for file in of_split):
        if not is_there(out, file):
            return None, f"{file.name} is missing or has another size"
    return group, ""


def read_groups(plan: Plan, out: Path) -> Iterator[Group]:
    """Yield all groups of a dataset.

    Raises
    ------
    DatasetError
        One is not done.
    """
    for number in range(len(plan.groups)):
        group, fault = read_group(plan, out, number)
        if group is None:
            raise DatasetError(
                f"{out} must have all {len(plan.groups)} groups of files; group {number} is not done"
                f"{fault and f': {fault}'}. Run the `zbuf-occlude generate` that made the others first."
            )
        yield group


def check_origins(entries: Iterable[MeshEntry], origins: Mapping[str, Origin], out: Path) -> None:
    """Check that meshes are what data in a folder were made of; `origins` are what they were, by their keys.

    Raises
    ------
    DatasetError
        One is not.
    """
    for entry in entries:
        then = origins.get(entry.key)
        if then is None or (now := entry.origin_now(then)).sha256 == then.sha256:
            continue
        what = f"sha256 {now.sha256[:12]}..." if now.sha256 else "no longer readable"
        raise DatasetError(
            f"{entry.key} must be what the data in {out} were made of, sha256 {then.sha256[:12]}...; it is {what}. "
            "Put it back, choose another folder, or make all clouds again with --overwrite."
        )


def worth_another_try(plan: Plan, mesh_ids: Iterable[int], made: Batch | Group, limits: Limits) -> list[str]:
    """Return the keys of the failures of a batch or group whose cause may be gone: another file, or wider limits."""
    again = []
    for entry in (plan.meshes[i] for i in mesh_ids):
        if entry.key in made.failures:
            given_up = made.given_up.get(entry.key)
            wider = given_up is not None and limits.allow_more_than(given_up)
            if wider or entry.origin_of_failure() != made.origins[entry.key]:
                again.append(entry.key)
    return again


def _checksum(document: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()

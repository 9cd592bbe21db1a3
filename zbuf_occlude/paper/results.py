"""The results of trials as they lie in a study's folder: JSON, read without PyTorch."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zbuf_occlude.arrays import describe
from zbuf_occlude.errors import ArgumentError, DatasetError
from zbuf_occlude.learn.models import find_model
from zbuf_occlude.paper.names import AUGMENTATION, ELEVATION, HSR, REALISM

FOLDER, STUDY, AREAS, PICTURE = "results", "study.json", "areas.json", "scans.png"
"""In a study's folder: a JSON file for each trial; what the study is; projected areas that are seen; real scans."""

_FACTS: dict[str, dict[str, type]] = {
    ELEVATION: {"model": str, "split": str, "seed": int},
    AUGMENTATION: {"model": str, "set": int, "points": int, "budget": str, "seed": int},
    HSR: {"model": str, "method": str, "points": int, "budget": str, "seed": int},
    REALISM: {"model": str, "trained_on": str, "counts": str, "seed": int},
}
_REPORTED: dict[str, type | tuple[type, ...]] = {
    "n_parameters": int, "n_training": int, "epochs": int, "seconds": (int, float), "machine": str, "device": str,
}  # fmt: skip


@dataclass(frozen=True)
class Confusion:
    """How a classifier labelled a test set.

    Parameters
    ----------
    truth : tuple of str
        Names of the rows; those of real scans are not the classifier's own.
    predicted : tuple of str
        Names of the columns.
    counts : (t, p) int64

    Raises
    ------
    ArgumentError
        Not a count for each row and column.
    """

    truth: tuple[str, ...]
    predicted: tuple[str, ...]
    counts: NDArray[np.int64]

    def __post_init__(self) -> None:
        shape = (len(self.truth), len(self.predicted))
        if self.counts.shape != shape or not all(shape) or (self.counts < 0).any():
            raise ArgumentError(f"counts must be {shape}, none negative; got {describe(self.counts)}.")

    @property
    def accuracy(self) -> float:
        """Overall accuracy where truth and predictions have the same classes; NaN without clouds."""
        total = int(self.counts.sum())
        return float(np.trace(self.counts) / total) if total else float("nan")


@dataclass(frozen=True)
class Result:
    """What a trial came to.

    Parameters
    ----------
    experiment : str
    facts : mapping
        Of the `Trial`.
    tests : mapping of name to Confusion
    document : mapping
        All that is stored.
    """

    experiment: str
    facts: Mapping[str, Any]
    tests: Mapping[str, Confusion]
    document: Mapping[str, Any]

    def is_of(self, **facts: Any) -> bool:
        """Whether the trial's facts are these."""
        return all(self.facts.get(name) == value for name, value in facts.items())


def path_of(folder: Path, key: str) -> Path:
    """Return where the result of a trial is."""
    return folder / FOLDER / f"{key}.json"


def read_result(path: Path) -> Result | None:
    """Read a trial's result; None when there is none yet.

    Raises
    ------
    DatasetError
        The file is damaged.
    """
    if not path.exists():
        return None
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        tests = {
            name: Confusion(tuple(test["truth"]), tuple(test["predicted"]), np.array(test["confusion"], dtype=np.int64))
            for name, test in document["tests"].items()
        }
        _check(document["facts"], _FACTS[document["experiment"]])
        _check(document, _REPORTED)
        find_model(document["facts"]["model"])
        return Result(document["experiment"], document["facts"], tests, document)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"{path} must be a trial's result; it is damaged ({error!r}). Delete it.") from None


def _check(values: Mapping[str, Any], kinds: Mapping[str, type | tuple[type, ...]]) -> None:
    """Raise KeyError or TypeError where a value is missing or of another type."""
    for name, kind in kinds.items():
        if not isinstance(values[name], kind):
            raise TypeError(f"{name} {values[name]!r}")


def read_study(folder: Path) -> dict[str, Any]:
    """Read what a folder's study is: size, objects, date, missing_methods, failed_meshes.

    Raises
    ------
    DatasetError
        There is none, or its file is damaged.
    """
    path = folder / STUDY
    try:
        study: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        study["size"]["name"], study["objects"], study["date"], study["missing_methods"]
        study.setdefault("failed_meshes", {})
    except FileNotFoundError:
        raise DatasetError(f"{folder} must hold a study; it has no {STUDY}. See: zbuf-occlude experiment -h") from None
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{path} must be a study's; it is damaged ({error!r}). Choose another folder.") from None
    return study


def read_results(folder: Path) -> list[Result]:
    """Read all results of a study's folder, in the order of their names."""
    read = (read_result(path) for path in sorted((folder / FOLDER).glob("*.json")))
    return [result for result in read if result is not None]

"""Trials and their stored results (JSON, read without PyTorch), and the selection of results."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.base.errors import DatasetError
from zbuf_occlude.drawing.pages import NONE
from zbuf_occlude.studies.learn.data import CloudSet
from zbuf_occlude.studies.learn.evaluation import Confusion
from zbuf_occlude.studies.learn.models import find_model
from zbuf_occlude.studies.paper.design import (
    AUGMENTATION,
    BUDGETS,
    ELEVATION,
    HSR,
    REAL,
    REALISM,
    TABLE_3A,
    TEST_ELEVATIONS,
    paper_name,
)

FOLDER, STUDY, AREAS, PICTURE, REAL_PICTURE = "results", "study.json", "areas.json", "scans.png", "objects.png"
"""Parts of a study's folder: results (a JSON file per trial), description, visible areas, pictures of real scans and of
real objects beside simulated ones."""

_FACTS: dict[str, dict[str, type]] = {
    ELEVATION: {"model": str, "split": str, "seed": int},
    AUGMENTATION: {"model": str, "set": int, "points": int, "budget": str, "seed": int},
    HSR: {"model": str, "method": str, "points": int, "budget": str, "seed": int},
    REALISM: {"model": str, "trained_on": str, "counts": str, "seed": int},
    REAL: {"model": str, "trained_on": str, "azimuths": str, "scale": str, "seed": int},
}
_REPORTED: dict[str, type | tuple[type, ...]] = {
    "n_parameters": int, "n_training": int, "epochs": int, "seconds": (int, float), "machine": str, "device": str,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Trial:
    """A classifier to be trained, and its tests; clouds are read when they are needed."""

    experiment: str
    facts: Mapping[str, str | int]  # facts that identify the trial: model, training clouds, points, seed
    training: Callable[[], CloudSet]
    validation: Callable[[], CloudSet]
    tests: Mapping[str, Callable[[], CloudSet]]
    epochs: Callable[[int], int]  # maximum number of epochs for a number of training clouds

    @property
    def key(self) -> str:
        """Name of the trial's files."""
        parts = (f"{name}{value}" if isinstance(value, int) else value for name, value in self.facts.items())
        return "-".join((self.experiment, *parts))


@dataclass(frozen=True)
class Result:
    """Stored result of a trial."""

    experiment: str
    facts: Mapping[str, Any]  # facts of the `Trial`
    tests: Mapping[str, Confusion]
    document: Mapping[str, Any]  # the whole stored document

    def matches(self, **facts: Any) -> bool:
        """Return whether the trial has these facts."""
        return all(self.facts.get(name) == value for name, value in facts.items())

    def accuracy(self, test: str | int) -> float | None:
        """Return the accuracy in a test; None where the test is missing."""
        return self.tests[str(test)].accuracy if str(test) in self.tests else None


def path_of(folder: Path, key: str) -> Path:
    """Return the path of a trial's result."""
    return folder / FOLDER / f"{key}.json"


def read_result(path: Path) -> Result | None:
    """Read a trial's result; None where it is missing. Raises DatasetError where the file is damaged."""
    if not path.exists():
        return None
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        tests = {
            name: Confusion(tuple(test["truth"]), tuple(test["predicted"]), np.array(test["confusion"], dtype=np.int64))
            for name, test in document["tests"].items()
        }
        for values, kinds in ((document["facts"], _FACTS[document["experiment"]]), (document, _REPORTED)):
            for name, kind in kinds.items():
                if not isinstance(values[name], kind):
                    raise TypeError(f"{name} {values[name]!r}")
        if document["experiment"] == ELEVATION:
            [tests[str(elevation)] for elevation in TEST_ELEVATIONS]
        find_model(document["facts"]["model"])
        return Result(document["experiment"], document["facts"], tests, document)
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise DatasetError(f"{path} must be a trial's result; it is damaged ({error!r}). Delete it.") from None


def read_study(folder: Path) -> dict[str, Any]:
    """Read the description of a study: size, objects, date, missing_methods, failed_meshes.

    Raises DatasetError where there is none, or its file is damaged.
    """
    path = folder / STUDY
    try:
        study: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        study["size"]["name"], study["objects"], study["date"], study["missing_methods"], study["failed_meshes"]
    except FileNotFoundError:
        raise DatasetError(f"{folder} must hold a study; it has no {STUDY}. See zbuf-occlude paper -h.") from None
    except (ValueError, KeyError, TypeError) as error:
        raise DatasetError(f"{path} is damaged ({error!r}). Choose another folder.") from None
    return study


def read_results(folder: Path) -> list[Result]:
    """Read all results of a study's folder, in the order of their names."""
    read = (read_result(path) for path in sorted((folder / FOLDER).glob("*.json")))
    return [result for result in read if result is not None]


def select_results(results: Iterable[Result], experiment: str, **facts: Any) -> list[Result]:
    """Return the results of an experiment with these facts, in the order of their seeds."""
    chosen = (result for result in results if result.experiment == experiment and result.matches(**facts))
    return sorted(chosen, key=lambda result: int(result.facts["seed"]))


def values(results: Iterable[Result], fact: str) -> list[Any]:
    """Return the different values of a fact in the order of the results."""
    return list(dict.fromkeys(result.facts[fact] for result in results))


def budgets_of(results: Iterable[Result]) -> list[str]:
    """Return the budgets that classifiers of 4.3 were trained under, in the order of `BUDGETS`."""
    found = {result.facts["budget"] for result in results if result.experiment == AUGMENTATION}
    return [budget for budget in BUDGETS if budget in found]


def models_of(results: Sequence[Result], experiment: str) -> list[str]:
    """Return the models of an experiment in the paper's order."""
    order = list(TABLE_3A)
    found = {str(result.facts["model"]) for result in results if result.experiment == experiment}
    return sorted(found, key=lambda model: (order.index(paper_name(model)), model))


def percent(shares: Iterable[float | None]) -> str:
    """Format the mean of the known fractions in percent, with the standard deviation where there are several."""
    known = [100.0 * share for share in shares if share is not None and not np.isnan(share)]
    if not known:
        return NONE
    spread = f" ± {np.std(known, ddof=1):.1f}" if len(known) > 1 else ""
    return f"{np.mean(known):.1f}{spread}"

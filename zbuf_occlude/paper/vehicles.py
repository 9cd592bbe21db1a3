"""Test 3: what "right" means when a classifier knows cars and the scans know six kinds of vehicles (paper 4.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from zbuf_occlude.errors import ArgumentError
from zbuf_occlude.paper import sydney


@dataclass(frozen=True)
class VehicleScores:
    """How a classifier with one class "car" does on scans of six vehicle classes.

    Parameters
    ----------
    recall : dict of class to float
        The paper's "accuracy" of a class: the share of its scans that are labelled car.
    f1 : dict of class to float
    false_positives : int
        Scans of all other classes that are labelled car; the same for each of the six.
    n_scans : dict of class to int
    n_others : int
    """

    recall: dict[str, float]
    f1: dict[str, float]
    false_positives: int
    n_scans: dict[str, int]
    n_others: int

    @property
    def mean_f1(self) -> float:
        """Unweighted mean over the classes."""
        return float(np.mean(list(self.f1.values())))

    @property
    def weighted_f1(self) -> float:
        """Mean over the classes, each weighted by its number of scans."""
        return float(np.average(list(self.f1.values()), weights=[self.n_scans[label] for label in self.f1]))


def vehicle_scores(
    confusion: ArrayLike, truth: tuple[str, ...], predicted: tuple[str, ...], *, car: str = "car"
) -> VehicleScores:
    """Score a table of true against predicted classes.

    Parameters
    ----------
    confusion : (t, p) int
        Scans of each true class that got each label.
    truth, predicted : tuple of str
        Names of the rows and of the columns; the six of `sydney.VEHICLES` must be among the rows.
    car : str
        The label that all of them should get.

    Returns
    -------
    VehicleScores

    Raises
    ------
    ArgumentError
        The table does not have those rows and columns, or no scan of one of the six.

    References
    ----------
    Paper 4.4. Of a class c with n scans, TP are those labelled car; FP the scans of classes other than the six that are
    labelled car; the others of its own scans are FN = n - TP. F1 = 2 TP / (2 TP + FP + FN). "Average F1" does not say
    whether weighted; the unweighted mean is taken, the weighted one given beside it.
    """
    counts = np.asarray(confusion)
    if counts.shape != (len(truth), len(predicted)):
        raise ArgumentError(f"confusion must be ({len(truth)}, {len(predicted)}); got {counts.shape}.")
    absent = [label for label in sydney.VEHICLES if label not in truth] + [car] * (car not in predicted)
    if absent:
        raise ArgumentError(f"confusion must have the classes {', '.join(absent)}; it has not.")
    column = counts[:, predicted.index(car)]
    rows = {label: truth.index(label) for label in sydney.VEHICLES}
    if empty := [label for label, row in rows.items() if not counts[row].any()]:
        raise ArgumentError(f"confusion must have scans of each of the six classes; it has none of {', '.join(empty)}.")
    others = np.setdiff1d(np.arange(len(truth)), list(rows.values()))
    false_positives = int(column[others].sum())
    totals = {label: int(counts[row].sum()) for label, row in rows.items()}
    recall, f1 = {}, {}
    for label, row in rows.items():
        hits = int(column[row])
        recall[label] = hits / totals[label]
        f1[label] = 2 * hits / (hits + false_positives + totals[label])  # 2 TP + FP + FN = TP + FP + n
    return VehicleScores(recall, f1, false_positives, totals, int(counts[others].sum()))

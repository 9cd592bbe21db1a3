"""Report of the comparison of a drive: tables in Markdown by class and range, and of each sighting."""

import numpy as np

from zbuf_occlude.studies.compare.drive_comparison import GROUPS, Counts, DriveComparison, Sighting, drawn_returns

FITTED_ON = ("cars", "pedestrians")
"""Groups of one log, from 10 to 60 m, on which the `detection_range` of the VLP-32C was fitted."""
BINS = ((5.0, 10.0), (10.0, 20.0), (20.0, 30.0), (30.0, 40.0), (40.0, 50.0), (50.0, 60.0), (60.0, 80.0))
MIN_SIGHTINGS, MIN_OBJECTS = 20, 5
"""Sightings, and objects among them, of fewer of which a distribution says nothing."""
RESAMPLES = 400
"""Number of draws of the objects for the interval of a ratio."""


def drive_report(found: DriveComparison) -> list[str]:
    """Return the lines of the report: the sensor, each sighting where they are few, classes by range."""
    reach, columns = found.sensor.noise_model.detection_range, found.sensor.pattern["columns"]
    lost = f"reach {reach:g} m" if reach else "no lost returns"
    head = (
        f"{found.layout}, {len(found.sightings)} sightings in {found.n_taken} of {found.n_sweeps} sweeps. Sensor: "
        f"{found.sensor.name} ({found.how}), {columns} firings a turn, {lost}."
    )
    n_skipped = len(found.skipped)
    end = ["", f"Sweeps that could not be read and were skipped: {n_skipped}."] if n_skipped else []
    if not found.sightings:
        return [head, *end]
    simulated = drawn_returns(found.sightings, reach)
    few = _listed(found.sightings, simulated) if len(found.sightings) <= 3 * MIN_SIGHTINGS else []
    return [head, "", *few, *_by_range(found.sightings, simulated), *end]


def _listed(sightings: list[Sighting], simulated: Counts) -> list[str]:
    low, middle, high = np.quantile(simulated, (0.05, 0.5, 0.95), axis=0)
    return [
        "| | metres | real | simulated | 5 to 95 % | without dropout |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
        *(
            f"| {o.label} | {o.distance:.0f} | {o.real} | {m:.0f} | {a:.0f}..{b:.0f} | {o.n_without_dropout:.0f} |"
            for o, m, a, b in sorted(zip(sightings, middle, low, high, strict=True), key=lambda row: row[0].distance)
        ),
        "",
    ]


def _by_range(sightings: list[Sighting], simulated: Counts) -> list[str]:
    lines = [
        "| | metres | sightings, objects | real 50, 75, 90 % | simulated 50, 75, 90 % | ratio of medians "
        "| with other objects | without dropout | KS | within the draws |",
        "| --- | --- | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    reals = np.array([one.real for one in sightings])
    low, high = np.quantile(simulated, (0.05, 0.95), axis=0)
    within = (low <= reals) & (reals <= high)
    distances: dict[tuple[str, float], float] = {}
    for group in dict.fromkeys(GROUPS.values()):
        for nearest, farthest in BINS:
            mine = [i for i, o in enumerate(sightings) if o.group == group and nearest <= o.distance < farthest]
            if not mine:
                continue
            real, made, names = reals[mine], simulated[:, mine], [sightings[i].identity for i in mine]
            of_both = [np.quantile(values, (0.5, 0.75, 0.9)) for values in (real, made)]
            shown = " | ".join(", ".join(f"{q:.0f}" for q in each) for each in of_both)
            without = float(np.median([sightings[i].n_without_dropout for i in mine]))
            ratio, whole = (f"{of_both[0][0] / n:.2f}" if n else "-" for n in (_median_of_draws(made), without))
            trust, far = "-", "-"
            if len(mine) >= MIN_SIGHTINGS and len(set(names)) >= MIN_OBJECTS:
                distances[group, nearest] = _kolmogorov_smirnov(real, made.ravel())
                trust, far = _interval(real, made, names), f"{distances[group, nearest]:.2f}"
            lines.append(
                f"| {group} | {nearest:.0f}-{farthest:.0f} | {len(mine)}, {len(set(names))} | {shown} | {ratio} "
                f"| {trust} | {whole} | {far} | {within[mine].mean():.0%} |"
            )
    usual = [far for (group, nearest), far in distances.items() if group in FITTED_ON and 10.0 <= nearest <= 50.0]
    means = " ".join(
        f"Mean KS of {what}: {np.mean(far):.3f}."
        for what, far in (
            (f"{len(distances)} rows", list(distances.values())),
            (f"the {len(usual)} of cars and pedestrians from 10 to 60 m", usual),
        )
        if far
    )
    share = f"Within the draws: {within.mean():.0%} of {len(sightings)} sightings."
    return [*lines, "", f"{means or 'No row has enough for a KS.'} {share}"]


def _median_of_draws(simulated: Counts) -> float:
    """Return the usual median of the sightings in a draw (draws, n): few and unlike ones have no middle."""
    return float(np.median(np.median(simulated, axis=1)))


def _kolmogorov_smirnov(a: Counts, b: Counts) -> float:
    """Return the largest difference of the distribution functions of two samples."""
    values = np.sort(np.concatenate([a, b]))
    below = [np.searchsorted(np.sort(x), values, side="right") / len(x) for x in (a, b)]
    return float(np.abs(below[0] - below[1]).max())


def _interval(real: Counts, simulated: Counts, identities: list[int]) -> str:
    """Return 5 and 95 % of the ratio of medians when objects, not sightings, are drawn anew."""
    rng = np.random.default_rng(0)
    names, which = np.unique(identities, return_inverse=True)
    of_each = [np.flatnonzero(which == i) for i in range(len(names))]
    ratios = []
    for _ in range(RESAMPLES):
        mine = np.concatenate([of_each[i] for i in rng.integers(len(names), size=len(names))])
        ratios.append(np.median(real[mine]) / max(_median_of_draws(simulated[:, mine]), 0.5))
    low, high = np.quantile(ratios, (0.05, 0.95))
    return f"{low:.2f}..{high:.2f}"

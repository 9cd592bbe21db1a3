"""Random scenes against rational arithmetic: how often an exact method is wrong. It must be never.

    python benchmarks/random_scenes.py [--method exact] [--scenes 1000] [--first 0] [--seed 0]
        [--question points|rays|two-eyes]

The scenes are those of tests/random_scenes.py; contact tolerances of 0, 1e-7, 1e-5, 1e-3 and 1e-2 diagonals take turns.
Of rays first hits are asked, of two eyes which returns of a scan both see; they have no tolerance. Rational arithmetic
checks every answer that the oracle does not give too, and 40 others of each scene; of two eyes the oracle is the truth.
Exit status 1 when an answer is wrong.
"""

import sys
import time
from pathlib import Path

import numpy as np
from common import run

import zbuf_occlude as zo

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.random_scenes import CONTACTS, scene, wrong_answers_of, wrong_rays_of, wrong_returns_of

THINGS = {"points": "pairs", "rays": "rays", "two-eyes": "returns"}
"""What is asked, and what its answers are about."""
OF_NO_TOLERANCE = {"rays": wrong_rays_of, "two-eyes": wrong_returns_of}


def main(*, method: str = "exact", scenes: int = 1000, first: int = 0, seed: int = 0, question: str = "points") -> int:
    things = THINGS[question]
    totals, start = np.zeros((len(CONTACTS), 2), dtype=np.int64), time.perf_counter()
    for index in range(first, first + scenes):
        turn = index % len(CONTACTS)  # the kinds of scenes are no multiple of it
        if question == "points":
            counts = wrong_answers_of(method, seed, index, CONTACTS[turn])
        else:
            counts = OF_NO_TOLERANCE[question](method, seed, index)
        totals[turn] += counts
        if counts[0]:
            kind = scene(seed, index)[3]
            place = f"scene {index} ({kind}, contact {CONTACTS[turn]:g})"
            print(f"{place}: {counts[0]} of {counts[1]} {things} are wrong")
    if question == "points":
        for contact, counts in zip(CONTACTS, totals, strict=True):
            print(f"contact {contact:g}: {told(counts, things)}")
    whole = totals.sum(axis=0)
    print(f"{method}: {scenes} scenes, {told(whole, things)}, {time.perf_counter() - start:.0f} s")
    return 1 if whole[0] else 0


def told(counts: np.ndarray, things: str) -> str:
    wrong, n_asked = counts
    return f"{n_asked} {things}, {wrong} wrong"


if __name__ == "__main__":
    run(main, __doc__, method=[m.name for m in zo.METHODS if m.exact], question=THINGS)

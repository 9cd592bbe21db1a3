"""Batch schedulers: which share of a dataset this task makes, from I/N or from SLURM's environment."""

import re
from collections.abc import Mapping

from zbuf_occlude.errors import OptionError


def parse_shard(text: str) -> tuple[int, int]:
    """Read "I/N" with I counted from 0.

    Raises
    ------
    OptionError
        Not of that form, or I not below N.
    """
    match = re.fullmatch(r"(\d+)/(\d+)", text)
    if not match or int(match[1]) >= int(match[2]):
        raise OptionError(f"--shard must be I/N with 0 <= I < N; got {text!r}. The first of four is 0/4.")
    return int(match[1]), int(match[2])


def from_environment(environment: Mapping[str, str]) -> tuple[int, int]:
    """Return the share of a SLURM array task: (0, 1), everything, outside an array.

    SLURM_ARRAY_TASK_ID may start anywhere (``--array=7-10``): SLURM_ARRAY_TASK_MIN is taken off. Arrays with gaps
    (``--array=1,5,9``, ``--array=0-9:3``) cannot be told from their count and are refused.

    Raises
    ------
    OptionError
        The array has gaps.
    """
    if "SLURM_ARRAY_TASK_ID" not in environment or "SLURM_ARRAY_TASK_COUNT" not in environment:
        return 0, 1
    count = int(environment["SLURM_ARRAY_TASK_COUNT"])
    index = int(environment["SLURM_ARRAY_TASK_ID"]) - int(environment.get("SLURM_ARRAY_TASK_MIN", "0"))
    if not 0 <= index < count:
        raise OptionError(
            f"a SLURM array must be without gaps, like --array=0-{count - 1}; this task is number {index} of {count}. "
            "Or give --shard I/N."
        )
    return index, count

"""A comparison's folder: rows.jsonl and what the report draws of the worst views. Reading it needs nothing else."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from zbuf_occlude.compare.question import Question
from zbuf_occlude.dataset import atomic
from zbuf_occlude.errors import DatasetError

ROWS = "rows.jsonl"


class Store:
    """Rows are appended as they are made, so that what was measured survives whatever happens next.

    Parameters
    ----------
    folder : Path
        ``rows.jsonl``: one JSON object a line; of several of one suite, case and subject the last counts.
        ``questions/FINGERPRINT.npz``: positions (n, 3) float32, normals (n, 3) float32, eyes (k, 3), centre, longest.
        ``worst/KEY.npz``: outcomes (n',) uint8 of the question's first n' points in the row's worst view.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def rows(self) -> dict[tuple[str, str, str], dict[str, Any]]:
        """Read the rows by suite, case and subject. A last line that was cut off by a crash is left out.

        Raises
        ------
        DatasetError
            A line that is not a row.
        """
        path = self.folder / ROWS
        rows: dict[tuple[str, str, str], dict[str, Any]] = {}
        if not path.exists():
            return rows
        lines = path.read_text(encoding="utf-8").split("\n")
        for number, line in enumerate(lines, start=1):
            if not line:
                continue
            try:
                row = json.loads(line)
                rows[row["suite"], row["case"], row["subject"]] = row
            except (ValueError, KeyError, TypeError) as error:
                if number == len(lines):  # no newline after it: its writing was cut off
                    continue
                raise DatasetError(
                    f"every line of {path} must be a row; line {number} is not ({error}). Remove the line."
                ) from None
        return rows

    def append(self, row: dict[str, Any]) -> None:
        """Add a row."""
        self.folder.mkdir(parents=True, exist_ok=True)
        path = self.folder / ROWS
        with open(path, "a+b") as file:
            if file.tell() and not _ends_with_newline(path):
                file.truncate(path.read_bytes().rfind(b"\n") + 1)
            file.write((json.dumps(row) + "\n").encode())
            file.flush()
            os.fsync(file.fileno())

    def save_question(self, question: Question) -> None:
        """Keep a question's points and eyes for the report."""
        path = self.folder / "questions" / f"{question.fingerprint}.npz"
        if not path.exists():
            _save(
                path,
                positions=question.points.positions.astype(np.float32),
                normals=question.points.normals.astype(np.float32),
                eyes=question.views.eyes,
                centre=question.mesh.centre,
                longest=np.float64(question.mesh.longest_side),
            )

    def load_question(self, fingerprint: str) -> dict[str, Any]:
        """Read what `save_question` kept."""
        return _load(self.folder / "questions" / f"{fingerprint}.npz")

    def save_worst(self, key: str, outcomes: Any) -> None:
        """Keep the outcomes of a row's worst view."""
        _save(self.folder / "worst" / f"{key}.npz", outcomes=outcomes)

    def load_worst(self, key: str) -> Any:
        """Read what `save_worst` kept."""
        return _load(self.folder / "worst" / f"{key}.npz")["outcomes"]


def _ends_with_newline(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"


def _save(path: Path, **arrays: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic.write(path, lambda file: np.savez_compressed(file, **arrays))


def _load(path: Path) -> dict[str, Any]:
    try:
        with np.load(path) as stored:
            return {name: stored[name] for name in stored.files}
    except (OSError, ValueError) as error:
        raise DatasetError(f"{path} must be readable; {error}. Run compare again to make it.") from None

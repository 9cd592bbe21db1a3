"""Fixtures of the workers' tests."""

from pathlib import Path

import pytest


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no contact sheets, only a file of that name: a sixth of the time of the tests that finish many datasets."""

    def write(path: Path, source: object) -> bool:
        path.write_bytes(b"")
        return True

    for finishing in ("generate", "export"):
        monkeypatch.setattr(f"zbuf_occlude.dataset.{finishing}.write_contact_sheet", write)

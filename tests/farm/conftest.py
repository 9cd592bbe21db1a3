"""Fixtures of the farm's tests."""

import pytest


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no contact sheets: some 200 datasets are finished here, and each sheet takes as long as what it shows."""
    for finishing in ("finish", "convert"):
        monkeypatch.setattr(f"zbuf_occlude.dataset.{finishing}.write_contact_sheet", lambda path, source: False)

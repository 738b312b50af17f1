"""Files that other programs have changed are read here, as users may ask for."""

import pytest

from fvi_cli.storage.files import UNSEALED


@pytest.fixture(autouse=True)
def unsealed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look at every run by itself where the bytes of a file cannot be verified."""
    monkeypatch.setenv(UNSEALED, "1")

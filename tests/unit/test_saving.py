"""Files that commands write."""

from pathlib import Path

import pytest

from conftest import names
from ecatd.cli.saving import save_bytes
from ecatd.model.errors import UsageError


def test_a_dash_is_not_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError) as refused:
        save_bytes(Path("-"), b"data")
    names(refused.value, "'-'", "/dev/stdout")
    assert not list(tmp_path.iterdir())

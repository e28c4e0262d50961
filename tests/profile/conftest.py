"""The reference profile with one text replaced."""

from collections.abc import Callable
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "dbc"
REFERENCE = (FOLDER / "reference.toml").read_text(encoding="utf-8")
Edit = Callable[[str, str], Path]


@pytest.fixture
def edited(tmp_path: Path) -> Edit:
    """Write the reference profile with one text replaced; give its path."""

    def write(old: str, new: str) -> Path:
        assert old in REFERENCE
        path = tmp_path / "reference.toml"
        path.write_text(REFERENCE.replace(old, new, 1), encoding="utf-8")
        return path

    return write

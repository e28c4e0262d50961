"""The reference vehicle's messages, and a place to write variants of its files."""

from collections.abc import Callable
from pathlib import Path

import pytest

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

DBC_FOLDER = Path(__file__).parents[2] / "dbc"
Edit = tuple[str, str]


@pytest.fixture(scope="session")
def database() -> VehicleDatabase:
    return load_database(load_profile("reference"))


@pytest.fixture
def variant(tmp_path: Path) -> Callable[..., VehicleDatabase]:
    """Load the reference vehicle with texts of its two files replaced."""

    def load(*, toml: tuple[Edit, ...] = (), dbc: tuple[Edit, ...] = ()) -> VehicleDatabase:
        for name, edits in (("reference.toml", toml), ("reference.dbc", dbc)):
            text = (DBC_FOLDER / name).read_text(encoding="utf-8")
            for old, new in edits:
                assert old in text, f"{old!r} is not in {name}"
                text = text.replace(old, new)
            (tmp_path / name).write_text(text, encoding="utf-8")
        return load_database(load_profile(tmp_path / "reference.toml"))

    return load

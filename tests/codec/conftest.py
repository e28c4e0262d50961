"""The reference vehicle's messages, and a place to write variants of its files."""

from pathlib import Path
from typing import Protocol

import pytest

from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

DBC_FOLDER = Path(__file__).parents[2] / "dbc"
REFERENCE_DBC = (DBC_FOLDER / "reference.dbc").read_text(encoding="utf-8")
Edit = tuple[str, str]


def line_of(text: str) -> int:
    """The line of the reference DBC in which a text first stands."""
    return REFERENCE_DBC[: REFERENCE_DBC.index(text)].count("\n") + 1


class Variant(Protocol):
    """Loads the reference vehicle with texts of its two files replaced."""

    def __call__(self, *, toml: tuple[Edit, ...] = (), dbc: tuple[Edit, ...] = ()) -> VehicleDatabase: ...


@pytest.fixture(scope="session")
def database() -> VehicleDatabase:
    return load_database(load_profile("reference"))


@pytest.fixture
def variant(tmp_path: Path) -> Variant:
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

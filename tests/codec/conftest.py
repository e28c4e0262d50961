"""The vehicles' messages, a place to write variants of the reference vehicle's files, and the C code."""

import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Protocol

import pytest

from tests.wire_library import LIBRARY, build_wire, install_wire
from vehicle_iface import wire
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.profile import load_profile

DBC_FOLDER = Path(__file__).parents[2] / "dbc"
REFERENCE_DBC = (DBC_FOLDER / "reference.dbc").read_text(encoding="utf-8")
PROFILES = sorted(path.stem for path in DBC_FOLDER.glob("*.toml"))
Edit = tuple[str, str]


def line_of(text: str) -> int:
    """The line of the reference DBC in which a text first stands."""
    return REFERENCE_DBC[: REFERENCE_DBC.index(text)].count("\n") + 1


class Variant(Protocol):
    """Loads the reference vehicle with texts of its two files replaced."""

    def __call__(self, *, toml: tuple[Edit, ...] = (), dbc: tuple[Edit, ...] = ()) -> VehicleDatabase: ...


@cache
def load(name: str) -> VehicleDatabase:
    """The messages of a shipped profile."""
    return load_database(load_profile(name))


@pytest.fixture(scope="module")
def c_wire(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The C code, used by the program."""
    library = os.environ.get(LIBRARY) or str(build_wire(tmp_path_factory.mktemp("wire")))
    with pytest.MonkeyPatch.context() as patch:
        yield install_wire(library, patch)
    wire.find_problem.cache_clear()


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

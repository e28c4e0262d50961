"""Which code handles the frames, and what is said about it."""

import shutil
import sys
from pathlib import Path
from types import ModuleType

import pytest

from vehicle_iface import wire
from vehicle_iface.cli.doctor.findings import Verdict
from vehicle_iface.cli.doctor.system import check_wire
from vehicle_iface.errors import ConfigError


@pytest.fixture(autouse=True)
def _forget() -> None:
    wire.find_problem.cache_clear()


@pytest.fixture
def no_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """As it is where nothing was built."""
    monkeypatch.setitem(sys.modules, "vehicle_iface._wire", None)
    monkeypatch.delattr("vehicle_iface._wire", raising=False)


def build_fake(monkeypatch: pytest.MonkeyPatch, crc32: str) -> None:
    """As it is where this source was built."""
    module = ModuleType("vehicle_iface._wire")
    module.SOURCE_CRC32 = crc32  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "vehicle_iface._wire", module)
    monkeypatch.setattr("vehicle_iface._wire", module, raising=False)


@pytest.mark.usefixtures("no_library")
def test_python_is_used_where_c_is_not_built_and_doctor_says_how_to_build_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(wire.VARIABLE, raising=False)
    assert wire.describe() == "Python"
    (found,) = check_wire()
    assert (found.verdict, "is not built" in found.text, "gcc" in found.fix) == (Verdict.WARN, True, True)


@pytest.mark.usefixtures("no_library")
def test_c_where_it_is_not_built_is_an_error_with_a_way_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(wire.VARIABLE, "c")
    with pytest.raises(ConfigError, match=r"VEHICLE_IFACE_WIRE=c: .*is not built.*; unset it"):
        wire.uses_c()


def test_a_library_of_another_source_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(wire.VARIABLE, raising=False)
    build_fake(monkeypatch, "0" * 8)
    assert wire.describe() == "Python"
    assert "has changed" in wire.find_problem()


def test_an_installed_library_without_its_source_is_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv(wire.VARIABLE, raising=False)
    build_fake(monkeypatch, "0" * 8)
    shutil.copy(wire.__file__, tmp_path / "wire.py")
    monkeypatch.setattr(wire, "__file__", str(tmp_path / "wire.py"))
    assert wire.describe() == "C"
    (found,) = check_wire()
    assert (found.verdict, found.text) == (Verdict.OK, "C")


def test_the_environment_chooses_python(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    build_fake(monkeypatch, "0" * 8)
    monkeypatch.setattr(wire, "__file__", str(tmp_path / "wire.py"))
    monkeypatch.setenv(wire.VARIABLE, "python")
    assert wire.describe() == "Python"
    (found,) = check_wire()
    assert (found.verdict, found.text) == (Verdict.OK, "Python, by VEHICLE_IFACE_WIRE")


def test_an_unknown_choice_is_an_error_that_names_the_known_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(wire.VARIABLE, "rust")
    with pytest.raises(ConfigError, match="VEHICLE_IFACE_WIRE=rust: must be c or python, or unset"):
        wire.uses_c()

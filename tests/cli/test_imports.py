"""What a command imports: `--help` nothing heavy, the control process nothing that it does not need."""

import os
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

MAIN = """
import json, sys
from vehicle_iface.cli import main
try:
    main({arguments!r})
except SystemExit:
    pass
frozen = [
    f"{{kind.__module__}}.{{kind.__name__}}"
    for name, module in sys.modules.items() if name.startswith("vehicle_iface")
    for kind in vars(module).values() if isinstance(kind, type) and kind.__module__ == name
    and getattr(vars(kind).get("__dataclass_params__"), "frozen", False)
]
with open({result!r}, "w") as file:
    json.dump({{"modules": sorted(sys.modules), "frozen_dataclasses": sorted(frozen)}}, file)
"""
HEAVY = {"numpy", "msgspec", "cantools", "can", "asyncio", "viser", "tomllib"}
NOT_FOR_DRIVING = {
    "can",
    "csv",
    "asyncio",
    "difflib",
    "numpy.ma",
    "numpy.random",
    "subprocess",
    "viser",
    "vehicle_iface.drafting",
    "vehicle_iface.logs",
    "vehicle_iface.recorder",
    "vehicle_iface.review",
}


SLOW_TO_DEFINE = {"vehicle_iface.safety.limits.Channel"}  # it computes two of its fields
"""Value types that a run defines as dataclasses, at half a millisecond each; the others are a `Value`."""


class Loaded(msgspec.Struct):
    """What a process has imported and defined at the end of a command."""

    modules: set[str]
    frozen_dataclasses: set[str]


def loaded_by(folder: Path, *arguments: str) -> Loaded:
    """What a process has loaded at the end of a command."""
    result = folder / "modules.json"
    code = MAIN.format(arguments=list(arguments), result=str(result))
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=dict(os.environ))
    return msgspec.json.decode(result.read_bytes(), type=Loaded)


@pytest.mark.parametrize("arguments", [("--help",), ("run", "--help"), ("demo", "--help"), ("decode", "--help")])
def test_help_imports_nothing_heavy(arguments: tuple[str, ...], tmp_path: Path) -> None:
    modules = loaded_by(tmp_path, *arguments).modules
    assert "vehicle_iface.cli.parser" in modules
    assert not modules & HEAVY


def test_a_run_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    loaded = loaded_by(
        tmp_path,
        *("run", "--interface", "embedded", "--route", "figure8", "--arm", "--duration", "0.1"),
        *("--telemetry", str(tmp_path / "telemetry")),
    )
    assert {"numpy", "vehicle_iface.runtime.loop"} <= loaded.modules
    assert not loaded.modules & NOT_FOR_DRIVING
    assert loaded.frozen_dataclasses == SLOW_TO_DEFINE


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("2", "2")])
def test_blas_has_one_thread_from_the_start_unless_told_otherwise(
    given: str | None, used: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    if given is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", given)
    code = "import os; from vehicle_iface.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    code += "print(os.environ['OPENBLAS_NUM_THREADS'])"
    printed = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert printed.splitlines()[-1] == used

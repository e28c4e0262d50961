"""What a command imports: `--help` nothing heavy, the control process nothing that it does not need."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

MAIN = """
import json, sys
from vehicle_iface.cli import main
try:
    main({arguments!r})
except SystemExit:
    pass
with open({result!r}, "w") as file:
    json.dump(sorted(sys.modules), file)
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


def modules_of(folder: Path, *arguments: str) -> set[str]:
    """The modules that a process has imported at the end of a command."""
    result = folder / "modules.json"
    code = MAIN.format(arguments=list(arguments), result=str(result))
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=dict(os.environ))
    return set(json.loads(result.read_text()))


@pytest.mark.parametrize("arguments", [("--help",), ("run", "--help"), ("demo", "--help"), ("decode", "--help")])
def test_help_imports_nothing_heavy(arguments: tuple[str, ...], tmp_path: Path) -> None:
    modules = modules_of(tmp_path, *arguments)
    assert "vehicle_iface.cli.parser" in modules
    assert not modules & HEAVY


def test_a_run_imports_nothing_that_it_does_not_need(tmp_path: Path) -> None:
    modules = modules_of(
        tmp_path,
        *("run", "--interface", "embedded", "--route", "figure8", "--arm", "--duration", "0.1"),
        *("--telemetry", str(tmp_path / "telemetry")),
    )
    assert {"numpy", "vehicle_iface.runtime.loop"} <= modules
    assert not modules & NOT_FOR_DRIVING


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

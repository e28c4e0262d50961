"""The parser alone is loaded, and nobody else notices."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def output_of(program: str) -> str:
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    return result.stdout.strip()


def test_the_control_process_does_not_load_the_parsers_bench_tools() -> None:
    loaded = output_of(
        "import sys, vehicle_iface.cli.run; print([n for n in ('can', 'cantools.tester') if n in sys.modules])"
    )
    assert loaded == "[]"


def test_a_later_import_of_cantools_is_complete_and_has_the_same_parser() -> None:
    program = (
        "import sys, vehicle_iface.cli.run; parser = sys.modules['cantools.database'];"
        "import cantools, cantools.tester;"
        "print(cantools.database is parser, cantools.tester.Tester.__name__)"
    )
    assert output_of(program) == "True Tester"


def test_a_cantools_that_was_imported_before_is_kept() -> None:
    program = (
        "import cantools, sys, vehicle_iface.cli.run; print(sys.modules['cantools'] is cantools, 'can' in sys.modules)"
    )
    assert output_of(program) == "True True"

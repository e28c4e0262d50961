"""The classes of messages and signals alone are loaded, and nobody else notices."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def output_of(program: str) -> str:
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    return result.stdout.strip()


def test_the_control_process_loads_neither_readers_of_files_nor_bench_tools() -> None:
    loaded = output_of(
        "import sys, vehicle_iface.cli.run;"
        "print([n for n in ('can', 'cantools.tester', 'cantools.database.can.database') if n in sys.modules])"
    )
    assert loaded == "[]"


def test_a_later_import_of_cantools_is_complete_and_has_the_same_classes() -> None:
    program = (
        "from vehicle_iface.codec.cantools_classes import Message, Signal;"
        "import cantools, cantools.tester;"
        f"read = cantools.database.load_file({str(ROOT / 'dbc' / 'reference.dbc')!r}).messages[0];"
        "print(type(read) is Message is cantools.database.Message, type(read.signals[0]) is Signal,"
        "cantools.database.can.message.Message is Message, cantools.tester.Tester.__name__)"
    )
    assert output_of(program) == "True True True Tester"


def test_a_module_of_cantools_can_be_imported_first() -> None:
    program = (
        "import vehicle_iface.codec; import cantools.database.can.formats.dbc.dbc_loader;"
        "print(cantools.database.can.formats.dbc.dbc_loader.__name__)"
    )
    assert output_of(program) == "cantools.database.can.formats.dbc.dbc_loader"


def test_a_cantools_that_was_imported_before_is_kept() -> None:
    program = (
        "import cantools, sys, vehicle_iface.cli.run; from vehicle_iface.codec.cantools_classes import Message;"
        "print(sys.modules['cantools'] is cantools, 'can' in sys.modules, cantools.database.Message is Message)"
    )
    assert output_of(program) == "True True True"

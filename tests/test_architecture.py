"""Rules of the source: which package may import which, where a clock is read, where a permitted command is built."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ("vehicle_iface", "viewer")

BASE = {"errors", "units", "clock", "checks", "command_line", "standstill", "interpolation", "value"}
BASE |= {"pieces", "route_names", "wire", "_wire"}
DATA = {"frame", "reason", "status", "state", "trajectory", "command", "decoded", "profile", "motion_sources", "pose"}
DATA |= {"row", "command_forms"}
CORE = {"bus", "codec", "control", "safety", "telemetry", "state_assembler", "trajectories"}
UPPER = {"drafting", "logs", "sim", "runtime"}
TOP = {
    "arming",
    "commission",
    "compose",
    "drivable",
    "export",
    "opening",
    "process",
    "recorder",
    "rerun",
    "review",
    "cli",
    "__main__",
}
LAYERS = (BASE, DATA, CORE, UPPER, TOP)
LAYER_OF = {package: number for number, layer in enumerate(LAYERS) for package in layer}
AMONG_DATA = {
    "command_forms": {"command", "profile", "status"},
    "command": {"reason", "status"},
    "profile": {"reason", "status"},
    "motion_sources": {"profile"},
    "pose": {"profile"},
    "row": {"pose", "state", "status"},
}
"""Which data may be made of which."""
BUILDERS = {"SafeCommand": "safety/gate.py", "WireCommand": "command_forms/former.py"}
"""Who builds what the encoder takes."""
VIEWER_READS = (["telemetry"], ["recorder", "files"])
LISTENER = "viewer/vehicle_iface_viewer/bus_table/"
LISTENER_READS = (["codec"], ["bus", "listening"], ["bus", "frame_io"], ["process"])
"""The viewer's own listener, another process, decodes what it receives."""
HOMES = {
    "can": ("vehicle_iface/bus/", "vehicle_iface/logs/"),
    "cantools": ("vehicle_iface/codec/cantools_classes.py",),
    "mcap": ("vehicle_iface/export/",),
    "e2e": ("vehicle_iface/codec/",),
    "viser": ("viewer/",),
    "trimesh": ("viewer/",),
    "websockets": ("viewer/",),
}
"""Where each foreign package lives, and nowhere else."""
INDEPENDENT_TOOLS = (
    "hil_bench",
    "vehicle_bus_contract",
    "mutation_testing",
    "promise_testing",
    "defect_testing",
    "vcan_kernel",
)
CLOCKS = {
    *((module, name) for module in ("time",) for name in ("time", "time_ns", "monotonic", "monotonic_ns")),
    *(("time", name) for name in ("perf_counter", "perf_counter_ns", "process_time", "sleep", "localtime", "gmtime")),
    *(("datetime", name) for name in ("now", "utcnow", "today")),
    ("date", "today"),
}


def violations(root: Path) -> list[str]:
    """Every breach of the rules below `root`, as `file:line: what`."""
    found = []
    for package in SOURCES:
        for path in sorted((root / package).rglob("*.py")):
            place = path.relative_to(root).as_posix()
            tree = ast.parse(path.read_text(encoding="utf-8"), filename=place)
            found += [f"{place}:{line}: {what}" for line, what in _of_module(place, tree)]
    return found


def _of_module(place: str, tree: ast.Module) -> Iterator[tuple[int, str]]:
    if tree.body and not ast.get_docstring(tree):
        yield 1, "module without a docstring"
    for line, module in _imports(tree, place):
        yield from ((line, what) for what in _import_faults(place, module))
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            yield from ((node.lineno, what) for what in _call_faults(place, node))


def _imports(tree: ast.Module, place: str) -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything imported; `from a import b` is a.b."""
    package = place.removesuffix(".py").split("/")[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((node.lineno, f"{module}.{alias.name}") for alias in node.names)


def _package(place: str) -> str:
    """`vehicle_iface/bus/base.py` → bus, `vehicle_iface/state_assembler.py` → state_assembler."""
    return place.split("/")[1].removesuffix(".py")


def _import_faults(place: str, module: str) -> Iterator[str]:
    top, *rest = module.split(".")
    homes = HOMES.get(top)
    if homes is not None and not place.startswith(homes):
        yield f"imports {top}, which belongs in {' and '.join(homes)}"
    if top == "time" and place != "vehicle_iface/clock.py":
        yield "imports time: clocks are read in clock.py"
    if top == "vehicle_iface_viewer" and place.startswith("vehicle_iface/"):
        yield "vehicle_iface imports the viewer"
    if top != "vehicle_iface" or not rest:
        return
    if place.startswith("viewer/"):
        reads = (*VIEWER_READS, *(LISTENER_READS if place.startswith(LISTENER) else ()))
        if rest[0] not in BASE | DATA and not any(rest[: len(read)] == read for read in reads):
            yield f"viewer imports {module}: only base, data, telemetry and recorder.files"
    elif place != "vehicle_iface/__init__.py":
        yield from _layer_faults(_package(place), rest[0])


def _layer_faults(here: str, there: str) -> Iterator[str]:
    if here not in LAYER_OF:
        yield f"{here} is on no layer: give it one in this test"
    elif there not in LAYER_OF:
        yield f"imports {there}, which is on no layer"
    elif LAYER_OF[there] > LAYER_OF[here]:
        yield f"{here} imports {there} from a layer above"
    elif here != there and LAYER_OF[there] == LAYER_OF[here]:
        may = here in BASE | TOP or there in AMONG_DATA.get(here, ())
        if not may:
            yield f"{here} imports {there} of its own layer"
    elif here in ("drafting", "logs", "sim") and there in CORE - {"codec"}:
        yield f"{here} imports {there}: of the core only codec"


def _call_faults(place: str, call: ast.Call) -> Iterator[str]:
    function = call.func
    name = function.id if isinstance(function, ast.Name) else getattr(function, "attr", "")
    if name in BUILDERS and place != f"vehicle_iface/{BUILDERS[name]}":
        yield f"builds a {name}: only {BUILDERS[name]} may"
    if isinstance(function, ast.Attribute):
        owner = function.value
        owner_name = owner.id if isinstance(owner, ast.Name) else owner.attr if isinstance(owner, ast.Attribute) else ""
        if (owner_name, function.attr) in CLOCKS and place != "vehicle_iface/clock.py":
            yield f"reads {owner_name}.{function.attr}(): clocks are read in clock.py"


def test_the_source_keeps_the_rules() -> None:
    assert violations(ROOT) == []


def test_every_package_is_on_a_layer() -> None:
    packages = {_package(path.relative_to(ROOT).as_posix()) for path in (ROOT / "vehicle_iface").rglob("*.py")}
    packages |= {path.stem for path in (ROOT / "vehicle_iface").glob("*.pyi")}
    assert packages - {"__init__"} == set(LAYER_OF)


def test_tools_that_judge_the_product_share_no_code_with_it() -> None:
    for package in INDEPENDENT_TOOLS:
        paths = list((ROOT / "tools" / package).rglob("*.py"))
        assert paths
        for path in paths:
            place = path.relative_to(ROOT).as_posix()
            modules = {name.split(".")[0] for _, name in _imports(ast.parse(path.read_text("utf-8")), place)}
            assert modules.isdisjoint({"vehicle_iface", "vehicle_iface_viewer", "e2e"}), place


PLANTED = [
    ("vehicle_iface/units.py", "import vehicle_iface.frame", "from a layer above"),
    ("vehicle_iface/frame.py", "from vehicle_iface.bus import base", "from a layer above"),
    ("vehicle_iface/frame.py", "from vehicle_iface import state", "of its own layer"),
    ("vehicle_iface/state.py", "from . import trajectory", "of its own layer"),
    ("vehicle_iface/bus/receive.py", "from vehicle_iface.codec.decoder import Decoder", "of its own layer"),
    ("vehicle_iface/state_assembler.py", "from vehicle_iface.control import base", "of its own layer"),
    ("vehicle_iface/control/base.py", "from ..safety import gate", "of its own layer"),
    ("vehicle_iface/safety/gate.py", "def f():\n    from vehicle_iface.runtime import loop", "from a layer above"),
    ("vehicle_iface/sim/model.py", "from vehicle_iface.bus.base import Bus", "of the core only codec"),
    ("vehicle_iface/sim/model.py", "from vehicle_iface.runtime.loop import Loop", "of its own layer"),
    ("vehicle_iface/logs/columns.py", "from vehicle_iface.bus.base import Bus", "of the core only codec"),
    ("vehicle_iface/drafting/survey.py", "from vehicle_iface.bus.base import Bus", "of the core only codec"),
    ("vehicle_iface/drafting/survey.py", "from cantools.database import Message", "imports cantools"),
    ("vehicle_iface/codec/decoder.py", "from vehicle_iface.logs import columns", "from a layer above"),
    ("vehicle_iface/runtime/loop.py", "from vehicle_iface.logs import columns", "of its own layer"),
    ("vehicle_iface/runtime/loop.py", "from vehicle_iface import compose", "from a layer above"),
    ("vehicle_iface/runtime/loop.py", "from vehicle_iface.sim import model", "of its own layer"),
    ("vehicle_iface/attic.py", "from vehicle_iface import units", "is on no layer"),
    ("vehicle_iface/cli/run.py", "import vehicle_iface_viewer.app", "vehicle_iface imports the viewer"),
    (
        "viewer/vehicle_iface_viewer/app.py",
        "from vehicle_iface.runtime.loop import Loop",
        "only base, data, telemetry and recorder.files",
    ),
    (
        "viewer/vehicle_iface_viewer/app.py",
        "from vehicle_iface.codec.decoder import Decoder",
        "only base, data, telemetry and recorder.files",
    ),
    (
        "viewer/vehicle_iface_viewer/bus_table/listener.py",
        "from vehicle_iface.bus.socketcan import SocketCanBus",
        "only base, data, telemetry and recorder.files",
    ),
    (
        "viewer/vehicle_iface_viewer/app.py",
        "from vehicle_iface.safety import gate",
        "only base, data, telemetry and recorder.files",
    ),
    (
        "viewer/vehicle_iface_viewer/playback.py",
        "from vehicle_iface.recorder import recorder",
        "only base, data, telemetry and",
    ),
    ("vehicle_iface/runtime/loop.py", "from vehicle_iface.recorder import child", "from a layer above"),
    ("vehicle_iface/runtime/loop.py", "import can", "imports can"),
    ("vehicle_iface/state_assembler.py", "from cantools.database import Message", "imports cantools"),
    ("vehicle_iface/telemetry/writer.py", "import viser", "imports viser"),
    ("vehicle_iface/control/base.py", "from time import monotonic_ns", "imports time"),
    ("viewer/vehicle_iface_viewer/feed.py", "import time\nx = time.time()", "reads time.time()"),
    ("vehicle_iface/cli/run.py", "import datetime\nx = datetime.datetime.now()", "reads datetime.now()"),
    ("vehicle_iface/cli/run.py", "from datetime import datetime\nx = datetime.utcnow()", "reads datetime.utcnow()"),
    ("vehicle_iface/runtime/cycle.py", "x = SafeCommand(enable=True)", "builds a SafeCommand"),
    ("vehicle_iface/runtime/transmitter.py", "x = WireCommand(enable=True)", "builds a WireCommand"),
    (
        "vehicle_iface/compose.py",
        "from vehicle_iface import command as c\nx = c.SafeCommand()",
        "builds a SafeCommand",
    ),
]


@pytest.mark.parametrize(("place", "source", "what"), PLANTED)
def test_a_planted_breach_is_found(tmp_path: Path, place: str, source: str, what: str) -> None:
    path = tmp_path / place
    path.parent.mkdir(parents=True)
    path.write_text(f'"""A module."""\n{source}\n', encoding="utf-8")
    found = violations(tmp_path)
    assert found
    assert all(line.startswith(f"{place}:") for line in found)
    assert any(what in line for line in found)


def test_a_module_without_a_docstring_is_found(tmp_path: Path) -> None:
    path = tmp_path / "vehicle_iface" / "units.py"
    path.parent.mkdir()
    path.write_text("x = 1\n", encoding="utf-8")
    assert violations(tmp_path) == ["vehicle_iface/units.py:1: module without a docstring"]


@pytest.mark.parametrize(
    ("place", "source"),
    [
        ("vehicle_iface/clock.py", "import time\nx = time.monotonic_ns()"),
        ("vehicle_iface/safety/gate.py", "x = SafeCommand(enable=True)"),
        ("vehicle_iface/bus/python_can.py", "import can"),
        ("vehicle_iface/sim/wire.py", "from vehicle_iface.codec.database import BoundMessage"),
        ("vehicle_iface/cli/run.py", "from vehicle_iface import compose"),
        ("viewer/vehicle_iface_viewer/app.py", "from vehicle_iface.telemetry import TelemetryReader\nimport viser"),
    ],
)
def test_allowed_imports_are_not_reported(tmp_path: Path, place: str, source: str) -> None:
    path = tmp_path / place
    path.parent.mkdir(parents=True)
    path.write_text(f'"""A module."""\n{source}\n', encoding="utf-8")
    assert violations(tmp_path) == []


# The tools


def tool(*command: str, at: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", *command], cwd=at, capture_output=True, text=True, check=False)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A small tree with the project's own configuration of the tools."""
    (tmp_path / "pyproject.toml").write_bytes((ROOT / "pyproject.toml").read_bytes())
    return tmp_path


@pytest.mark.parametrize(
    ("source", "rule"),
    [
        ("import os\n", "F401"),
        ("try:\n    x = 1\nexcept Exception:\n    pass\n", "BLE001"),
        ("def f(a=[]):\n    return a\n", "B006"),
        ("import datetime\n\nx = datetime.datetime.now()\n", "DTZ005"),
        ("import numpy as np\n\nnp.random.seed(1)\n", "NPY002"),
        (f"x = '{'x' * 130}'\n", "E501"),
    ],
)
def test_ruff_as_configured_fails_on_a_planted_mistake(copy: Path, source: str, rule: str) -> None:
    (copy / "good.py").write_text('"""Good."""\n', encoding="utf-8")
    assert tool("ruff", "check", "good.py", at=copy).returncode == 0
    (copy / "bad.py").write_text(source, encoding="utf-8")
    result = tool("ruff", "check", "bad.py", at=copy)
    assert result.returncode == 1
    assert rule in result.stdout


def test_ruff_format_as_configured_fails_on_a_planted_layout(copy: Path) -> None:
    (copy / "bad.py").write_text("x = {'a':1}\n", encoding="utf-8")
    assert tool("ruff", "format", "--check", "bad.py", at=copy).returncode == 1


def test_mypy_as_configured_fails_on_planted_mistakes(copy: Path) -> None:
    bad = "def f(a):\n    return a\n\n\ndef g() -> int:\n    return 'x'\n\n\ndef h(a: list) -> None:\n    print(a)\n"
    (copy / "bad.py").write_text(bad, encoding="utf-8")
    result = tool("mypy", "--cache-dir", str(copy / "cache"), "bad.py", at=copy)
    assert result.returncode == 1
    for code in ("no-untyped-def", "return-value", "type-arg"):
        assert code in result.stdout
    (copy / "bad.py").write_text("x: int = 1\n", encoding="utf-8")
    assert tool("mypy", "--cache-dir", str(copy / "cache"), "bad.py", at=copy).returncode == 0


def test_a_warning_in_a_test_as_configured_is_an_error(copy: Path) -> None:
    (copy / "test_bad.py").write_text("import warnings\n\n\ndef test_x():\n    warnings.warn('x')\n", encoding="utf-8")
    result = tool("pytest", "-q", "-p", "no:cacheprovider", "test_bad.py", at=copy)
    assert result.returncode == 1
    assert "UserWarning" in result.stdout


def import_cycle(base: Path, packages: str) -> str:
    """The first cycle of imports among the packages of `base` that match, as `a → b → a`; empty without one."""
    paths = [path for package in base.glob(packages) for path in package.rglob("*.py")]
    modules = {".".join(path.relative_to(base).with_suffix("").parts).removesuffix(".__init__"): path for path in paths}
    imports: TopologicalSorter[str] = TopologicalSorter()
    for module, path in modules.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for _, name in _imports(tree, path.relative_to(base).as_posix()):
            imported = name if name in modules else name.rpartition(".")[0]
            if imported in modules and imported != module:
                imports.add(module, imported)
    try:
        imports.prepare()
    except CycleError as error:
        return " → ".join(error.args[1])
    return ""


@pytest.mark.parametrize(("folder", "packages"), [(".", "vehicle_iface"), ("viewer", "*"), ("tools", "*")])
def test_no_module_imports_itself_through_others(folder: str, packages: str) -> None:
    assert any((ROOT / folder).glob(f"{packages}/*.py"))
    assert import_cycle(ROOT / folder, packages) == ""


def test_an_import_cycle_is_found_even_inside_a_function(tmp_path: Path) -> None:
    (tmp_path / "rig").mkdir()
    (tmp_path / "rig" / "__init__.py").write_text("")
    (tmp_path / "rig" / "faults.py").write_text("from . import bench\n")
    (tmp_path / "rig" / "bench.py").write_text("def f():\n    from rig.faults import g\n")
    cycle = import_cycle(tmp_path, "*").split(" → ")
    assert (cycle[0], set(cycle)) == (cycle[-1], {"rig.bench", "rig.faults"})

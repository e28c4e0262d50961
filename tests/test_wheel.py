"""The wheel, installed into an environment of its own: its contents, its commands, and a user's typed controller."""

import ast
import os
import re
import subprocess
import sys
import sysconfig
import venv
import zipfile
from email.parser import Parser
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

CONTROLLER = """
from vehicle_iface import Command, ControllerBase, Reason, VehicleState


class Creep(ControllerBase):
    def compute_command_impl(self, state: VehicleState) -> Command:
        return Command(stamp_ns=state.stamp_ns, accel_mps2=0.1, front_wheel_angle_rad=0.0, speed_mps={speed})
"""


def build_wheel(folder: Path, **environment: str) -> Path:
    """The wheel as a release builds it, with these environment variables."""
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True, env=os.environ | environment)
    (file,) = folder.glob("*.whl")
    return file


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of a machine with a C compiler."""
    return build_wheel(tmp_path_factory.mktemp("dist"), VEHICLE_IFACE_WIRE="c")


@pytest.fixture(scope="module")
def user_python(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return install(wheel, tmp_path_factory.mktemp("environment"))


def install(wheel: Path, folder: Path) -> Path:
    """An environment with the wheel; its dependencies are those of the tests' environment."""
    venv.create(folder)
    python = folder / "bin" / "python"
    command = ["-m", "pip", "--python", str(python), "install", "--quiet", "--no-index", "--no-deps", str(wheel)]
    subprocess.run([sys.executable, *command], check=True, capture_output=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python


def check(python: Path, source: str, folder: Path) -> tuple[int, str]:
    """Exit status and output of `mypy --strict` over `source`, in a user's folder."""
    (folder / "creep.py").write_text(source)
    command = [sys.executable, "-m", "mypy", "--strict", "--python-executable", str(python), "creep.py"]
    environment = {"PATH": "/usr/bin:/bin", "HOME": str(folder)}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.timeout(300)
def test_a_typed_controller_passes_mypy_strict_and_a_wrong_type_in_it_is_found(
    user_python: Path, tmp_path: Path
) -> None:
    assert check(user_python, CONTROLLER.format(speed="1.0"), tmp_path) == (
        0,
        "Success: no issues found in 1 source file\n",
    )
    status, output = check(user_python, CONTROLLER.format(speed='"fast"'), tmp_path)
    assert status == 1
    assert '"speed_mps" to "Command" has incompatible type "str"; expected "float"' in output


def test_the_wheel_has_the_marker_of_typed_packages_and_the_reference_vehicle(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    assert {"vehicle_iface/py.typed", "vehicle_iface/dbc/reference.dbc", "vehicle_iface/dbc/reference.toml"} <= names


def test_the_wheel_installs_no_generic_name(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    packages = {name.split("/")[0] for name in names if ".dist-info/" not in name}
    assert packages == {"vehicle_iface", "vehicle_iface_viewer", "hil_bench", "vehicle_bus_contract"}


def run_installed(python: Path, *command: str, at: Path) -> str:
    """Output of an installed command, called as a user does who has no source checkout."""
    done = subprocess.run([python.parent / command[0], *command[1:]], cwd=at, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


SAYS_WIRE = "from vehicle_iface import wire; print(wire.describe(), wire.find_problem())"


@pytest.mark.timeout(300)
def test_the_wheel_of_a_machine_with_a_compiler_has_the_c_code_for_every_python_from_3_11_on(
    wheel: Path, user_python: Path, tmp_path: Path
) -> None:
    assert re.search(r"-cp311-abi3-linux_\w+\.whl$", wheel.name)
    names = set(zipfile.ZipFile(wheel).namelist())
    assert "vehicle_iface/_wire.abi3.so" in names
    assert "vehicle_iface/_wire.c" not in names
    assert run_installed(user_python, "python", "-c", SAYS_WIRE, at=tmp_path).split() == ["C"]


@pytest.mark.timeout(300)
@pytest.mark.parametrize("compiler", ["/no/such/cc", "false"])
def test_the_wheel_of_a_machine_without_a_compiler_is_pure_and_works(compiler: str, tmp_path: Path) -> None:
    pure = build_wheel(tmp_path, CC=compiler)
    assert pure.name.endswith("-py3-none-any.whl")
    assert not any(name.endswith((".so", ".c")) for name in zipfile.ZipFile(pure).namelist())
    said = run_installed(install(pure, tmp_path / "venv"), "python", "-c", SAYS_WIRE, at=tmp_path)
    assert said.startswith("Python vehicle_iface/_wire.c is not built")


def test_a_wheel_that_must_have_the_c_code_is_not_built_without_a_compiler(tmp_path: Path) -> None:
    with pytest.raises(subprocess.CalledProcessError) as caught:
        build_wheel(tmp_path, CC="/no/such/cc", VEHICLE_IFACE_WIRE="c")
    assert b"cannot be built: no C compiler (/no/such/cc)" in caught.value.stderr


@pytest.mark.timeout(300)
def test_the_installed_bench_explains_itself_and_lists_its_cases(user_python: Path, tmp_path: Path) -> None:
    assert run_installed(user_python, "hil-bench", "--help", at=tmp_path).startswith("usage: hil-bench ")
    assert re.search(r"^\d+ cases$", run_installed(user_python, "hil-bench", "--list", at=tmp_path), re.MULTILINE)
    assert "straight-400-m-at-5.csv" in run_installed(user_python, "hil-bench", "--write-routes", "r", at=tmp_path)


@pytest.mark.timeout(300)
def test_the_installed_bench_finds_its_profiles_and_its_page(user_python: Path, tmp_path: Path) -> None:
    program = """
import sys
from pathlib import Path

from hil_bench import bench, places, wire
from hil_bench.report import html

sys.path.append(sys.argv[1])
import example_run

assert places.CHECKOUT is None
assert wire.Wire("reference").name == "reference"
print(bench.environment(["vcan0"], "SocketCAN vcan0")["revision"], html.write(example_run.run(), Path(".")))
"""
    (tmp_path / "program.py").write_text(program)
    arguments = ("program.py", str(ROOT / "tests" / "hil_bench"))
    version, page = run_installed(user_python, "python", *arguments, at=tmp_path).split()
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*", version)
    assert "<title>" in (tmp_path / page).read_text()


def test_the_bench_extra_installs_everything_that_the_bench_imports(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
    imported = set()
    for name in archive.namelist():
        if name.startswith(("hil_bench/", "vehicle_bus_contract/")) and name.endswith(".py"):
            for node in ast.walk(ast.parse(archive.read(name))):
                if isinstance(node, ast.Import):
                    imported |= {alias.name.partition(".")[0] for alias in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module:
                    imported.add(node.module.partition(".")[0])
    (metadata,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    required = Parser().parsestr(archive.read(metadata).decode()).get_all("Requires-Dist", [])
    of_bench = {
        re.split(r"[^\w-]", line)[0]
        for line in required
        if "extra ==" not in line or re.search("extra == .bench", line)
    }
    assert imported - sys.stdlib_module_names <= of_bench | {"hil_bench", "vehicle_bus_contract", "markupsafe"}
    assert {"jinja2", "rich"} <= of_bench

"""What the README and the pages of `docs/` show runs as it stands there."""

import re
import shlex
from pathlib import Path

import numpy as np

from tests.harness import Drive
from tests.test_architecture import LAYERS
from vehicle_iface import ControllerBase, Reason
from vehicle_iface.cli.parser import build_parser, command_names
from vehicle_iface.compose import build_controller
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.trajectories import RecedingRoute, make_route

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("dbc", "docs", "tools", "vehicle_iface")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def _example() -> str:
    blocks: list[str] = re.findall(r"```python\n(.*?)```", README, re.S)
    return next(block for block in blocks if "class Stanley" in block)


def test_the_controller_of_the_readme_drives_the_figure_of_eight(tmp_path: Path) -> None:
    file = tmp_path / "stanley.py"
    file.write_text(_example())
    controller = build_controller(f"{file}:Stanley", load_profile("reference"))
    assert isinstance(controller, ControllerBase)
    route = make_route("figure8")
    x_m, y_m, heading_rad = route.start
    start = BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)
    drive = Drive(RecedingRoute(route), controller=controller, start=start)
    off_m = []
    for _ in range(45):
        drive.run_s(1.0)
        off_m.append(float(np.hypot(route.x_m - drive.state.x_m, route.y_m - drive.state.y_m).min()))
    assert max(off_m) < 0.3
    assert drive.loop.reason is Reason.NOMINAL
    assert drive.vehicle.state.speed_mps > 1.0


def test_the_controller_of_the_readme_is_about_twenty_lines_long() -> None:
    lines = [line for line in _example().splitlines() if line.strip()]
    assert len(lines) <= 20


def pages() -> list[Path]:
    """Every page of the project that describes what there is now."""
    return [ROOT / "README.md", *(path for folder in PAGES for path in (ROOT / folder).rglob("*.md"))]


def test_every_command_that_a_page_names_exists() -> None:
    used = {name for page in pages() for name in re.findall(r"vehicle-iface ([a-z][a-z-]+)", page.read_text())}
    assert used
    assert used <= command_names()


def test_every_command_line_of_a_page_is_accepted() -> None:
    found = [
        line for page in pages() for line in re.findall(r"^ *vehicle-iface (?!view)([a-z].*)", page.read_text(), re.M)
    ]
    assert len(found) > 10
    for line in found:
        words = shlex.split(line.partition(" &")[0], comments=True)
        assert build_parser().parse_args(words).command == words[0]


def test_the_layers_of_the_architecture_page_are_those_that_are_enforced() -> None:
    page = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    cells = re.findall(r"^\| (?:top|upper|core|data|base) \| ([^|]+) \|", page, re.M)
    assert [set(re.findall(r"`(\w+)`", cell)) for cell in cells] == [layer - {"__main__"} for layer in LAYERS[::-1]]


def test_the_controller_of_the_page_runs_without_a_loop() -> None:
    page = (ROOT / "docs" / "own-controller.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", page, re.S)
    exec(compile(block, "own-controller.md", "exec"), {})


def test_every_file_that_a_page_links_is_there() -> None:
    links = {
        (page.relative_to(ROOT).as_posix(), link): page.parent / link
        for page in {*pages(), *ROOT.glob("*.md")}
        for link in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
        if "://" not in link
    }
    assert len(links) > 20
    assert [place for place, target in links.items() if not target.exists()] == []

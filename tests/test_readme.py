"""What the README shows runs as it stands there."""

import re
from pathlib import Path

import numpy as np
from harness import Drive

from vehicle_iface import ControllerBase, Reason
from vehicle_iface.cli import command_names
from vehicle_iface.compose import build_controller
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.trajectories import RecedingRoute, make_route

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def _example() -> str:
    return next(block for block in re.findall(r"```python\n(.*?)```", README, re.S) if "class Stanley" in block)


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


def test_every_command_that_a_page_names_exists() -> None:
    pages = [ROOT / "README.md", ROOT / "dbc" / "README.md", *(ROOT / "vehicle_iface").glob("*.md")]
    used = {name for page in pages for name in re.findall(r"vehicle-iface ([a-z][a-z-]+)", page.read_text())}
    assert used
    assert used <= command_names()


def test_every_file_that_the_readme_links_is_there() -> None:
    root = Path(__file__).resolve().parents[1]
    links = [link for link in re.findall(r"\]\(([^)#]+)\)", README) if "://" not in link]
    assert links
    assert [link for link in links if not (root / link).exists()] == []

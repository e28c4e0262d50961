"""The minimal controller without a bus: independent of the project, and a sound reader of frames and routes."""

import ast
import math
import subprocess
import sys
from pathlib import Path

import pytest
from minimal_controller import MOTION, POSE, STALE_NS, VEHICLE_STATUS, Receiver, State, crc8
from minimal_route import read_route

HERE = Path(__file__).resolve().parent
FILES = ("minimal_controller.py", "minimal_route.py", "minimal_recorder.py", "minimal_view.py", "defects.py")
SQUARE_BACK = """time_s,x_m,y_m,heading_rad,speed_mps
# there, and back in reverse
0,0,0,0,2
2,4,0,0,0
2,4,0,0,-1
6,0,0,0,-1
"""


def part(can_id: int, counter: int, content: bytes = bytes(6)) -> bytes:
    """A frame's data with its CRC."""
    data = bytes((0, counter)) + content
    return bytes((crc8(can_id, data),)) + data[1:]


def state(x_m: float = 0.0, y_m: float = 0.0, stamp_ns: int = 0, counter: int = 0) -> State:
    """At 3 m/s along x."""
    return State(stamp_ns, counter, 1, True, x_m, y_m, 0.0, 3.0, 0.0, 0.0)


@pytest.mark.parametrize("file", FILES)
def test_it_imports_nothing_but_the_standard_library_and_itself(file: str) -> None:
    own = {Path(name).stem for name in FILES}
    for node in ast.walk(ast.parse((HERE / file).read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or "."] if isinstance(node, ast.ImportFrom) else []
        assert {name.split(".")[0] for name in names} <= sys.stdlib_module_names | own


def test_the_worked_example_of_the_contract_is_met() -> None:
    assert part(VEHICLE_STATUS, 1)[:2].hex(" ") == "02 01"
    assert part(VEHICLE_STATUS, 2)[:2].hex(" ") == "e5 02"


@pytest.mark.parametrize(("step", "is_taken"), [(0, False), (1, True), (3, True), (4, False), (14, False)])
def test_a_counter_may_step_by_one_to_three(step: int, is_taken: bool) -> None:
    receiver = Receiver("")
    assert receiver.is_whole(POSE, part(POSE, 13))
    assert receiver.is_whole(POSE, part(POSE, (13 + step) % 15)) is is_taken


def test_every_flipped_bit_is_detected_unless_the_crc_is_unchecked() -> None:
    good = part(MOTION, 5)
    for bit in range(64):
        bad = (int.from_bytes(good, "little") ^ 1 << bit).to_bytes(8, "little")
        assert not Receiver("").is_whole(MOTION, bad)
    assert Receiver("crc_unchecked").is_whole(MOTION, bytes((good[0] ^ 1,)) + good[1:])


def test_a_sample_is_three_parts_with_one_counter_within_50_ms() -> None:
    receiver = Receiver("")
    assert receiver.sample(POSE, part(POSE, 0x52), 0) is None
    assert receiver.sample(MOTION, part(MOTION, 0x03), 1) is None
    assert receiver.sample(0x112, part(0x112, 0x02), 2) is None
    assert receiver.sample(MOTION, part(MOTION, 0x02), STALE_NS + 1) is None  # the first two are too old
    assert receiver.sample(POSE, part(POSE, 0x52), STALE_NS + 2) is None
    whole = receiver.sample(0x112, part(0x112, 0x02), STALE_NS + 3)
    assert whole is not None
    assert (whole.counter, whole.frame, whole.is_valid) == (2, 1, True)


def test_a_position_jump_is_flagged_but_not_the_return() -> None:
    receiver = Receiver("")
    assert receiver.is_plausible(state())
    assert not receiver.is_plausible(state(5.0, stamp_ns=10_000_000, counter=1))
    assert not receiver.is_plausible(state(5.0, stamp_ns=20_000_000, counter=2))
    assert receiver.doubts == 2
    assert receiver.is_plausible(state(0.09, stamp_ns=30_000_000, counter=3))
    assert receiver.doubts == 0


def test_a_frozen_position_is_flagged_after_half_a_metre() -> None:
    receiver = Receiver("")
    verdicts = [receiver.is_plausible(state(stamp_ns=i * 10_000_000, counter=i % 15)) for i in range(30)]
    assert verdicts.index(False) == 17  # 17 × 3 m/s × 10 ms = 0.51 m
    assert receiver.doubts >= 3


def test_a_route_is_driven_in_legs_and_ends_at_its_last_point(tmp_path: Path) -> None:
    path = tmp_path / "route.csv"
    path.write_text(SQUARE_BACK)
    route = read_route(path)
    assert route.directions == [1, -1]
    route.locate(state(1.0, 0.5))
    assert (route.direction, route.left_of_leg_m(), route.off_m) == (1, 3.0, 0.5)
    route.next_leg()
    route.locate(state(1.0, -0.25))
    assert (route.direction, route.left_of_leg_m(), route.off_m) == (-1, math.inf, 0.25)
    assert not route.is_past
    route.locate(state(-0.1))
    assert route.is_past


@pytest.mark.parametrize(
    "text", ["", "time_s,x_m\n0,0\n", SQUARE_BACK.replace("6,0", "1,0"), SQUARE_BACK.replace("4,0", "nan,0")]
)
def test_an_invalid_route_is_rejected_before_the_bus_is_opened(tmp_path: Path, text: str) -> None:
    path = tmp_path / "route.csv"
    path.write_text(text)
    done = subprocess.run(
        [sys.executable, str(HERE / FILES[0]), "--channel", "nowhere", "--route", str(path)],
        check=False,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    assert "route.csv" in done.stderr


def test_a_missing_interface_exits_with_3_and_an_unknown_defect_with_2(tmp_path: Path) -> None:
    path = tmp_path / "route.csv"
    path.write_text(SQUARE_BACK)
    command = [sys.executable, str(HERE / FILES[0]), "--channel", "nowhere", "--route", str(path)]
    assert subprocess.run(command, check=False, capture_output=True).returncode == 3
    assert subprocess.run([*command, "--defect", "none"], check=False, capture_output=True).returncode == 2

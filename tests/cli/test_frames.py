"""The frame of reference that a command line names, or the vehicle's own."""

from pathlib import Path

from tests.harness import reference
from tests.vehicles.files import load_vehicle
from vehicle_iface.cli.frames import check_frame


def test_without_a_frame_it_is_the_vehicles_and_map_of_several(tmp_path: Path) -> None:
    assert check_frame(None, load_vehicle("odometry", tmp_path)) == "odom"
    assert list(reference().frames.values()) == ["odom", "map"]
    assert check_frame(None, reference()) == "map"

"""tools/shipped_drives where there is no bus: what it drives, and what it refuses."""

from pathlib import Path

from drive_checks.shipped_drives import DBC, Drive, Track, drivable_vehicles, incomplete_at_start, line

from .running import run_module


def refused(*arguments: str) -> str:
    """What it says when it refuses to drive."""
    done = run_module("drive_checks.shipped_drives", *arguments)
    assert done.returncode == 2, done.stderr
    return done.stderr


def test_it_drives_the_shipped_vehicles_of_other_makers() -> None:
    assert "agilex_hunter" in drivable_vehicles()
    assert {"reference", "reference_fd"}.isdisjoint(drivable_vehicles())
    assert "agilex_hunter_ins" in drivable_vehicles()  # on two buses
    assert "toyota_rav4" not in drivable_vehicles()  # only watched


def test_it_drives_known_vehicles_on_virtual_can_interfaces_only(tmp_path: Path) -> None:
    assert "nowhere" in refused("nowhere")
    watched = (DBC / "agilex_hunter.toml").read_text(encoding="utf-8").partition("[command]")[0]
    (tmp_path / "watched.toml").write_text(watched.replace('"agilex_hunter.dbc"', f'"{DBC}/agilex_hunter.dbc"'))
    assert "has no [command] and cannot be driven" in refused(str(tmp_path / "watched.toml"))
    assert "lo is no virtual CAN interface" in refused("--channel", "lo")


def test_the_way_driven_is_that_through_all_places() -> None:
    track = Track()
    for x_m, y_m in ((0.0, 0.0), (3.0, 4.0), (3.0, 2.0)):
        track.add({"x_m": x_m, "y_m": y_m, "heading_rad": 0.0, "speed_mps": 1.0})
    assert track.driven_m == 7.0
    assert track.standing_s == 0.0


def test_a_vehicle_that_keeps_its_place_is_standing() -> None:
    track = Track()
    for _ in range(2):
        track.add({"x_m": 3.0, "y_m": 0.0, "heading_rad": 0.0, "speed_mps": 0.0})
    assert track.standing_s > 0.0


def test_a_drive_is_reported_with_its_distance_and_all_faults() -> None:
    drive = Drive(
        "rover", "u_turn", 58.2, 46.6, 0.079, stale_stops=2, wrong=("drops: bad CRC STATE 2", "late"), tries=3
    )
    assert " ".join(line(drive).split()) == (
        "rover u_turn 58.2 m in 46.6 s, at most 0.079 m from the path, 2 stops for late samples, try 3: "
        "drops: bad CRC STATE 2; late"
    )


def test_before_the_slowest_part_has_come_samples_are_incomplete() -> None:
    assert incomplete_at_start("j1939_truck") == 10  # speed every 100 ms, samples every 10 ms
    assert incomplete_at_start("agilex_hunter") == 1

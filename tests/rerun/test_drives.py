"""Recorded drives with every kind of stop: run again, no command differs."""

import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.harness import straight
from tests.rerun.recorded import RecordedDrive
from vehicle_iface.rerun.drive import rerun
from vehicle_iface.sim.driver_commands import execute

PROFILES = ("reference", "reference_fd")
FRAGILE = '''"""Raises now and then."""
from vehicle_iface import Command, PurePursuit, PurePursuitConfig, VehicleState


class Fragile(PurePursuit):
    @classmethod
    def from_profile(cls, profile, behavior):
        return cls(PurePursuitConfig(wheelbase_m=profile.geometry.wheelbase_m), behavior=behavior)

    def compute_command_impl(self, state: VehicleState) -> Command:
        if 3.0 < state.x_m < 3.5:
            raise ArithmeticError("not here")
        return super().compute_command_impl(state)
'''


def brake(drive: RecordedDrive) -> None:
    drive.tell("brake 1")
    drive.run_s(0.5)
    drive.tell("brake 0")
    drive.loop.arming.request()


def fault(drive: RecordedDrive) -> None:
    drive.tell("fault 7")


def mute(drive: RecordedDrive) -> None:
    drive.tell("mute STATE on")
    drive.run_s(0.2)
    drive.tell("mute STATE off")


def silence(drive: RecordedDrive) -> None:
    drive.tell("mute STATE on")
    drive.run_s(0.8)
    drive.tell("mute STATE off")
    drive.loop.arming.request()


def jump(drive: RecordedDrive) -> None:
    drive.tell("jump 0 6")


def doubt(drive: RecordedDrive) -> None:
    drive.tell("pose_valid 0")
    drive.run_s(0.4)
    drive.tell("pose_valid 1")


def other_frame(drive: RecordedDrive) -> None:
    drive.tell("frame ODOM")


def recover(drive: RecordedDrive) -> None:
    """What is needed to drive again; the vehicle refuses what is not."""
    drive.loop.arming.request()
    for line in ("reset", "ready"):
        execute(drive.vehicle, line)


def cut(drive: RecordedDrive) -> None:
    drive.bus.is_down = True
    drive.run_s(0.45)
    drive.bus.is_down = False
    drive.run_s(0.5)
    recover(drive)


def half(drive: RecordedDrive) -> None:
    drive.bus.takes = 0
    drive.run_s(0.06)
    drive.bus.takes = None


def full(drive: RecordedDrive) -> None:
    drive.bus.is_waiting = True
    drive.run_s(0.06)
    drive.bus.is_waiting = False


def beside(drive: RecordedDrive) -> None:
    drive.bus.extra = [drive.bus.log[-1]._replace(stamp_ns=drive.clock.peek_ns())]


def stall(drive: RecordedDrive) -> None:
    drive.clock.sleep_until(drive.clock.peek_ns() + 400_000_000)


def end(drive: RecordedDrive) -> None:
    drive.loop.shutdown.request()


def end_twice(drive: RecordedDrive) -> None:
    drive.loop.shutdown.request()
    drive.run_s(0.3)
    drive.loop.shutdown.request()


STOPS: dict[Callable[[RecordedDrive], None], str] = {
    brake: "DRIVER_OVERRIDE",
    fault: "VEHICLE_FAULT",
    mute: "STATE_STALE",
    silence: "STATE_STALE",
    jump: "STATE_INVALID",
    doubt: "STATE_INVALID",
    other_frame: "FRAME_MISMATCH",
    cut: "LINK_DOWN",
    half: "LINK_DOWN",
    full: "LINK_DOWN",
    beside: "DUPLICATE_COMMANDER",
    stall: "VEHICLE_FAULT",
    end: "SHUTDOWN",
    end_twice: "SHUTDOWN",
}


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("happen", STOPS, ids=lambda happen: happen.__name__)
def test_no_command_differs_after_a_stop(tmp_path: Path, profile: str, happen: Callable[[RecordedDrive], None]) -> None:
    drive = RecordedDrive(profile).run_s(2.0)
    happen(drive)
    drive.run_s(1.2)
    assert STOPS[happen] in drive.reasons
    report = rerun(drive.save(tmp_path / "drive"))
    assert (report.count, report.gap) == (0, ""), report.text
    assert report.frames > 150


@pytest.mark.parametrize("profile", PROFILES)
def test_no_command_differs_in_a_drive_with_a_scheduled_end(tmp_path: Path, profile: str) -> None:
    drive = RecordedDrive(profile, scheduled_s=3.0).run_s(20.0)
    assert drive.loop.shutdown.is_done
    assert drive.reasons == ["SHUTDOWN"]
    assert rerun(drive.save(tmp_path / "drive")).count == 0


def test_no_command_differs_with_trajectories_from_outside(tmp_path: Path) -> None:
    drive, noise = RecordedDrive(route=None), np.random.default_rng(1)
    for k in range(30):
        path = straight(length_m=12.0, speed_mps=3.0)
        path = replace(path, y_m=noise.normal(0.0, 0.001, len(path)), stamp_ns=drive.clock.peek_ns())
        drive.mailbox.put(path if k != 20 else replace(path, stamp_ns=path.stamp_ns + 30_000_000_000))
        drive.run_s(0.1)
    drive.run_s(6.0)
    assert drive.loop.summary().counts["trajectories_rejected"] == 1
    assert "PAST_END_TIME" in drive.reasons
    report = rerun(drive.save(tmp_path / "drive"))
    assert (report.count, report.gap) == (0, ""), report.text


def test_no_command_differs_with_a_controller_of_ones_own_that_raises(tmp_path: Path) -> None:
    file = tmp_path / "fragile.py"
    file.write_text(FRAGILE)
    drive = RecordedDrive(controller=f"{file}:Fragile").run_s(5.0)
    assert "CONTROLLER_ERROR" in drive.reasons
    folder = drive.save(tmp_path / "drive", input_files=(str(file),))
    file.unlink()  # the recording has its own copy
    assert rerun(folder).count == 0


def test_no_command_differs_when_everything_happens_at_random(tmp_path: Path) -> None:
    chance, drive = random.Random(3), RecordedDrive()
    for _ in range(12):
        drive.run_s(chance.uniform(0.3, 1.5))
        recover(drive)
        chance.choice([brake, mute, doubt, cut, half, full, stall])(drive)
    drive.loop.shutdown.request()
    drive.run_s(15.0)
    report = rerun(drive.save(tmp_path / "drive", with_log=True))
    assert (report.count, report.gap) == (0, ""), report.text
    assert report.log_frames == len(drive.bus.log)

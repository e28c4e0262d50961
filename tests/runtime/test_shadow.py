"""What a loop in shadow would have sent, beside what another commander sends for the same samples."""

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import UNSET

from tests.harness import Drive, pure_pursuit, reference, straight
from tests.inbox_bus import InboxBus
from tests.narrowing import at_present
from vehicle_iface import Reason, VehicleState, compose
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.command import SafeCommand
from vehicle_iface.command_forms import CommandReader
from vehicle_iface.frame import CanFrame
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.runtime.shadow import DifferenceStats, OwnCommand, Shadow
from vehicle_iface.runtime.summary import table
from vehicle_iface.state_assembler import Sample
from vehicle_iface.status import Gear, VehicleMode, VehicleStatus
from vehicle_iface.telemetry.details import ShadowSummary, Spread
from vehicle_iface.trajectories import RecedingRoute, make_route
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import NS_PER_MS, ns_from_s

PERIOD_NS = 10 * NS_PER_MS
BEGIN_NS = 1_000 * PERIOD_NS
FAR_APART = 100


class Tap(InboxBus):
    """A bus on which a second loop receives what goes over the first one's line, and from which nothing leaves."""

    description = "tap"

    def __init__(self, drive: Drive) -> None:
        super().__init__()
        self._clock = drive.clock
        drain, send = drive.line.drain, drive.line.send

        def tapped_drain() -> list[CanFrame]:
            frames = drain()
            self.inbox += frames
            return frames

        def tapped_send(*frames: CanFrame) -> int:
            sent = send(*frames)
            self.inbox += [frame._replace(stamp_ns=self._clock.t_ns) for frame in frames[:sent]]
            return sent

        drive.line.drain, drive.line.send = tapped_drain, tapped_send  # type: ignore[method-assign]

    def wait(self, until_ns: int) -> bool:
        return bool(self.inbox) or until_ns < 0

    def send(self, *frames: CanFrame) -> int:
        raise AssertionError(f"a shadow sends {frames}")


def beside(drive: Drive, source: TrajectorySource) -> Loop:
    """A loop in shadow on the line of an armed one, and with the same clock."""
    tap = Tap(drive)
    return compose.build_loop(
        database=reference(),
        open_bus=lambda: tap,
        controller=pure_pursuit(),
        source=source,
        telemetry=None,
        armed=False,
        now_ns=drive.clock.now_ns,
        sleep_until=drive.clock.sleep_until,
    )


def both_run_s(drive: Drive, shadow: Loop, seconds: float) -> ShadowSummary:
    """What the shadow has found after so long."""
    end_ns = drive.clock.t_ns + ns_from_s(seconds)
    while drive.clock.t_ns < end_ns:
        drive.step()
        shadow.step()
    found = shadow.summary().shadow
    assert found is not UNSET
    return found


def route(name: str) -> RecedingRoute:
    return RecedingRoute(make_route(name))


@pytest.mark.parametrize(
    "source",
    [lambda: route("figure8"), lambda: route("stop_and_go"), lambda: FixedTrajectory(straight(time_s=60.0))],
    ids=["figure8", "stop_and_go", "file"],
)
def test_the_same_route_is_commanded_the_same_way_from_the_first_command_on(
    source: Callable[[], TrajectorySource],
) -> None:
    drive = Drive(source())
    found = both_run_s(drive, beside(drive, source()), 15.0)
    assert found.takeovers == 1
    assert found.compared > 1400
    assert found.unmatched_commands == 0
    assert found.accel_mps2.max == found.front_wheel_angle_rad.max == 0.0
    released = sum(pair["ENABLE"] == 0.0 for pair in drive.pairs())
    assert found.mismatches == {"enable": released, "safe_stop": 0, "reason": released}


def test_another_route_is_not_commanded_the_same_way() -> None:
    drive = Drive(route("figure8"))
    found = both_run_s(drive, beside(drive, route("circle")), 15.0)
    assert found.accel_mps2.p50 > 0.5
    assert found.front_wheel_angle_rad.p50 > 0.05
    assert found.mismatches["reason"] > FAR_APART


def test_a_shadow_is_taken_along_when_the_other_one_drives_on_after_a_driver() -> None:
    drive = Drive(route("figure8"))
    shadow = beside(drive, route("figure8"))
    both_run_s(drive, shadow, 8.0)
    for line in ("brake 1", "brake 0", "ready"):
        drive.send_line(line)
        both_run_s(drive, shadow, 0.5)
    drive.loop.arming.request()
    found = both_run_s(drive, shadow, 8.0)
    assert found.takeovers == 2
    assert found.accel_mps2.p95 < 0.02
    assert found.front_wheel_angle_rad.p95 < 0.002


def test_a_shadow_that_comes_later_agrees_within_a_second() -> None:
    drive = Drive(route("figure8")).engage(speed_mps=3.0)
    shadow = beside(drive, route("figure8"))
    before = both_run_s(drive, shadow, 1.0)
    after = both_run_s(drive, shadow, 10.0)
    assert before.takeovers == after.takeovers == 1
    assert after.accel_mps2.p95 < 0.05
    assert after.front_wheel_angle_rad.p95 < 0.005


def test_another_commander_is_no_fault_of_a_shadow() -> None:
    drive = Drive(route("circle"))
    shadow = beside(drive, route("circle"))
    both_run_s(drive, shadow, 3.0)
    summary = shadow.summary()
    assert summary.controller_state == "SHADOW"
    assert summary.latched_fault is None
    assert summary.counts["foreign_commands"] > FAR_APART
    assert summary.counts["frames_sent"] == 0
    assert shadow.details().shadow == summary.shadow
    assert "other commander" in table(summary)
    assert "m/s²" in table(summary)


def test_without_another_commander_nothing_is_compared_and_an_armed_loop_has_no_shadow() -> None:
    alone = Drive(route("circle"), armed=False)
    alone.run_s(2.0)
    shadow = alone.loop.summary().shadow
    assert shadow is not UNSET
    assert shadow.compared == 0
    assert "other commander" not in table(alone.loop.summary())
    armed = Drive(route("circle"))
    armed.run_s(2.0)
    assert armed.loop.summary().shadow is UNSET


# The comparison by itself


OURS = SafeCommand(
    stamp_ns=0,
    enable=True,
    safe_stop=False,
    accel_mps2=1.0,
    front_wheel_angle_rad=0.1,
    rear_wheel_angle_rad=0.0,
    speed_mps=5.0,
    reason=Reason.NOMINAL,
    gear_request=Gear.NO_REQUEST,
)


class Other:
    """A shadow, and the frames of another commander for it."""

    def __init__(self) -> None:
        self.shadow = Shadow(
            reference().commands,
            CommandReader(reference().profile),
            together_ns=5 * NS_PER_MS,
            longest_ns=50 * NS_PER_MS,
        )
        self.encoder = Encoder(reference().sent)
        self.now_ns = BEGIN_NS

    def sample(self, safe: SafeCommand = OURS) -> None:
        """The next sample, and what we would send for it."""
        self.now_ns += PERIOD_NS
        state = VehicleState(
            stamp_ns=self.now_ns, frame_id="map", x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=float(self.now_ns)
        )
        self.shadow.record(Sample(state, True, True, 0, self.now_ns, False), safe, self.now_ns)

    def frames(self, **changes: Any) -> list[CanFrame]:
        """The other one's command, 1 ms after the sample."""
        stamp_ns = self.now_ns + NS_PER_MS
        command = dataclasses.replace(OURS, **changes)
        frames = self.encoder.encode_command(command)
        self.encoder.commit(frames)
        return [frame._replace(stamp_ns=stamp_ns) for frame in frames]

    def commands(self, **changes: Any) -> OwnCommand | None:
        """The other one's command, received and compared."""
        for frame in self.frames(**changes):
            self.shadow.on_foreign_frame(frame)
        return self.shadow.compare()


@pytest.fixture
def other() -> Other:
    """One that has taken the vehicle over with a first sample."""
    made = Other()
    made.sample()
    assert made.commands() is not None
    return made


def test_a_takeover_returns_the_sample_where_our_history_begins_and_compares_nothing(other: Other) -> None:
    assert other.shadow.takeovers == 1
    assert other.shadow.compared == 0
    other.sample()
    assert other.commands() is None
    assert other.shadow.compared == 1
    other.now_ns += ns_from_s(0.2)
    other.sample()
    taken = other.commands()
    assert taken is not None
    assert taken.state.stamp_ns == taken.completed_ns == other.now_ns


def test_differences_are_counted_while_both_are_enabled(other: Other) -> None:
    other.sample()
    other.commands(accel_mps2=0.5, front_wheel_angle_rad=-0.1)
    other.sample()
    other.commands(enable=False, accel_mps2=0.0, reason=Reason.DRIVER_OVERRIDE)
    found = other.shadow.summary()
    assert found.accel_mps2 == Spread(mean=0.5, p50=0.5, p95=0.5, max=0.5)
    assert found.front_wheel_angle_rad.max == pytest.approx(0.2)
    assert found.mismatches == {"enable": 1, "safe_stop": 0, "reason": 1}
    assert found.compared == 2


def test_a_stop_where_we_would_have_driven_is_reported(other: Other) -> None:
    other.sample()
    other.commands(safe_stop=True, reason=Reason.DEVIATION)
    assert other.shadow.mismatches == {"enable": 0, "safe_stop": 1, "reason": 1}


def test_a_command_without_a_sample_of_its_own_is_not_compared(other: Other) -> None:
    other.sample()
    other.commands()
    other.commands()
    assert (other.shadow.compared, other.shadow.unmatched_commands) == (1, 1)
    other.now_ns += 60 * NS_PER_MS
    other.commands(safe_stop=True, reason=Reason.STATE_STALE)
    assert (other.shadow.compared, other.shadow.unmatched_commands) == (1, 2)
    other.sample()
    assert other.commands() is None  # it has gone on commanding meanwhile
    assert other.shadow.compared == 2


def test_a_command_of_which_a_part_is_lost_or_damaged_is_no_command(other: Other) -> None:
    other.sample()
    other.shadow.on_foreign_frame(other.frames()[0])
    other.sample()
    first, second = other.frames()
    other.shadow.on_foreign_frame(first)
    other.shadow.on_foreign_frame(second._replace(data=bytes((second.data[0] ^ 1,)) + second.data[1:]))
    assert other.shadow.compare() is None
    assert other.shadow.compared == 0
    assert other.shadow.summary().drops == {"bad CRC STEER_COMMAND": 1}
    other.sample()
    other.shadow.on_foreign_frame(other.frames()[1])
    other.sample(dataclasses.replace(OURS, front_wheel_angle_rad=0.2))
    other.commands(front_wheel_angle_rad=0.2)
    assert other.shadow.compared == 1
    assert other.shadow.front_wheel_angle_rad.summary().max == 0.0


def test_frames_that_are_no_commands_are_not_taken_for_any(other: Other) -> None:
    other.sample()
    for frame in other.frames():
        other.shadow.on_foreign_frame(frame._replace(is_extended=True))
        other.shadow.on_foreign_frame(frame._replace(can_id=0x180))
    assert other.shadow.compare() is None
    assert other.shadow.summary().drops == {}


def test_the_limits_of_engaging_hold_until_the_vehicle_is_autonomous(other: Other) -> None:
    assert at_present(other.shadow.is_taking_over)
    assert not other.shadow.on_status(VehicleStatus(stamp_ns=0, mode=VehicleMode.READY, gear=None))
    other.sample()
    other.commands()
    assert at_present(other.shadow.is_taking_over)
    assert other.shadow.on_status(VehicleStatus(stamp_ns=0, mode=VehicleMode.AUTONOMOUS, gear=None))
    assert not other.shadow.is_taking_over
    assert not other.shadow.on_status(VehicleStatus(stamp_ns=0, mode=VehicleMode.AUTONOMOUS, gear=None))


def test_a_commander_that_releases_takes_nothing_over(other: Other) -> None:
    other.sample()
    other.commands(enable=False, reason=Reason.NOT_ENGAGED)
    assert not other.shadow.is_taking_over


def test_after_a_lost_link_nothing_from_before_is_compared(other: Other) -> None:
    other.sample()
    first, second = other.frames()
    other.shadow.on_foreign_frame(first)
    other.shadow.reset()
    other.shadow.on_foreign_frame(second)
    assert other.shadow.compare() is None
    assert other.shadow.compared == 0
    assert not other.shadow.is_taking_over


@given(st.lists(st.floats(-20.0, 20.0), min_size=1, max_size=300))
def test_quantiles_are_those_of_the_sizes_within_a_bin(values: list[float]) -> None:
    differences = DifferenceStats()
    for value in values:
        differences.add(value)
    sizes = sorted(abs(value) for value in values)
    found = differences.summary()
    assert found.max == sizes[-1]
    assert found.mean == pytest.approx(sum(sizes) / len(sizes))
    for quantile, share in ((found.p50, 50), (found.p95, 95)):
        exact = sizes[-(-share * len(sizes) // 100) - 1]
        assert min(exact, 16.0) <= quantile * (1 + 1e-12)
        assert quantile <= max(exact * 1.05, 1e-6) or exact > 16.0
    assert found.p50 <= found.p95 <= found.max


def test_nothing_compared_is_no_difference() -> None:
    assert DifferenceStats().summary() == Spread(mean=0.0, p50=0.0, p95=0.0, max=0.0)

"""Which words of `when` hold: engagement and the vehicle's status decide."""

import pytest

from vehicle_iface.command import Phases
from vehicle_iface.safety.engagement import Engagement, EngagementTiming
from vehicle_iface.safety.modes import Mode
from vehicle_iface.safety.phases import find_phases
from vehicle_iface.status import VehicleMode, VehicleStatus

MS = 1_000_000
NOW_NS = 1000 * MS
TIMING = EngagementTiming(
    settle_ns=500 * MS,
    stale_ns=50 * MS,
    lost_ns=500 * MS,
    status_stale_ns=100 * MS,
    engage_timeout_ns=3000 * MS,
    end_ns=10_000 * MS,
    steer_torque_nm=3.0,
)
EXPECTED = {
    Mode.SHADOW: "",
    Mode.OBSERVING: "",
    Mode.STARTING: "armed always",
    Mode.STANDBY: "armed always",
    Mode.ENGAGING: "armed engaging enabled always",
    Mode.ENGAGED: "armed enabled always",
    Mode.HALTING: "armed enabled always",
    Mode.HALTED: "armed enabled always",
    Mode.OVERRIDDEN: "released always",
    Mode.FAULT: "released always",
    Mode.SILENT: "",
    Mode.ENDING: "armed enabled always",
    Mode.RELEASED: "released always",
}


def status(
    mode: VehicleMode = VehicleMode.READY,
    *,
    age_ms: int = 0,
    brake: bool = False,
    throttle: bool = False,
    steers: bool = False,
    torque_nm: float = 0.0,
) -> VehicleStatus:
    return VehicleStatus(
        stamp_ns=NOW_NS - age_ms * MS,
        mode=mode,
        gear=None,
        fault_code=0,
        driver_brake=brake,
        driver_throttle=throttle,
        driver_steers=steers,
        driver_steer_torque_nm=torque_nm,
    )


def phases(mode: Mode, reported: VehicleStatus | None) -> Phases:
    engagement = Engagement(TIMING, armed=mode is not Mode.SHADOW)
    engagement.mode = mode
    return find_phases(engagement, reported, NOW_NS, status_stale_ns=100 * MS)


@pytest.mark.parametrize("mode", Mode)
def test_each_mode_has_its_phases(mode: Mode) -> None:
    found = phases(mode, status())
    assert {name for name in Phases._fields if getattr(found, name)} == set(EXPECTED[mode].split())


@pytest.mark.parametrize("reported", [status(), status(VehicleMode.AUTONOMOUS), status(age_ms=100)])
def test_enabling_messages_may_be_sent_while_the_vehicle_is_ready_and_the_driver_inactive(
    reported: VehicleStatus,
) -> None:
    assert phases(Mode.ENGAGING, reported).engaging


@pytest.mark.parametrize(
    "reported",
    [
        None,
        status(age_ms=101),
        status(brake=True),
        status(throttle=True),
        status(steers=True),
        status(torque_nm=-3.0),
        status(VehicleMode.MANUAL),
        status(VehicleMode.FAULT),
        status(VehicleMode.EMERGENCY_STOP),
    ],
)
def test_enabling_messages_are_held_back_while_the_driver_acts_or_the_vehicle_is_not_fit(
    reported: VehicleStatus | None,
) -> None:
    found = phases(Mode.ENGAGING, reported)
    assert not found.engaging
    assert found.enabled

"""The phases of a case on the bus: preparation, injection, what comes after it, and clean-up."""

import time

from vehicle_bus_contract.reference import S

from hil_bench.case import Case, Then
from hil_bench.faults.base import inject_nothing
from hil_bench.judges.protocol import MOVING_MPS
from hil_bench.result import EventKind
from hil_bench.rig import Rig
from hil_bench.steps import Stretch, rearm, run_steps

ENGAGE_S = 25.0
HEALTHY_S = 0.8
SLOWEST_START_S = 3.0
UNARMED_S = 0.7
"""Time in READY before the operator arms again; a device that is still armed would engage."""
SETTLE_S = 1.5
"""A device that is already running receives the vehicle for this long before it is armed."""
END_S = 16.0


def run_phases(rig: Rig, case: Case, *, is_recorded: bool) -> list[Stretch]:
    """Preparation, injection, and what comes after it; returns when each step of the case was carried out."""
    stretches: list[Stretch] = []
    for attribute, value in case.setup.items():
        setattr(rig.vehicle.plant, attribute, value)
    if case.link_is_down:
        rig.set_link(up=False)
    rig.begin()
    rig.note(EventKind.PREPARATION, "the vehicle sends state, the device is started")
    rig.device.start(armed=case.armed, recorded=is_recorded, open_files=case.open_files)
    if not rig.device.is_started:
        rig.run_for(SETTLE_S)
        rig.rearm()
    if case.at_mps < 0.0:
        stretches = _inject(rig, case)
    elif rig.wait_for(lambda: rig.is_engaged or rig.device.poll() is not None, ENGAGE_S, "the device to engage"):
        rig.engaged_ns = rig.now_ns
        rig.note(EventKind.PREPARATION, "engaged", rig.engaged_ns)
        if case.at_mps > 0.0 and case.inject is not None:
            rig.wait_for(
                lambda: abs(rig.vehicle.plant.speed_mps) >= case.at_mps, case.reach_s, f"{case.at_mps:.3g} m/s"
            )
        stretches = _inject(rig, case)
    else:
        rig.is_not_engaged_in_time = True
    _after_injection(rig, case)
    return stretches


def _inject(rig: Rig, case: Case) -> list[Stretch]:
    if case.steps:
        rig.mark_output()
        stretches = run_steps(rig, case.steps, at_mps=max(0.0, case.at_mps))
        rig.inject_ns = rig.touched_ns
        return stretches
    if case.inject is None and case.at_mps >= 0.0:
        return []
    rig.mark_injection()
    rig.touched_ns = rig.inject_ns
    rig.mark_output()
    with (case.inject or inject_nothing)(rig):
        rig.run_for(case.for_s)
        if case.samples:
            count = len(rig.vehicle.history) + case.samples
            longest_s = 2.0 * case.samples * rig.wire.period_s
            rig.wait_for(lambda: len(rig.vehicle.history) >= count, longest_s, "the samples")
        rig.end_ns = rig.now_ns
    rig.end_ns = max(rig.end_ns, rig.now_ns)
    return []


def _after_injection(rig: Rig, case: Case) -> None:
    if case.then is Then.END_OF_ROUTE:
        longest_s = 180.0
        planned_ns = rig.begin_ns + round(case.route().time_s[-1] * S)

        def is_stuck() -> bool:
            """A vehicle that is early waits at a turning point; it is stuck if it waits when the route is over."""
            return rig.is_stuck and rig.now_ns > planned_ns

        rig.wait_for(
            lambda: rig.is_at_end or is_stuck() or rig.device.poll() is not None, longest_s, "the end of the route"
        )
        rig.run_for(0.6)
    elif case.then in (Then.GOES_ON, Then.GOES_ON_IF_MOVING, Then.MAY_GO_ON):
        rig.run_for(case.after_s)
        rig.wait_for(lambda: rig.is_engaged, 3.0, "the device to continue")
        _drive_on(rig)
    elif case.then is Then.ENDED:
        rig.wait_for(lambda: rig.device.poll() is not None, END_S, "the device to end")
        rig.run_for(case.after_s)
    else:
        rig.run_for(case.after_s)
    if case.then is Then.REARM:
        rig.note(EventKind.CLEAN_UP, "the vehicle is made ready, the device is not armed")
        rig.vehicle.make_ready()
        rig.run_for(UNARMED_S)
    rig.then_ns = rig.now_ns
    rig.mark_output()
    may_stay = case.then in (Then.GOES_ON_IF_MOVING, Then.MAY_GO_ON)
    if case.then is Then.REARM or (may_stay and not rig.is_engaged):
        rearm(rig)
        _drive_on(rig)
    rig.healthy_ns = rig.now_ns


def _drive_on(rig: Rig) -> None:
    """For as long as is judged, and until a vehicle that accelerates slowly is moving."""
    rig.run_for(HEALTHY_S)
    if rig.is_engaged:
        rig.wait_for(lambda: abs(rig.vehicle.plant.speed_mps) >= MOVING_MPS, SLOWEST_START_S, "the vehicle to move")


def clean_up(rig: Rig, case: Case) -> list[str]:
    """End the device; returns what had to be killed."""
    rig.then_ns = rig.then_ns or rig.now_ns
    if case.link_is_down:
        rig.set_link(up=True)
    try:
        if rig.device.poll() is None:
            rig.device.stop()
            rig.wait_for(lambda: rig.device.poll() is not None or not rig.device.is_started, END_S, "the device to end")
            rig.run_for(0.05)
        rig.exit_ns = rig.exit_ns or rig.now_ns
        rig.exit_status = rig.device.poll()
    finally:
        killed = rig.device.kill()
        rig.close()
        rig.closed_ns = time.monotonic_ns()
    return killed

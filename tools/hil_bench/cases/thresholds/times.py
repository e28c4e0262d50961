"""Times of the profile: state and status that are missing, silence, engagement, recovery."""

from dataclasses import dataclass, replace

from vehicle_bus_contract.reference import S

from hil_bench.case import Case, Need
from hil_bench.cases.thresholds.common import ANYTHING, JITTER_S, USUAL_MPS, Numbers, sequence_case, straight
from hil_bench.expect import NeverDrives, StaysOut
from hil_bench.expect.limit import Limit
from hil_bench.expect.stop_thresholds import SilentAfter, StopAfter, StopsUntilHeld
from hil_bench.expect.thresholds import AsksFor, DrivesAfter, OldestAnswered
from hil_bench.faults import base, frames, process, vehicle
from hil_bench.faults.base import Injection
from hil_bench.steps import Step
from hil_bench.wire import Wire

FASTER_MPS = 5.0
ENGAGES_S = 0.25
"""Between the first request and the first command that drives, the vehicle changes its mode."""
BLIP_S, PAUSE_S = 0.06, 1.0
AGES = (0.5, 1.3, 2.5)
"""Times the greatest age of a sample that is answered."""
AGED_S = 0.08
GAP_SHARE = 0.8
"""Of the time for which state must be fresh: from one gap to the next."""


def time_cases(wire: Wire) -> tuple[Case, ...]:
    """For one vehicle."""
    numbers = Numbers(wire)
    return (_missing(numbers), _command_age(numbers), _engaging(numbers), _recovery(numbers), _latch(numbers))


def _after(numbers: Numbers, key: str, name: str, place: str = "", more_s: float = 0.0) -> Limit:
    """A time of the profile at which the device acts by its next command."""
    at_s = numbers.or_else(key, 0.0)
    early_s = min(0.1 * at_s, 1.1 * numbers.period_s)
    late_s = numbers.late_s + more_s
    return Limit(key=key, name=name, unit="s", profile=at_s, lowest=at_s - early_s, highest=at_s + late_s, place=place)


def _missing(numbers: Numbers) -> Case:
    stale, silent, status = "timing.state_stale_s", "timing.state_silent_s", "timing.status_stale_s"
    mute, mute_status = frames.change_frames(frames.drop), frames.change_frames(frames.drop, of_status=True)
    stale_s, silent_s = numbers.or_else(stale, 0.05), numbers.or_else(silent, 0.5)
    inferred_s = numbers.inferred_s

    def at(speed_mps: float) -> str:
        return f"at {numbers.true_mps(speed_mps, FASTER_MPS + 1.0):.3g} m/s"

    steps = [
        Step(
            name=f"no sample at {speed_mps:g} m/s",
            inject=mute,
            for_s=stale_s + inferred_s + 5.0 * numbers.period_s,
            after_s=0.1,
            at_mps=speed_mps,
            measure=(StopAfter(limit=_after(numbers, stale, "state missing", at(speed_mps), inferred_s)),),
        )
        for speed_mps in (USUAL_MPS, FASTER_MPS)
    ]
    if numbers.wire.status and numbers.find(status) is not None:
        limit = _after(numbers, status, "status missing", at(USUAL_MPS), inferred_s)
        steps.append(
            Step(
                name="no status",
                inject=mute_status,
                for_s=numbers[status] + inferred_s + 0.2 + 3.0 * numbers.period_s,
                at_mps=USUAL_MPS,
                measure=(StopAfter(limit=limit, messages=numbers.wire.status),),
            )
        )
    steps.append(
        Step(
            name="no sample for long",
            inject=mute,
            for_s=silent_s + 0.4,
            after_s=0.5,
            at_mps=USUAL_MPS,
            see=(StaysOut(),),
            measure=(SilentAfter(limit=_after(numbers, silent, "silence without state", "a stop before")),),
            is_left_alone=True,
        )
    )
    return sequence_case(
        name="threshold-missing-state",
        fault="S1",
        tags=("thresholds", "state", "timing", "quick"),
        proves="Missing state and status stop the vehicle when the profile says so, and silence follows in its time.",
        injected="samples and status are left out, until the device stops and until it falls silent",
        route=straight(speed_mps=FASTER_MPS + 1.0),
        steps=steps,
        lacks=numbers.lacks(stale, silent),
    )


def _command_age(numbers: Numbers) -> Case:
    key = "timing.max_command_age_s"
    stated_s = numbers.or_else(key, 0.1)
    steps = [
        Step(
            name=f"the newest sample is {share:g} times as old",
            inject=base.combine(vehicle.change_vehicle(has_watchdog=False), process.pause_and_mute(share * stated_s)),
            for_s=AGED_S,
            after_s=numbers.begins_s,
            measure=(
                OldestAnswered(
                    limit=Limit(
                        key=key,
                        name="age of a sample that a driving command answers",
                        unit="s",
                        profile=stated_s,
                        highest=stated_s + JITTER_S,
                        place=f"after {share * stated_s:.3g} s",
                    ),
                    begins_s=numbers.begins_s,
                    falls=numbers.least_fall,
                ),
            ),
            is_left_alone=True,
        )
        for share in AGES
    ]
    return replace(
        sequence_case(
            name="threshold-command-age",
            fault="P5",
            tags=("thresholds", "process", "timing"),
            proves="No sample is answered by a command that drives when it is older than the profile says.",
            injected="the device is paused, then samples are left out, and the device goes on before the next sample",
            route=straight(),
            steps=steps,
            lacks=numbers.lacks(key),
        ),
        needs=(Need.REARM, Need.OWN_PROCESS),
    )


def _engaging(numbers: Numbers) -> Case:
    settle, timeout = "timing.engage_settle_s", "timing.engage_timeout_s"
    settle_s, timeout_s = numbers.or_else(settle, 0.5), numbers.or_else(timeout, 3.0)
    slow_s = numbers.or_else("timing.status_period_s", 0.02) + numbers.wire.enable_period_s
    wide_s = 2.0 * numbers.late_s + slow_s
    return sequence_case(
        name="threshold-engaging",
        fault="V2 X7",
        tags=("thresholds", "engagement", "timing", "quick"),
        proves="Engagement is requested after the profile's time of fresh state, and for its time.",
        injected="state that begins while the device is armed; a vehicle that does not engage",
        route=straight(),
        at_mps=0.0,
        steps=(
            Step(
                name="state begins",
                inject=frames.change_frames(frames.drop),
                for_s=0.9,
                after_s=settle_s + 0.8 + wide_s,
                is_from_start=True,
                measure=(
                    DrivesAfter(
                        limit=Limit(
                            key=settle,
                            name="fresh state before engaging",
                            unit="s",
                            profile=settle_s,
                            lowest=settle_s - numbers.late_s,
                            highest=settle_s + wide_s + ENGAGES_S,
                        )
                    ),
                ),
                is_left_alone=True,
            ),
            Step(
                name="the vehicle does not engage",
                inject=vehicle.change_vehicle(can_engage=False),
                for_s=settle_s + timeout_s + 1.5,
                is_from_start=True,
                measure=(
                    AsksFor(
                        limit=Limit(
                            key=timeout,
                            name="request to engage ends",
                            unit="s",
                            profile=timeout_s,
                            lowest=timeout_s - wide_s,
                            highest=timeout_s + wide_s,
                        )
                    ),
                ),
            ),
            Step(
                name="samples with gaps",
                inject=_gaps(GAP_SHARE * settle_s, 2.0 * numbers.or_else("timing.state_stale_s", 0.05)),
                for_s=4.0 * settle_s + wide_s,
                is_from_start=True,
                see=(NeverDrives(),),
            ),
        ),
        lacks=numbers.lacks(settle, timeout),
        allow=ANYTHING - {"dynamics", "command"},
    )


def _recovery(numbers: Numbers) -> Case:
    causes: list[tuple[str, str, Injection]] = []
    if not numbers.wire.loses_its_place:
        causes.append(("recovery.state_stale_s", "state is back", frames.change_frames(frames.drop)))
    if numbers.wire.has("POSE_VALID"):
        causes.append(("recovery.state_invalid_s", "pose is valid again", vehicle.change_vehicle(pose_valid=False)))
    if numbers.wire.has("POSE_FRAME"):
        causes.append(
            ("recovery.frame_mismatch_s", "frame of reference fits again", vehicle.change_vehicle(pose_frame="ODOM"))
        )
    stated = [cause for cause in causes if numbers.find(cause[0]) is not None]
    steps = [
        Step(
            name=name,
            inject=inject,
            for_s=numbers.or_else("timing.state_stale_s", 0.05) + numbers.inferred_s + 3.0 * numbers.period_s,
            after_s=numbers[key] + 0.5,
            at_mps=USUAL_MPS,
            measure=(DrivesAfter(limit=_after(numbers, key, f"drives on, {name}")),),
            is_left_alone=True,
        )
        for key, name, inject in stated
    ]
    return sequence_case(
        name="threshold-recovery",
        fault="S8",
        tags=("thresholds", "state", "timing"),
        proves="A stop lasts until its cause has been gone for the profile's time.",
        injected="missing samples, an invalid pose, another frame of reference, each for a moment",
        route=straight(),
        steps=steps,
        lacks="" if steps else "the profile has no [recovery] for a cause that its bus can show",
    )


@dataclass(frozen=True)
class Recurring:
    """Stops that recur until the device holds the vehicle."""

    stops: float
    every_s: float
    lacks: str
    """Why this vehicle has none."""

    @property
    def inject(self) -> Injection:
        """The pose is invalid at the beginning of each period."""
        return base.repeat(self.every_s, BLIP_S, pose_valid=False)


def find_recurring(numbers: Numbers) -> Recurring:
    """As the profile's `[recovery]` has them."""
    stops, window_s = numbers.or_else("recovery.latch_stops", 4.0), numbers.or_else("recovery.latch_window_s", 0.0)
    every_s = numbers.or_else("recovery.state_invalid_s", 0.5) + PAUSE_S
    lacks = numbers.lacks("recovery.latch_stops", "recovery.latch_window_s")
    if not numbers.wire.has("POSE_VALID"):
        lacks = lacks or "the vehicle has no signal by which its pose is valid"
    lasts_too_long = "" if every_s * stops < window_s else "its stops last too long to recur so often"
    return Recurring(stops=stops, every_s=every_s, lacks=lacks or lasts_too_long)


def _latch(numbers: Numbers) -> Case:
    recurring = find_recurring(numbers)
    stops, every_s = recurring.stops, recurring.every_s
    limit = Limit(
        key="recovery.latch_stops",
        name="stops until the vehicle is held",
        unit="",
        profile=stops,
        lowest=stops,
        highest=stops,
        place=f"one each {every_s:g} s",
    )
    return sequence_case(
        name="threshold-latch",
        fault="S8",
        tags=("thresholds", "state"),
        proves="After as many stops as the profile says, the vehicle is held until the device is armed again.",
        injected=f"the pose is invalid for a moment each {every_s:g} s",
        route=straight(),
        steps=(
            Step(
                name="stops that recur",
                inject=recurring.inject,
                for_s=every_s * (stops + 1.5),
                measure=(StopsUntilHeld(limit=limit),),
                is_left_alone=True,
            ),
        ),
        lacks=recurring.lacks,
    )


def _gaps(every_s: float, lasts_s: float) -> Injection:
    """No sample at the beginning of each `every_s`."""
    return frames.change_frames(lambda rig, tx: [] if rig.now_ns / S % every_s < lasts_s else [tx.frame])

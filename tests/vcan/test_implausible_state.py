"""A vehicle whose frames are intact and whose values are not: they jump, stand still, or lead off the path."""

import signal
from collections.abc import Callable, Iterator

import pytest
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import CONTROLLER_SENDS, FAULT, MS, SAMPLE

from .conftest import Programs
from .driving import driven, line_file, own_faults, summary, wait_until_driven
from .observer import Observer, decided, reasons
from .peer import ALWAYS, Vehicle

JUMP_M, FAR_M = 5.0, 50.0
SLIDE_MPS, WHEEL_RAD, PUSH_MPS2 = 3.0, 0.5, 15.0
"""What ice, a steering that turns by itself, and a steep hill do: no more than can be true of a vehicle."""
LONG_ENOUGH = 150
"""Samples, until whatever strays is far off."""
STOP_WITHIN_NS = 150 * MS
SLACK_NS = 60 * MS
AHEAD_M = 300.0


class Doubtful(Vehicle):
    """Says something else than what is."""

    def __init__(self, x_m: float = 0.0) -> None:
        super().__init__(x_m)
        self.jumps = 0
        """So many of its next samples are elsewhere along the path."""
        self.is_frozen = False
        self.is_halved = False
        """Every other sample is not sent."""
        self._held: dict[str, dict[str, float]] = {}

    def count_like(self, other: Vehicle, *, ahead: int) -> None:
        """Have its frames follow the other one's as if some had been lost between them."""
        self._counters.update(dict.fromkeys(self._counters, ahead))
        self._counters.update(other._counters)

    def _send_message(self, name: str, counter: int, **signals: float) -> None:
        if self.is_halved and name in SAMPLE and counter % 2:
            return
        if self.is_frozen and name in SAMPLE:
            signals = self._held.setdefault(name, signals)
        if self.jumps > 0 and name == "POSE":
            self.jumps -= 1
            signals["POS_X"] += JUMP_M
        super()._send_message(name, counter, **signals)


@pytest.fixture
def doubtful(bus: Observer) -> Iterator[Doubtful]:
    """At the origin, READY, sending."""
    vehicle = Doubtful()
    vehicle.start()
    bus.wait_for("the vehicle's first sample", "CHASSIS")
    yield vehicle
    vehicle.close()


def jumped_ns(record: Record) -> int:
    """When the first sample came that was elsewhere."""
    places = zip(record.samples, record.samples[1:], strict=False)
    return next(after.stamp_ns for before, after in places if after.x_m - before.x_m > JUMP_M / 2.0)


def frozen_ns(record: Record) -> int:
    """When the last sample came whose place was another one than before."""
    places = zip(record.samples, record.samples[1:], strict=False)
    return [after.stamp_ns for before, after in places if after.x_m != before.x_m][-1]


@pytest.mark.parametrize("jumps", [1, 2])
def test_a_position_that_jumps_and_returns_is_dropped_and_driving_continues(
    programs: Programs, bus: Observer, doubtful: Doubtful, jumps: int
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    doubtful.jumps = jumps
    record = bus.record(moving, bus.wait_samples(50))
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert jumped_ns(record)
    assert decided(record) == ["NOMINAL"]
    assert not [fault for fault in own_faults(record) if fault not in record.unanswered]
    assert summary(programs)["implausible"]["jumped"] == jumps


def test_a_permanent_position_jump_stops_then_silences_until_armed_at_the_new_position(
    programs: Programs, bus: Observer, doubtful: Doubtful
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(30, since=moving)
    doubtful.jumps = ALWAYS
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=moving)
    record = bus.record(moving, fault)
    assert reasons(record.pairs) == ["NOMINAL", "STATE_INVALID"]
    stops = [pair for pair in record.pairs if pair.reason == "STATE_INVALID"]
    assert stops[0].stamp_ns - jumped_ns(record) <= STOP_WITHIN_NS + SLACK_NS
    assert all(pair.is_enabled and pair.is_stop for pair in stops)
    latched = bus.wait_samples(150, since=fault)
    assert bus.sent_by_controller(fault, latched) == []
    doubtful.make_ready()
    loop.send_signal(signal.SIGUSR1)
    driving = wait_until_driven(bus, since=latched)
    assert not bus.record(driving, bus.wait_samples(30, since=driving)).faults()


def test_frozen_values_with_running_counters_stop_a_moving_vehicle(
    programs: Programs, bus: Observer, doubtful: Doubtful
) -> None:
    loop, moving = driven(programs, bus)
    frozen = bus.wait_samples(30, since=moving)
    doubtful.is_frozen = True
    fault, _ = bus.wait_for("the vehicle's watchdog", "VEHICLE_STATUS", MODE=FAULT, since=frozen)
    record = bus.record(moving, fault)
    assert reasons(record.pairs) == ["NOMINAL", "STATE_INVALID"]
    stop = next(pair for pair in record.pairs if pair.is_stop)
    assert stop.stamp_ns - frozen_ns(record) <= STOP_WITHIN_NS + SLACK_NS
    assert not record.counter_gaps
    assert bus.sent_by_controller(fault, bus.wait_samples(30, since=fault)) == []
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 4
    assert summary(programs)["implausible"]["frozen"] >= 3


def test_a_vehicle_that_sends_at_half_its_rate_is_driven_and_missing_samples_are_counted(
    programs: Programs, bus: Observer, doubtful: Doubtful
) -> None:
    loop, moving = driven(programs, bus)
    doubtful.is_halved = True
    record = bus.record(moving, bus.wait_samples(50, since=moving))
    assert decided(record) == ["NOMINAL"]
    assert not own_faults(record)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(programs)
    assert min(found["lost"][name] for name in SAMPLE) >= 40
    assert found["drops"] == {}


@pytest.mark.parametrize("status_frames_lost", [0, ALWAYS], ids=["by its status", "by its place"])
def test_a_second_vehicle_on_the_bus_is_not_mistaken_for_the_first_and_the_drive_ends(
    programs: Programs, bus: Observer, vehicle: Vehicle, status_frames_lost: int
) -> None:
    _, moving = driven(programs, bus)
    second = Doubtful(x_m=FAR_M)
    second.faults.muted["VEHICLE_STATUS"] = status_frames_lost
    second.count_like(vehicle, ahead=2)
    second.start()
    _, seen = bus.wait_until("the second vehicle", lambda decoded: decoded.name == "POSE" and decoded["POS_X"] >= FAR_M)
    record = bus.record(moving, bus.wait_samples(100))
    second.close()
    late = [pair for pair in record.pairs if pair.stamp_ns > seen.stamp_ns + STOP_WITHIN_NS + SLACK_NS]
    assert not [pair for pair in late if pair.is_enabled and not pair.is_stop]
    assert not [gap for gap in record.counter_gaps if gap.startswith(CONTROLLER_SENDS)]


def slips(vehicle: Vehicle) -> None:
    """On ice, to the left."""
    vehicle.slide_mps = SLIDE_MPS


def turns_away(vehicle: Vehicle) -> None:
    """Its steering turns by itself."""
    vehicle.steers_by_itself_rad = WHEEL_RAD


def rolls_back(vehicle: Vehicle) -> None:
    """Down a hill that the brakes do not hold it on."""
    vehicle.push_mps2 = -PUSH_MPS2 if vehicle.speed_mps > -2.0 else 0.0


def runs_away(vehicle: Vehicle) -> None:
    """Down a hill, faster than it may go."""
    vehicle.push_mps2 = PUSH_MPS2 if vehicle.speed_mps < 25.0 else 0.0


@pytest.mark.parametrize(
    ("strays", "finding"),
    [
        (slips, "off the path"),
        (turns_away, "heading away from the path"),
        (rolls_back, "rolling against the direction of travel"),
        (runs_away, "faster than the vehicle may go"),
    ],
)
def test_a_vehicle_that_leaves_its_path_or_its_heading_rolls_back_or_runs_away_is_stopped_and_stays_stopped(
    programs: Programs, bus: Observer, vehicle: Vehicle, strays: Callable[[Vehicle], None], finding: str
) -> None:
    loop, moving = driven(programs, bus)
    bus.wait_samples(10, since=moving)
    for _ in range(LONG_ENOUGH):
        strays(vehicle)
        bus.wait_samples(1)
        if "reason: DEVIATION" in loop.text:
            break
    end = bus.wait_samples(40)
    record = bus.record(moving, end)
    assert decided(record) == ["NOMINAL", "DEVIATION"]
    assert all(pair.is_enabled and pair.is_stop for pair in record.pairs if pair.reason == "DEVIATION")
    assert not own_faults(record)
    vehicle.driver_brake = True
    bus.wait_for("letting go", "DRIVE_COMMAND", ENABLE=0, REASON="DRIVER_OVERRIDE", since=end)
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    found = summary(programs)
    assert found["deviations"][finding] >= 1
    assert not any(found["implausible"].values())


def test_a_vehicle_whose_path_begins_300_m_ahead_is_held_where_it_stands(
    programs: Programs, bus: Observer, vehicle: Vehicle
) -> None:
    loop = programs.run("--arm", "--trajectory", line_file(programs.folder, first_m=AHEAD_M))
    loop.wait_for_line(rf"deviation at point 0: off the path: distance_m = {AHEAD_M:.0f}, limit 3")
    index, _ = bus.wait_for("the vehicle is held", "DRIVE_COMMAND", REASON="DEVIATION", ENABLE=1, SAFE_STOP=1)
    record = bus.record(index, bus.wait_samples(150, since=index))
    assert decided(record) == ["DEVIATION"]
    assert all(pair.is_enabled and pair.is_stop for pair in record.pairs)
    assert not own_faults(record)
    assert vehicle.x_m == 0.0
    loop.send_signal(signal.SIGTERM)
    assert loop.wait_for_end() == 0
    assert summary(programs)["deviations"]["off the path"] >= 150

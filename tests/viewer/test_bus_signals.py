"""The signals of the buses for the free plot: which there are, and the samples of those that are plotted."""

import numpy as np
import pytest

from vehicle_iface.codec.database import load_database
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.units import NS_PER_MS, NS_PER_S
from vehicle_iface_viewer.bus_table import bus_signals as module
from vehicle_iface_viewer.bus_table.bus_signals import KEPT_READS, MAX_PLOTTED, BusSignals
from vehicle_iface_viewer.bus_table.finder import MessageFinder
from vehicle_iface_viewer.bus_table.report import BusReport, MessageRow, Samples, SignalKey, SignalValue
from vehicle_iface_viewer.bus_table.sampler import SignalSampler

BEGIN_NS = 1000 * NS_PER_S
SPEED = SignalKey(bus="", can_id="0x111", signal="SPEED")


def row(name: str, *signals: SignalValue, bus: str = "", can_id: str = "0x111", is_masked: bool = False) -> MessageRow:
    return MessageRow(
        bus=bus,
        can_id=can_id,
        name=name,
        is_masked=is_masked,
        frames=1,
        rate_hz=100.0,
        age_s=0.0,
        data="",
        signals=list(signals),
    )


def value(name: str, unit: str = "") -> SignalValue:
    return SignalValue(name=name, value="1", unit=unit)


def seen(*rows: MessageRow) -> BusSignals:
    signals = BusSignals()
    signals.update(BusReport(rows=list(rows)))
    return signals


@pytest.fixture(scope="module")
def finder() -> MessageFinder:
    return MessageFinder(load_database(load_profile("reference")))


def frame(finder: MessageFinder, name: str, k: int, **values: float) -> CanFrame:
    (message,) = [each for each in finder._messages.values() if each.name == name]
    data = message.encode({each.name: 0.0 for each in message.signals} | values, strict=False)
    return CanFrame(message.frame_id, data, BEGIN_NS + k * NS_PER_MS)


def test_every_value_of_the_chosen_signals_is_taken_and_of_no_other_ones(finder: MessageFinder) -> None:
    sampler = SignalSampler(finder)
    sampler.choose([SPEED, SignalKey(bus="", can_id="0x110", signal="POS_X"), SPEED])
    frames = [frame(finder, "MOTION", k, SPEED=k / 10) for k in range(100)]
    frames.insert(50, frame(finder, "POSE", 49, POS_X=-7.5))
    sampler.add([*frames, frame(finder, "CHASSIS", 99)])
    speed, position, again = sampler.take()
    assert speed.times_ns == [BEGIN_NS + k * NS_PER_MS for k in range(100)]
    assert speed.values == pytest.approx([k / 10 for k in range(100)])
    assert (position.times_ns, position.values) == ([BEGIN_NS + 49 * NS_PER_MS], [-7.5])
    assert again == speed
    assert sampler.take() == [Samples([], [])] * 3


def test_damaged_frames_and_signals_that_do_not_exist_have_no_samples(finder: MessageFinder) -> None:
    sampler = SignalSampler(finder)
    absent = [("other", "0x111", "SPEED"), ("", "0x111", "NONE"), ("", "0x7F0", "SPEED")]
    sampler.choose([SPEED, *(SignalKey(bus=bus, can_id=can_id, signal=name) for bus, can_id, name in absent)])
    good = frame(finder, "MOTION", 0, SPEED=3.0)
    sampler.add([good._replace(data=b"\1"), good._replace(is_error=True), good._replace(can_id=0x7F0), good])
    assert sampler.take() == [Samples([BEGIN_NS], [3.0]), *[Samples([], [])] * 3]
    sampler.choose([])
    sampler.add([good])
    assert sampler.take() == []


def test_each_signal_of_the_table_has_a_name_with_its_bus_unit_and_where_it_matters_its_identifier() -> None:
    signals = seen(
        row("MOTION", value("SPEED", "m/s"), value("COUNTER")),
        row("ANGLES", value("ROLL", "deg"), bus="ins", can_id="0x200"),
        row("EEC1", value("RPM", "rpm"), can_id="0x0CF00400", is_masked=True),
        row("", can_id="0x700"),
    )
    expected: tuple[str, ...] = (
        "MOTION.SPEED, m/s",
        "MOTION.COUNTER",
        "ins ANGLES.ROLL, °",
        "EEC1 0x0CF00400.RPM, rpm",
    )
    assert signals.offered == expected
    found = signals.find("ins ANGLES.ROLL, °")
    assert found is not None
    assert (found.key, found.unit) == (SignalKey(bus="ins", can_id="0x200", signal="ROLL"), "°")
    assert signals.find("EEC1.RPM, rpm") is None
    signals.update(BusReport(rows=[row("LATER", value("A"), can_id="0x333")], problem="lost"))
    assert signals.offered == (*expected, "LATER.A")
    assert signals.problem == "lost"


def test_samples_are_kept_while_somebody_plots_them_and_for_some_time_after() -> None:
    signals = seen(row("MOTION", value("SPEED", "m/s"), value("YAW_RATE", "rad/s")))
    name = "MOTION.SPEED, m/s"
    signals.want(name)
    signals.want("no such signal")
    assert signals.advance() == [SPEED]
    signals.extend([SPEED], [Samples([5, 6, 8], [1.0, 2.0, 3.0])])
    assert signals.between(name, 5, 8).tolist() == [(6, 2.0), (8, 3.0)]
    assert len(signals.between("MOTION.YAW_RATE, rad/s", 0, 9)) == 0
    for _ in range(KEPT_READS - 1):
        assert signals.advance() == [SPEED]
    signals.want(name)
    for _ in range(KEPT_READS):
        assert signals.advance() == [SPEED]
    assert signals.advance() == []
    assert len(signals.between(name, 0, 9)) == 0


def test_the_number_of_kept_signals_is_bounded() -> None:
    signals = seen(*(row(f"M{k}", value("A"), can_id=f"0x{k:03X}") for k in range(MAX_PLOTTED + 1)))
    for k in range(MAX_PLOTTED + 1):
        signals.want(f"M{k}.A")
    assert len(signals.advance()) == MAX_PLOTTED
    assert [name for name in signals.offered if signals.is_left_out(name)] == [f"M{MAX_PLOTTED}.A"]


def test_the_number_of_samples_is_bounded_and_the_newest_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MAX_SAMPLES", 5000)
    signals = seen(row("MOTION", value("SPEED")))
    signals.want("MOTION.SPEED")
    signals.advance()
    for begin in range(0, 20_000, 7):
        times = list(range(begin, begin + 7))
        signals.extend([SPEED], [Samples(times, [float(each) for each in times])])
        kept = signals.between("MOTION.SPEED", -1, 1 << 40)
        assert kept["at_ns"][-1] == begin + 6
        assert (np.diff(kept["value"]) == 1).all()
        assert min(begin + 7, 4000) <= len(kept) <= 5000


def test_times_never_go_back_though_the_wall_clock_does() -> None:
    signals = seen(row("MOTION", value("SPEED")))
    signals.want("MOTION.SPEED")
    signals.advance()
    for times in ([10, 20], [15, 25, 24, 30]):
        signals.extend([SPEED], [Samples(times, [0.0] * len(times))])
    assert signals.between("MOTION.SPEED", 0, 99)["at_ns"].tolist() == [10, 20, 20, 25, 25, 30]


def test_another_session_has_signals_of_its_own_and_another_time_other_samples() -> None:
    signals = seen(row("MOTION", value("SPEED")))
    signals.want("MOTION.SPEED")
    signals.advance()
    signals.extend([SPEED], [Samples([7], [1.0])])
    signals.clear_samples()
    assert len(signals.between("MOTION.SPEED", 0, 9)) == 0
    signals.extend([SPEED], [Samples([3], [1.0])])
    assert len(signals.between("MOTION.SPEED", 0, 9)) == 1
    signals.clear()
    assert (signals.offered, signals.advance()) == ((), [])
    signals.update(BusReport(rows=[row("MOTION", value("SPEED"))]))
    assert signals.advance() == [SPEED]  # somebody plots it still

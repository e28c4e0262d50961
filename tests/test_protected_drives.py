"""Vehicles with a protection of their own are driven: loop and simulated vehicle, both from one profile."""

from pathlib import Path

import pytest

from tests import harness
from tests.codec.small_vehicle import COMMAND, SUM, load_vehicle
from tests.harness import Drive, Sent
from vehicle_iface.codec.decoder import DropCause
from vehicle_iface.frame import CanFrame

TOYOTA = 'checksum = { signal = "CHECKSUM", kind = "sum", over = ["id", "length", "bytes"] }'
TABLE = 'checksum = { signal = "CHECKSUM", kind = "crc8", poly = 0x2F, init = 0xFF, xor_out = 0xFF, table = [218] }'
COUNTER = 'counter = { signal = "COUNTER" }'
USED = "\n[protection.messages]\nPOSE = 'sum'\nCMD = 'rule'\n"


@pytest.fixture(autouse=True)
def _keep_frames_as_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """The harness takes the reference vehicle's commands apart, and these are none."""

    def keep(frame: CanFrame, at_ns: int = 0, step: int = 0) -> Sent:
        return Sent(at_ns, step, "CMD", frame.data[0] >> 1 & 63, {}, frame)

    monkeypatch.setattr(harness, "decode_sent", keep)


@pytest.mark.parametrize(
    "rule", [f"{TOYOTA}\n{COUNTER}", COUNTER, f"{TABLE}\n{COUNTER}"], ids=["sum", "counter", "crc"]
)
def test_a_vehicle_that_checks_its_own_kind_of_protection_is_driven(tmp_path: Path, rule: str) -> None:
    has_checksum = "CHECKSUM" in rule
    command = COMMAND if has_checksum else "\n".join(COMMAND.splitlines()[:-1]) + "\n"
    drive = Drive(database=load_vehicle(tmp_path, f"{SUM}[protection.rule]\n{rule}{USED}", command=command))
    drive.engage(speed_mps=1.0)
    assert drive.vehicle.counters["commands_dropped"] == 0
    counters = [sent.counter for sent in drive.sent]
    assert counters == [count % 64 for count in range(len(counters))]


def test_damaged_samples_without_a_counter_are_dropped_and_stop_the_vehicle(tmp_path: Path) -> None:
    drive = Drive(database=load_vehicle(tmp_path, f"{SUM}[protection.rule]\n{TOYOTA}\n{COUNTER}{USED}"))
    drive.engage(speed_mps=1.0)
    drive.send_line("corrupt POSE 3")
    drive.run_s(0.2)
    assert drive.loop._decoder.drops == {(DropCause.BAD_CRC, "POSE"): 3}
    drive.send_line("corrupt POSE 20")
    drive.run_s(0.15)
    assert drive.loop.reason.name == "STATE_STALE"

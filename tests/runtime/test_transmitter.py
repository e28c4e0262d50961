"""Frames on their way out: what did not leave has not happened."""

import pytest

from tests.harness import Drive, counters_step_by_one
from vehicle_iface.frame import CanFrame

STEER_COMMAND = 0x081


def test_a_frame_that_the_filter_refuses_steps_no_counter_and_is_sent_with_the_next_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    drive = Drive().engage(3.0)
    transmit_filter, since = drive.loop._transmitter._transmit_filter, len(drive.sent)
    allows = transmit_filter.allows

    def refuses_steering(frame: CanFrame, now_ns: int) -> bool:
        return frame.can_id != STEER_COMMAND and allows(frame, now_ns)

    monkeypatch.setattr(transmit_filter, "allows", refuses_steering)
    drive.run_s(0.03)
    half = drive.sent[since:]
    monkeypatch.undo()
    drive.run_s(0.1)
    assert {sent.name for sent in half} >= {"DRIVE_COMMAND"}
    assert "STEER_COMMAND" not in {sent.name for sent in half}
    assert len(drive.named("STEER_COMMAND", since + len(half))) > 5
    assert counters_step_by_one(drive.sent)

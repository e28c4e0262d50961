"""Which messages an answer is sent in: every n-th, and at once what must not wait."""

from dataclasses import replace

import pytest

from tests.harness import ms, reference
from vehicle_iface.command import SafeCommand
from vehicle_iface.frame import CanFrame
from vehicle_iface.reason import Reason
from vehicle_iface.runtime.command_pace import CommandPace
from vehicle_iface.safety.transmit_filter import AllowedMessage, TransmitFilter
from vehicle_iface.status import Gear

DRIVE, STEER = frozenset({"DRIVE_COMMAND"}), frozenset({"STEER_COMMAND"})
RELEASED = SafeCommand(
    stamp_ns=0,
    enable=False,
    safe_stop=False,
    accel_mps2=0.0,
    front_wheel_angle_rad=0.0,
    rear_wheel_angle_rad=0.0,
    speed_mps=0.0,
    reason=Reason.NOT_ENGAGED,
    gear_request=Gear.NO_REQUEST,
)
DRIVEN = replace(RELEASED, enable=True, reason=Reason.NOMINAL)
STOPPED = replace(DRIVEN, safe_stop=True, reason=Reason.NO_TRAJECTORY)


def new_filter() -> TransmitFilter:
    return TransmitFilter(AllowedMessage(m.can_id, False, False, 8, ms(30)) for m in reference().commands)


def new_pace(transmit_filter: TransmitFilter | None = None, *, steer_ms: int = 30, carries: bool = True) -> CommandPace:
    return CommandPace(
        reference().commands,
        {"DRIVE_COMMAND": ms(30), "STEER_COMMAND": ms(steer_ms)},
        sample_period_ns=ms(10),
        transmit_filter=transmit_filter or new_filter(),
        carries_enable=carries,
    )


def sent_at_ms(pace: CommandPace, commands: list[SafeCommand]) -> list[int]:
    """One command each 10 ms from 1000 ms on; when all of its messages were selected."""
    found = []
    for number, command in enumerate(commands):
        names = pace.select(command, ms(1000 + 10 * number))
        if names:
            pace.commit(command, ms(1000 + 10 * number), names)
            found.append(10 * number)
    return found


def test_every_third_answer_is_sent_from_the_first_one_on() -> None:
    assert sent_at_ms(new_pace(), [DRIVEN] * 10) == [0, 30, 60, 90]


@pytest.mark.parametrize(
    ("before", "after"), [(DRIVEN, STOPPED), (DRIVEN, RELEASED), (STOPPED, RELEASED), (RELEASED, DRIVEN)]
)
def test_a_stop_a_release_and_a_first_enabled_command_do_not_wait(before: SafeCommand, after: SafeCommand) -> None:
    assert sent_at_ms(new_pace(), [before] * 4 + [after] * 6) == [0, 30, 40, 70]


def test_driving_on_after_a_stop_waits_for_its_turn() -> None:
    assert sent_at_ms(new_pace(), [STOPPED] * 4 + [DRIVEN] * 6) == [0, 30, 60, 90]


def test_a_stop_waits_for_its_turn_where_the_filter_has_no_room() -> None:
    transmit_filter = new_filter()
    while transmit_filter.allows(CanFrame(reference().commands[1].can_id, bytes(8)), ms(1000)):
        pass
    assert sent_at_ms(new_pace(transmit_filter), [DRIVEN] * 4 + [STOPPED] * 6) == [0, 30, 60, 90]


def test_slow_messages_carry_only_the_newest_of_the_samples_that_waited() -> None:
    pace = new_pace(steer_ms=10)
    assert pace.select(DRIVEN, ms(1000), is_newest=False) == STEER
    assert pace.select(DRIVEN, ms(1000)) == DRIVE | STEER == pace.all_names


def test_messages_that_could_not_be_sent_stay_due() -> None:
    pace = new_pace(steer_ms=10)
    pace.commit(DRIVEN, ms(1000), STEER)
    assert pace.select(DRIVEN, ms(1010)) == DRIVE | STEER
    pace.commit(DRIVEN, ms(1010), DRIVE | STEER)
    assert [pace.select(DRIVEN, ms(at_ms)) for at_ms in (1020, 1030)] == [STEER, STEER]
    assert pace.select(DRIVEN, ms(1040)) == DRIVE | STEER


def test_uneven_samples_do_not_shift_the_pace() -> None:
    pace, sent_ms = new_pace(), []
    for number in range(60):
        at_ms = 1000 + 10 * number + (2 if number % 2 else -2)
        if names := pace.select(DRIVEN, ms(at_ms)):
            pace.commit(DRIVEN, ms(at_ms), names)
            sent_ms.append(number)
    assert sent_ms == list(range(0, 60, 3))


def test_commands_without_an_enable_are_selected_only_while_they_are_enabled_and_then_at_once() -> None:
    pace = new_pace(carries=False)
    assert sent_at_ms(pace, [RELEASED, DRIVEN, DRIVEN, RELEASED, DRIVEN, DRIVEN]) == [10, 40]

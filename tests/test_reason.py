"""Reasons have the bus contract's numbers."""

from vehicle_iface import Reason


def test_the_reasons_have_the_contracts_numbers() -> None:
    page = """
        0 NOMINAL, 1 NO_TRAJECTORY, 2 EMPTY_TRAJECTORY, 3 PAST_END_SPACE, 4 PAST_END_TIME, 5 FRAME_MISMATCH,
        6 STATE_STALE, 7 STATE_INVALID, 8 CONTROLLER_ERROR, 9 DEVIATION, 10 DRIVER_OVERRIDE,
        11 VEHICLE_NOT_AUTONOMOUS, 12 VEHICLE_FAULT, 13 LINK_DOWN, 14 DUPLICATE_COMMANDER, 15 SHUTDOWN,
        16 DEADLINE_MISSED, 17 NOT_ENGAGED
    """
    assert [f"{reason.value} {reason.name}" for reason in Reason] == [entry.strip() for entry in page.split(",")]

"""A CAN frame rejects what no bus can carry."""

import pytest

from tests.values import refusal
from vehicle_iface.frame import CanFrame


@pytest.mark.parametrize(("can_id", "is_extended"), [(0, False), (0x7FF, False), (0, True), (0x1FFFFFFF, True)])
def test_identifiers_at_the_ends_of_their_range_are_taken(can_id: int, is_extended: bool) -> None:
    assert CanFrame(can_id, b"", is_extended=is_extended).can_id == can_id


@pytest.mark.parametrize(("can_id", "is_extended"), [(-1, False), (0x800, False), (-1, True), (0x20000000, True)])
def test_an_identifier_that_does_not_fit_is_refused_with_its_value(can_id: int, is_extended: bool) -> None:
    assert f"can_id = {can_id:#x}" in refusal(lambda: CanFrame(can_id, b"", is_extended=is_extended))


@pytest.mark.parametrize(("length", "is_fd"), [(8, False), (64, True)])
def test_a_payload_may_be_full_but_not_one_byte_longer(length: int, is_fd: bool) -> None:
    assert len(CanFrame(1, bytes(length), is_fd=is_fd).data) == length
    text = refusal(lambda: CanFrame(1, bytes(length + 1), is_fd=is_fd))
    assert f"data of {length + 1} bytes: at most {length}" in text

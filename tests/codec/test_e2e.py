"""End-to-end protection: checksums computed a second time bit by bit, and the rule for the counter."""

from collections import abc
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vehicle_iface.codec.checksums import BitPlace, crc_function
from vehicle_iface.codec.e2e import (
    WINDOW,
    CounterCheck,
    DamageCheck,
    HeaderBits,
    Sequence,
    autosar_protection,
    header_bits,
)
from vehicle_iface.codec.protection import NO_COUNTER, PartKind, ProtectionRecipe, Reduction
from vehicle_iface.errors import ConfigError

P02_IDS = tuple(range(16))


def crc(data: abc.Sequence[int], *, bits: int, polynomial: int, initial: int, final: int = 0) -> int:
    """A checksum, most significant bit first, as AUTOSAR SWS CRC Library writes it down."""
    register, top = initial, 1 << bits - 1
    for byte in data:
        register ^= byte << bits - 8
        for _ in range(8):
            register = (register << 1) ^ (polynomial if register & top else 0)
            register &= (1 << bits) - 1
    return register ^ final


def crc_profile_1(data: abc.Sequence[int], data_id: int, mode: str = "BOTH") -> int:
    low, high = data_id & 0xFF, data_id >> 8
    chosen = low if data[1] % 2 == 0 else high
    head = {"BOTH": [low, high], "LOW": [low], "ALT": [chosen], "NIBBLE": [low, 0]}[mode]
    return crc([*head, *data[1:]], bits=8, polynomial=0x1D, initial=0)


def crc_profile_2(data: abc.Sequence[int], data_ids: abc.Sequence[int]) -> int:
    return crc([*data[1:], data_ids[data[1] & 0x0F]], bits=8, polynomial=0x2F, initial=0xFF, final=0xFF)


def crc_profile_5(data: abc.Sequence[int], data_id: int) -> int:
    return crc([*data[2:], data_id & 0xFF, data_id >> 8], bits=16, polynomial=0x1021, initial=0xFFFF)


payloads = st.binary(min_size=8, max_size=8)
data_ids = st.integers(0, 0xFFFF)
counters = st.integers(0, 14)


@pytest.mark.parametrize(("counter", "frame"), [(1, "0201"), (2, "e502")])
def test_the_contracts_worked_example(counter: int, frame: str) -> None:
    data = bytearray(8)
    autosar_protection(1, 0x100, 8).protect(data, counter)
    assert data[:2].hex() == frame


@pytest.mark.parametrize("profile", [1, 11])
@pytest.mark.parametrize("mode", ["BOTH", "LOW", "ALT", "NIBBLE"])
@given(payload=payloads, data_id=data_ids, counter=counters)
def test_profiles_1_and_11_have_the_checksum_computed_here(
    profile: int, mode: str, payload: bytes, data_id: int, counter: int
) -> None:
    if profile == 11 and mode in ("LOW", "ALT"):
        with pytest.raises(ConfigError, match="profile 11 has BOTH, NIBBLE"):
            autosar_protection(profile, data_id, 8, mode)
        return
    protection, data = autosar_protection(profile, data_id, 8, mode), bytearray(payload)
    protection.protect(data, counter)
    assert data[0] == crc_profile_1(data, data_id, mode)
    assert data[1] >> 4 == (data_id >> 8 & 0x0F if mode == "NIBBLE" else payload[1] >> 4)
    assert data[2:] == payload[2:]
    assert protection.read_counter(bytes(data)) == counter
    assert protection.intact(bytes(data))


@given(payload=payloads, ids=st.lists(st.integers(0, 255), min_size=16, max_size=16), counter=st.integers(0, 15))
def test_profile_2_has_the_checksum_computed_here(payload: bytes, ids: list[int], counter: int) -> None:
    protection, data = autosar_protection(2, tuple(ids), 8), bytearray(payload)
    protection.protect(data, counter)
    assert data[0] == crc_profile_2(data, ids)
    assert protection.read_counter(bytes(data)) == counter
    assert protection.intact(bytes(data))


@given(payload=st.binary(min_size=3, max_size=64), data_id=data_ids, counter=st.integers(0, 255))
def test_profile_5_has_the_checksum_computed_here(payload: bytes, data_id: int, counter: int) -> None:
    protection, data = autosar_protection(5, data_id, len(payload)), bytearray(payload)
    protection.protect(data, counter)
    assert int.from_bytes(data[:2], "little") == crc_profile_5(data, data_id)
    assert protection.read_counter(bytes(data)) == counter
    assert protection.intact(bytes(data))


@pytest.mark.parametrize("profile", [1, 2, 5, 11])
@given(payload=payloads, bit=st.integers(0, 63), counter=counters)
def test_one_flipped_bit_is_seen(profile: int, payload: bytes, bit: int, counter: int) -> None:
    protection, data = autosar_protection(profile, P02_IDS if profile == 2 else 0x123, 8), bytearray(payload)
    protection.protect(data, counter)
    data[bit // 8] ^= 1 << bit % 8
    assert not protection.intact(bytes(data))


@pytest.mark.parametrize("mode", ["LOW", "ALT", "NIBBLE"])
@given(payload=payloads, counter=counters)
def test_a_checksum_over_the_data_id_in_another_mode_is_rejected(mode: str, payload: bytes, counter: int) -> None:
    data = bytearray(payload)
    autosar_protection(1, 0x1234, 8, "BOTH").protect(data, counter)
    if data[0] != crc_profile_1(data, 0x1234, mode):
        assert not autosar_protection(1, 0x1234, 8, mode).intact(bytes(data))


@pytest.mark.parametrize("profile", [1, 5, 11])
@given(payload=payloads, counter=counters)
def test_another_messages_data_id_is_seen(profile: int, payload: bytes, counter: int) -> None:
    data = bytearray(payload)
    autosar_protection(profile, 0x110, 8).protect(data, counter)
    assert not autosar_protection(profile, 0x111, 8).intact(bytes(data))


@pytest.mark.parametrize(("profile", "states"), [(1, 15), (2, 16), (5, 256), (11, 15)])
def test_the_counter_runs_through_all_its_values_and_starts_again(profile: int, states: int) -> None:
    protection = autosar_protection(profile, P02_IDS if profile == 2 else 1, 8)
    seen, counter = [], 0
    for _ in range(states + 1):
        seen.append(counter)
        counter = protection.next_counter(counter)
    assert seen == [*range(states), 0]


@pytest.mark.parametrize(("profile", "values"), [(1, 16), (2, 16), (5, 256), (11, 16)])
def test_each_counter_is_written_as_it_is_also_an_invalid_one(profile: int, values: int) -> None:
    protection, data = autosar_protection(profile, P02_IDS if profile == 2 else 0x123, 8), bytearray(8)
    for counter in range(values):
        protection.protect(data, counter)
        assert protection.read_counter(bytes(data)) == counter
        assert protection.intact(bytes(data))


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((3, 0x100, 8), "must be one of 1, 2, 5, 11"),
        ((1, 0x10000, 8), "16 bits"),
        ((1, P02_IDS, 8), "16 bits"),
        ((5, -1, 8), "16 bits"),
        ((2, 0x100, 8), "list of 16 bytes"),
        ((2, (1, 2, 3), 8), "list of 16 bytes"),
        ((1, 0x100, 1), "needs 2"),
        ((5, 0x100, 2), "needs 3"),
        ((1, 0x100, 8, "HIGH"), "BOTH, ALT, LOW, NIBBLE"),
    ],
)
def test_a_protection_that_does_not_exist_is_refused(arguments: tuple[Any, ...], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        autosar_protection(*arguments)


@pytest.mark.parametrize("first", range(15))
@pytest.mark.parametrize("step", range(15))
def test_steps_of_one_to_three_are_good_from_every_counter(first: int, step: int) -> None:
    check = CounterCheck(15, 3)
    assert check.step(first) is Sequence.INITIAL
    verdict = check.step((first + step) % 15)
    expected = {0: Sequence.REPEATED, 1: Sequence.OK, 2: Sequence.OK, 3: Sequence.OK}
    assert verdict is expected.get(step, Sequence.WRONG)
    assert check.lost == {2: 1, 3: 2}.get(step, 0)


@pytest.mark.parametrize("jump", range(4, 15))
def test_after_a_jump_the_next_frame_is_counted_from_it(jump: int) -> None:
    check = CounterCheck(15, 3)
    check.step(0)
    assert check.step(jump) is Sequence.WRONG
    assert check.step((jump + 1) % 15) is Sequence.OK
    assert check.lost == 0


def test_a_counter_that_does_not_exist_is_as_if_it_had_not_been() -> None:
    check = CounterCheck(15, 3)
    check.step(4)
    assert check.step(15) is Sequence.INVALID
    assert check.step(5) is Sequence.OK


def test_a_stuck_counter_stays_repeated() -> None:
    check = CounterCheck(15, 3)
    check.step(7)
    assert [check.step(7) for _ in range(50)] == [Sequence.REPEATED] * 50


def test_after_a_reset_any_counter_is_the_first() -> None:
    check = CounterCheck(15, 3)
    check.step(3)
    check.reset()
    assert check.step(12) is Sequence.INITIAL


@pytest.mark.parametrize("step", [0, -1, 14, 15, 100])
def test_a_counter_step_that_hides_the_order_of_frames_is_refused(step: int) -> None:
    with pytest.raises(ConfigError, match=r"max_counter_step = .*must be in \[1, 13\]"):
        CounterCheck(15, step)


def damaged(check: DamageCheck, count: int) -> None:
    for _ in range(count):
        check.note_damaged()


def test_while_most_frames_are_damaged_no_intact_one_is_trusted() -> None:
    check = CounterCheck(15, 3)
    assert [check.step(counter) for counter in range(3)] == [Sequence.INITIAL, Sequence.OK, Sequence.OK]
    verdicts = []
    for counter in range(3, 12):
        damaged(check, 8)
        verdicts.append(check.step(counter))
    assert verdicts[0] is Sequence.OK  # a burst of eight among good ones
    assert set(verdicts[1:]) == {Sequence.UNTRUSTED}
    good = [check.step(counter % 15) for counter in range(12, 28)]
    assert good == [Sequence.UNTRUSTED] * 5 + [Sequence.OK] * 11


@pytest.mark.parametrize(("bad", "verdict"), [(8, Sequence.OK), (9, Sequence.UNTRUSTED)])
def test_half_of_the_last_sixteen_frames_have_to_be_good_with_the_newest(bad: int, verdict: Sequence) -> None:
    check = CounterCheck(15, 3)
    check.step(0)
    damaged(check, bad)
    assert check.step(1) is verdict


def test_noise_alone_never_begins_a_sequence() -> None:
    check = CounterCheck(15, 3)
    damaged(check, 20)
    assert check.step(7) is Sequence.UNTRUSTED
    check.reset()
    assert check.step(7) is Sequence.INITIAL


@pytest.mark.parametrize(
    ("bad", "step", "verdict"), [(4, 7, Sequence.OK), (4, 8, Sequence.WRONG), (7, 8, Sequence.WRONG)]
)
def test_noise_does_not_widen_the_step_beyond_four(bad: int, step: int, verdict: Sequence) -> None:
    check = CounterCheck(15, 3)
    for counter in range(3):
        check.step(counter)
    damaged(check, bad)
    assert check.step(2 + step) is verdict


@pytest.mark.parametrize(
    ("profile", "least_bytes", "crc_bits", "counter_bits"),
    [(1, 2, (0, 8), (8, 4)), (2, 2, (0, 8), (8, 4)), (5, 3, (0, 16), (16, 8)), (11, 2, (0, 8), (8, 4))],
)
def test_checksum_and_counter_are_at_the_front_and_need_no_more_bytes_than_their_own(
    profile: int, least_bytes: int, crc_bits: tuple[int, int], counter_bits: tuple[int, int]
) -> None:
    data_id = P02_IDS if profile == 2 else 0x123
    assert header_bits(profile) == HeaderBits(crc_bits, counter_bits)
    assert autosar_protection(profile, data_id, least_bytes).has_counter
    with pytest.raises(ConfigError, match=f"needs {least_bytes}"):
        autosar_protection(profile, data_id, least_bytes - 1)


@pytest.mark.parametrize("profile", [1, 11])
def test_a_counter_that_does_not_exist_is_no_damage(profile: int) -> None:
    protection, data = autosar_protection(profile, 0x123, 8), bytearray(8)
    protection.protect(data, 15)
    assert protection.intact(bytes(data)) is True
    data[7] ^= 1
    assert protection.intact(bytes(data)) is False


def test_up_to_two_frames_in_a_row_may_be_lost_where_nothing_else_is_stated() -> None:
    assert autosar_protection(1, 0x110, 8).max_step == 3


@example([False] * 9 + [True] * 9 + [False] + [True])
@given(st.lists(st.booleans(), max_size=60))
def test_without_a_counter_at_least_half_of_the_last_sixteen_frames_are_intact(frames: list[bool]) -> None:
    check, last = DamageCheck(), [True] * 16
    for is_intact in frames:
        last = [*last[1:], is_intact]
        if is_intact:
            assert check.step(-1) is (Sequence.OK if sum(last) >= 8 else Sequence.UNTRUSTED)
        else:
            check.note_damaged()


def test_a_counter_that_runs_as_it_should_loses_nothing_and_starts_again_after_the_greatest() -> None:
    check = CounterCheck(15, 1)
    verdicts = [check.step(count % 15) for count in range(40)]
    assert verdicts == [Sequence.INITIAL] + [Sequence.OK] * 39
    assert check.lost == 0


def test_the_counter_after_the_greatest_does_not_exist() -> None:
    check = CounterCheck(15, 1)
    assert [check.step(counter) for counter in (13, 14, 15, 0)] == [
        Sequence.INITIAL,
        Sequence.OK,
        Sequence.INVALID,
        Sequence.OK,
    ]


@pytest.mark.parametrize(("step", "verdict"), [(13, Sequence.OK), (14, Sequence.WRONG)])
def test_the_greatest_step_distinguishes_an_advance_from_a_repetition(step: int, verdict: Sequence) -> None:
    assert CounterCheck(15, 13)
    check = CounterCheck(15, 12)
    check.step(0)
    damaged(check, 4)
    assert check.step(step) is verdict


def test_a_damaged_frame_widens_the_next_step_and_no_other() -> None:
    check = CounterCheck(15, 3)
    check.step(0)
    damaged(check, 1)
    assert check.step(4) is Sequence.OK
    assert check.step(8) is Sequence.WRONG


def test_however_often_a_frame_is_repeated_after_damage_only_the_next_step_is_widened() -> None:
    check = CounterCheck(15, 3)
    check.step(0)
    damaged(check, 1)
    for _ in range(WINDOW):
        assert check.step(0) in (Sequence.REPEATED, Sequence.UNTRUSTED)
    assert check.step(1) is Sequence.OK
    assert check.step(5) is Sequence.WRONG


@pytest.mark.parametrize("bad", [0, 1, 2, 3, 4])
def test_each_damaged_frame_widens_the_next_step_by_one(bad: int) -> None:
    for step, verdict in ((3 + bad, Sequence.OK), (4 + bad, Sequence.WRONG)):
        check = CounterCheck(15, 3)
        check.step(0)
        damaged(check, bad)
        assert check.step(step) is verdict


def test_damage_before_a_reset_widens_nothing_after_it() -> None:
    check = CounterCheck(15, 3)
    damaged(check, 3)
    check.reset()
    assert check.step(0) is Sequence.INITIAL
    assert check.step(4) is Sequence.WRONG


DAMAGED, RESET = "damaged", "reset"


@example([3, 4, DAMAGED, *[4] * 16, 5, 6])
@example([13, 14, 0, 1, 1, 2, 9, 10, 15, 11, DAMAGED, 12, 13, RESET, 5, 6, 7, 11, 12])
@given(st.lists(st.one_of(st.integers(0, 15), st.just(DAMAGED), st.just(RESET)), max_size=60))
def test_the_expected_counter_without_step_comes_to_the_same_as_with_it(frames: list[int | str]) -> None:
    check, judging = CounterCheck(15, 3), CounterCheck(15, 3)
    for frame in frames:
        if isinstance(frame, str):
            for each in (check, judging):
                each.note_damaged() if frame is DAMAGED else each.reset()
            continue
        verdict = judging.step(frame)
        if frame == check.expected:
            check.expected = check.following[frame]
            assert verdict is Sequence.OK
        else:
            assert check.step(frame) is verdict
        assert (check.expected, check.lost) == (judging.expected, judging.lost)


def test_the_next_counter_is_expected_while_all_frames_are_intact() -> None:
    check = CounterCheck(15, 3)
    assert check.expected is None
    for counter in (13, 14, 0):
        check.step(counter)
        assert check.expected == (counter + 1) % 15
    check.note_damaged()
    assert check.expected is None
    for count in range(1, WINDOW):
        check.step(count % 15)
        assert check.expected is None
    check.step(WINDOW % 15)
    assert check.expected == WINDOW % 15 + 1


def test_without_a_counter_each_frame_is_judged_until_all_of_the_last_ones_are_intact() -> None:
    check = DamageCheck()
    assert check.expected == NO_COUNTER == check.following[NO_COUNTER]
    damaged(check, 1)
    expected = []
    for _ in range(WINDOW):
        check.step(NO_COUNTER)
        expected.append(check.expected)
    assert expected == [*[None] * (WINDOW - 1), NO_COUNTER]
    damaged(check, 1)
    check.reset()
    assert check.expected == NO_COUNTER


def compute_recipe(recipe: ProtectionRecipe, payload: bytes, counter: int) -> bytes:
    """Protect a payload by the numbers of a recipe, whose bits all begin at a byte."""
    data, checksum = bytearray(payload), recipe.checksum
    assert recipe.counter is not None
    assert checksum is not None
    BitPlace(recipe.counter.shift, recipe.counter.width, "little").write(data, counter)
    covered = b""
    for part in checksum.cover:
        if part.kind is PartKind.PAYLOAD:
            masked = bytes(byte & mask for byte, mask in zip(data, part.content, strict=True))
            covered += masked[: part.first] + masked[part.end :]
        elif part.kind is PartKind.TABLE:
            covered += part.content[counter % len(part.content) :][:1]
        else:
            covered += part.content
    crc = crc_function(checksum.width, checksum.poly, checksum.init, checksum.xor_out)
    BitPlace(checksum.place.shift, checksum.place.width, "little").write(data, crc(covered))
    assert (checksum.kind, checksum.place.is_big, recipe.counter.is_big) == (Reduction.CRC, False, False)
    return bytes(data)


@pytest.mark.parametrize(
    ("profile", "data_id", "mode"),
    [
        (1, 0x1234, "BOTH"),
        (1, 0x1234, "LOW"),
        (1, 0x1234, "ALT"),
        (2, tuple(range(16)), "BOTH"),
        (5, 0xABCD, "BOTH"),
        (11, 0x0BCD, "BOTH"),
    ],
)
@pytest.mark.parametrize("length", [3, 8, 64])
def test_the_numbers_of_a_profile_are_what_its_functions_compute(
    profile: int, data_id: int | tuple[int, ...], mode: str, length: int
) -> None:
    protection = autosar_protection(profile, data_id, length, mode)
    assert protection.recipe is not None
    for counter in range(15):
        payload = bytes(7 * counter + 31 * index & 0xFF for index in range(length))
        expected = bytearray(payload)
        protection.protect(expected, counter)
        assert compute_recipe(protection.recipe, payload, counter) == expected


@pytest.mark.parametrize("profile", [1, 11])
def test_the_mode_nibble_has_no_numbers(profile: int) -> None:
    assert autosar_protection(profile, 0x123, 8, "NIBBLE").recipe is None

"""The words of the head: every state and reason has its sentence and its way on, legible on its colour."""

import re
from itertools import product

import pytest

from vehicle_iface import Reason
from vehicle_iface.status import ControllerState, VehicleMode
from vehicle_iface.telemetry import SessionInfo, Snapshot, WriterState
from vehicle_iface.units import NS_PER_S
from vehicle_iface_viewer.feed import View
from vehicle_iface_viewer.panels.banner import banner_html
from vehicle_iface_viewer.panels.words import REASONS, STATES, find_words

REARM = "kill -USR1 4711"


def shown(
    state: int,
    reason: int,
    *,
    speed_mps: float = 3.0,
    age_s: float = 0.0,
    writer_state: WriterState = WriterState.LIVE,
    recording: str = "",
    **changes: object,
) -> View:
    snapshot = Snapshot(NS_PER_S, state, reason, has_state=True, stamp_ns=NS_PER_S, speed_mps=speed_mps)
    return View(
        now_ns=NS_PER_S + round(age_s * NS_PER_S),
        address="a",
        writer_state=writer_state,
        recording=recording,
        info=SessionInfo(channel="vcan0", bus="SocketCAN vcan0", arming="armed", pid=4711),
        snapshot=snapshot._replace(**changes),  # type: ignore[arg-type]
    )


def test_every_reason_has_a_sentence_and_a_way_on() -> None:
    assert set(REASONS) == set(Reason)
    assert [reason.name for reason, words in REASONS.items() if not words.sentence] == []
    assert [reason.name for reason, words in REASONS.items() if not words.way_on] == ["NOMINAL"]


def test_every_state_has_a_headline_of_its_own_and_a_sentence() -> None:
    assert set(STATES) == set(ControllerState)
    assert len({words.headline for words in STATES.values()}) == len(ControllerState)
    assert all(words.sentence for words in STATES.values())


@pytest.mark.parametrize("reason", [each for each in Reason if each not in (Reason.SHUTDOWN, Reason.NOT_ENGAGED)])
def test_a_fault_of_any_reason_has_the_command_to_arm_again(reason: Reason) -> None:
    assert f"Then arm again: <code>{REARM}</code>." in find_words(shown(ControllerState.FAULT, reason)).way_on


@pytest.mark.parametrize(
    ("state", "reason", "speed_mps", "headline", "way_on"),
    [
        (ControllerState.STANDBY, Reason.DRIVER_OVERRIDE, 3.0, "DRIVER DRIVES", REARM),
        (ControllerState.STANDBY, Reason.SHUTDOWN, 0.0, "RELEASED", "start the loop again"),
        (ControllerState.STOPPING, Reason.SHUTDOWN, 3.0, "STOPPING TO END", "start the loop again"),
        (ControllerState.STOPPING, Reason.SHUTDOWN, 0.0, "STOPPED", "start the loop again"),
        (ControllerState.STOPPING, Reason.STATE_STALE, 3.0, "STOPPING", f"stays stopped, arm again: <code>{REARM}"),
        (ControllerState.STANDBY, Reason.NOT_ENGAGED, 0.0, "READY", "Set the vehicle to READY"),
        (ControllerState.ENGAGED, Reason.NOMINAL, 3.0, "DRIVING", ""),
    ],
)
def test_the_head_names_the_situation_and_the_way_on(
    state: ControllerState, reason: Reason, speed_mps: float, headline: str, way_on: str
) -> None:
    words = find_words(shown(state, reason, speed_mps=speed_mps))
    assert words.headline == headline
    assert way_on in words.way_on
    assert (REARM in words.way_on) == (REARM in way_on)


@pytest.mark.parametrize(
    ("writer_state", "headline"),
    [(WriterState.DEAD, "LOOP GONE"), (WriterState.ENDED, "LOOP ENDED"), (WriterState.LIVE, "NO DATA")],
)
def test_of_old_data_the_head_says_so_and_not_the_last_state(writer_state: WriterState, headline: str) -> None:
    words = find_words(shown(ControllerState.ENGAGED, Reason.NOMINAL, age_s=1.0, writer_state=writer_state))
    assert words.headline == headline
    assert "DRIVING" not in banner_html(shown(ControllerState.ENGAGED, 0, age_s=1.0, writer_state=writer_state))


@pytest.mark.parametrize("reason", list(Reason))
def test_a_recording_has_nothing_to_do(reason: Reason) -> None:
    assert find_words(shown(ControllerState.FAULT, reason, recording="then")).way_on == ""


@pytest.mark.parametrize(
    ("state", "reason", "is_armed"),
    [
        (ControllerState.ENGAGED, Reason.NOMINAL, True),
        (ControllerState.STANDBY, Reason.NOT_ENGAGED, True),
        (ControllerState.STANDBY, Reason.DRIVER_OVERRIDE, False),
        (ControllerState.FAULT, Reason.DEVIATION, False),
    ],
)
def test_after_an_override_or_a_fault_it_is_not_called_armed(
    state: ControllerState, reason: Reason, is_armed: bool
) -> None:
    assert ("not armed any more" not in banner_html(shown(state, reason))) == is_armed
    assert "not armed any more" in banner_html(shown(state, reason, writer_state=WriterState.DEAD))


@pytest.mark.parametrize(
    ("mode", "words"),
    [(VehicleMode.FAULT, "VEHICLE: FAULT"), (VehicleMode.EMERGENCY_STOP, "VEHICLE: EMERGENCY STOP")],
)
def test_a_fault_of_the_vehicle_is_in_the_head(mode: VehicleMode, words: str) -> None:
    content = banner_html(shown(ControllerState.STANDBY, Reason.NOT_ENGAGED, has_status=True, vehicle_mode=mode))
    assert words in content
    usual = shown(ControllerState.STANDBY, Reason.NOT_ENGAGED, has_status=True, vehicle_mode=VehicleMode.READY)
    assert "vehicle-fault" not in banner_html(usual)


def luminance(color: str) -> float:
    """The relative luminance of WCAG 2."""
    parts = [int(color[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    red, green, blue = (part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(text: str, back: str, opacity: float) -> float:
    """The contrast of WCAG 2 of a text that is a little transparent."""
    pairs = [(int(text[at : at + 2], 16), int(back[at : at + 2], 16)) for at in (1, 3, 5)]
    mixed = "#" + "".join(f"{round(over * opacity + under * (1 - opacity)):02x}" for over, under in pairs)
    light, dark = sorted((luminance(mixed), luminance(back)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def test_every_text_on_a_coloured_banner_has_a_contrast_of_four_and_a_half() -> None:
    pairs = set()
    for state, reason, age_s, recording in product(ControllerState, Reason, (0.0, 1.0), ("", "then")):
        for writer_state in (WriterState.LIVE, WriterState.DEAD):
            view = shown(
                state,
                reason,
                age_s=age_s,
                recording=recording,
                writer_state=writer_state,
                handover_pending=True,
                has_status=True,
                vehicle_mode=VehicleMode.FAULT,
            )
            for backs, text in re.findall(
                r"background:([^;]*#[^;]*);(?:[^\"]*?;)?color:(#[0-9a-f]+)", banner_html(view)
            ):
                pairs |= {(text if len(text) == 7 else "#ffffff", back) for back in re.findall("#[0-9a-f]{6}", backs)}
            pairs |= {("#ffffff", back) for back in re.findall(r"background:(#[0-9a-f]{6});b", banner_html(view))}
    assert len(pairs) >= 8
    # The frame and the text of TAKE OVER are black, and so never transparent.
    poor = {
        pair: round(found, 2)
        for pair in pairs - {("#ffffff", "#ffe600")}
        if (found := contrast(*pair, opacity=1.0 if pair[0] == "#000000" else 0.85)) < 4.5
    }
    assert poor == {}

"""What candump writes without `-L`, or with `-t`: screens, differences, dates, no times at all."""

from pathlib import Path

import pytest

from vehicle_iface.logs.columns import DecodedLog, decode_log, summarize

from .conftest import CLASSICAL, FD, POSE, adds_up

DATA = " ".join(POSE[i : i + 2] for i in range(0, 16, 2))
SCREEN = f"vcan0  110   [8]  {DATA}"


def decode_lines(tmp_path: Path, *lines: str) -> DecodedLog:
    path = tmp_path / "candump.txt"
    path.write_text("".join(f"{line}\n" for line in lines))
    log = decode_log(path, CLASSICAL)
    assert adds_up(log)
    return log


def stamps_of(log: DecodedLog) -> list[int]:
    stamps_ns: list[int] = log.messages["POSE"].stamps_ns.tolist()
    return stamps_ns


def test_a_screen_has_the_values_of_the_log_format(tmp_path: Path) -> None:
    log = decode_lines(tmp_path, f" (1436509052.249713)  {SCREEN}", f"(1436509052.249713) vcan0 110#{POSE}")
    pose = log.messages["POSE"]
    assert stamps_of(log) == [1436509052249713000] * 2
    assert all(len(set(values.tolist())) == 1 for values in pose.values.values())
    assert log.channels == {"vcan0": 2}


@pytest.mark.parametrize(
    "line",
    [
        f"  {SCREEN}",
        f"  vcan0       110   [8]  {DATA}",  # beside extended identifiers
        f"  vcan0  RX - -  110   [8]  {DATA}",  # -x
        f"  vcan0  TX B E  110   [8]  {DATA}",
        f"  {SCREEN}   '..\"3DUf.'",  # -a
        f"  {SCREEN}   '[8]  11 '",
        f" \x1b[1m\x1b[34m {SCREEN}\x1b[0m",  # -c
        f"  vcan0  110  [08]  {DATA}",  # FD
    ],
)
def test_every_form_of_a_screen_without_times_is_read_with_stamp_0_and_a_warning(tmp_path: Path, line: str) -> None:
    log = decode_lines(tmp_path, line, line)
    assert stamps_of(log) == [0, 0]
    assert log.refused == ()
    assert next(iter(summarize(log))) == "read as candump; stamps: none: this log has no times, every stamp is 0"


def test_fd_extended_remote_and_error_frames_of_a_screen_are_distinguished(tmp_path: Path) -> None:
    of = next(message for message in FD if message.length > 8)
    path = tmp_path / "candump.txt"
    path.write_text(
        f"  vcan0  {of.frame_id:03X}  [{of.length:02}]  {' '.join(['00'] * of.length)}\n"
        f"  vcan0  00000{of.frame_id:03X}  [{of.length:02}]  {' '.join(['00'] * of.length)}\n"
        "  vcan0  110   [0]  remote request\n"
        "  vcan0  20000004   [8]  00 04 00 00 00 00 00 00   ERRORFRAME\n"
        "\tcontroller-problem{rx-overflow}\n"
        "  vcan0  7FF   [0] \n"
    )
    log = decode_log(path, FD)
    assert len(log.messages[of.name]) == 1
    assert (log.foreign, log.remote, log.errors, log.comments, log.refused) == (2, 1, 1, 1, ())


def test_damaged_lines_of_a_screen_are_refused_with_their_number(tmp_path: Path) -> None:
    bad = [
        f"  vcan0  110   [7]  {DATA}",
        f"  vcan0  110   [8]  {DATA[:-1]}",
        f"  vcan0  110   [8]  {DATA.replace(' ', '`')}",  # candump -S: the other way round
        f"  vcan0  910   [8]  {DATA}",
        f"  vcan0  110   [9]  {DATA} 00",
        f"  (1.000000)  {SCREEN}",
        f"110   [8]  {DATA}",
    ]
    log = decode_lines(tmp_path, f"  {SCREEN}", *bad, f"  {SCREEN}")
    assert log.messages["POSE"].lines.tolist() == [1, 9]
    assert [refused.line for refused in log.refused] == list(range(2, 9))
    assert log.refused[0].why == "8 bytes: must be 7, as the line says"
    assert "stamp 1.000000: must be like the first of this log (none" in log.refused[5].why


@pytest.mark.parametrize("form", [" ({})  " + SCREEN, "({}) vcan0 110#" + POSE])
def test_differences_are_summed_also_over_other_frames_and_damaged_lines(tmp_path: Path, form: str) -> None:
    log = decode_lines(
        tmp_path,
        form.format("000.000000"),
        form.format("000.010000"),
        form.format("000.000500").replace("110", "7FF"),
        form.format("000.009500")[:-1],
        form.format("012.000000"),
        form.format("000.010000"),
    )
    assert stamps_of(log) == [0, 10_000_000, 12_020_000_000, 12_030_000_000]
    assert [refused.line for refused in log.refused] == [4]
    assert "lacks" not in log.refused[0].why
    assert "differences" in log.stamps


def test_a_lost_difference_is_reported(tmp_path: Path) -> None:
    form = " ({})  " + SCREEN
    log = decode_lines(
        tmp_path, *map(form.format, ["000.000000", "000.010000", "000.010000", "000.01"]), "000.010000)  vcan0", form
    )
    assert [refused.line for refused in log.refused] == [5, 6]
    assert all("every stamp after it lacks its difference" in refused.why for refused in log.refused)


@pytest.mark.parametrize("form", [" ({})  " + SCREEN, "({}) vcan0 110#" + POSE])
def test_times_since_the_first_frame_are_not_summed(tmp_path: Path, form: str) -> None:
    times = [f"{100 * i // 1000:03}.{100 * i % 1000:03}000" for i in range(30)]
    log = decode_lines(tmp_path, *map(form.format, times))
    assert stamps_of(log) == [i * 100_000_000 for i in range(30)]
    assert "since the first frame" in log.stamps


@pytest.mark.parametrize("form", [" ({})  " + SCREEN, "({}) vcan0 110#" + POSE])
def test_dates_are_taken_as_utc_and_impossible_ones_refused(tmp_path: Path, form: str) -> None:
    dates = ["2023-11-14 22:13:20.000000", "2023-11-14 22:13:20.123456", "2023-13-14 22:13:20.000000", "1.000000"]
    log = decode_lines(tmp_path, *map(form.format, dates))
    assert stamps_of(log) == [1_700_000_000_000_000_000, 1_700_000_000_123_456_000]
    assert [refused.line for refused in log.refused] == [3, 4]
    assert "taken as UTC" in log.stamps


def test_a_byte_order_mark_and_windows_line_ends_do_no_harm(tmp_path: Path) -> None:
    log = decode_lines(tmp_path, f"\ufeff(1.000000) vcan0 110#{POSE}\r", f"(2.000000) vcan0 110#{POSE}\r")
    assert stamps_of(log) == [10**9, 2 * 10**9]
    assert log.refused == ()

"""Every line of a candump log is read or accounted for."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vehicle_iface.errors import ConfigError
from vehicle_iface.logs import candump
from vehicle_iface.logs.candump_line import LineReader
from vehicle_iface.logs.columns import decode_log, scan_log
from vehicle_iface.logs.frames import Chunk
from vehicle_iface.logs.reading import open_candump
from vehicle_iface.logs.stamps import Stamps

from .conftest import CLASSICAL, POSE, REGULAR, Decode, adds_up


def test_regular_lines_of_every_shape_are_read(decode_text: Decode) -> None:
    log = decode_text(REGULAR.format(pose=POSE))
    pose = log.messages["POSE"]
    assert pose.lines.tolist() == [1, 3, 4, 5]
    assert pose.stamps_ns.tolist() == [1436509052249713000, 1436509052260000000, 1436509052270000000, 9000001000]
    assert pose.values["CRC"].tolist() == [0] * 4
    assert len(log.messages["MOTION"]) == 1
    assert (log.foreign, log.decoded, log.lines) == (2, 5, 7)
    assert log.refused == ()
    assert adds_up(log)


def test_lines_that_are_not_regular_are_understood_or_reported_with_their_number(decode_text: Decode) -> None:
    log = decode_text(
        f"(1.000000)  vcan0\t110#{POSE.lower()}\n"  # two blanks and a tab
        "\n"
        "(1.0) vcan0 110#00.11.22.33.44.55.66.AA\n"
        "(1.000000) vcan0 110#R\n"
        "(1.000000) vcan0 110#R8\n"
        "(1.000000) vcan0 20000088#0000000000000000\n"
        f"(1.000000) vcan0 110#{POSE}_9\n"
        f"(1.000000) vcan0 110#{POSE[:-1]}\n"
        f"(1.000000) vcan0 110#{POSE[:-2]}\n"
        f"(1.000000) vcan0 110#{POSE}00\n"
        f"(1.000000) vcan0 810#{POSE}\n"
        f"(x.000000) vcan0 110#{POSE}\n"
        f"1.000000 vcan0 110#{POSE}\n"
        f"(1.000000) vcan0 11G#{POSE}\n"
        f"(1.000000) vcan0 110#{POSE[:-2]}GG\n"
        f"(9999999999.000000) vcan0 110#{POSE}\n"
        f"(1.000000) vcan0 110##z{POSE}\n"
        f"(1.000000) vcan0 110#{POSE} X\n"
        "\x00\xff#  # \n"
        f"(1.000000) vcan0 110#{POSE}"  # no line end
    )
    assert log.messages["POSE"].lines.tolist() == [1, 3, 7, 20]
    assert set(log.messages["POSE"].stamps_ns.tolist()) == {10**9}
    assert (log.blank, log.remote, log.errors) == (1, 2, 1)
    assert [refused.line for refused in log.refused] == list(range(8, 20))
    assert "7 bytes: must be 8" in log.refused[1].why
    assert adds_up(log)


def test_windows_line_ends_and_an_empty_file_are_read(decode_text: Decode) -> None:
    log = decode_text(REGULAR.format(pose=POSE).replace("\n", "\r\n"))
    assert (log.decoded, log.lines, log.refused) == (5, 7, ())
    empty = decode_text("")
    assert (empty.lines, empty.decoded) == (0, 0)
    assert set(empty.messages) == {of.name for of in CLASSICAL}


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.log: cannot be read: No such file"):
        decode_log(tmp_path / "none.log", CLASSICAL)


HEX = st.text("0123456789ABCDEFabcdef", max_size=20)


@st.composite
def lines(draw: st.DrawFn) -> str:
    stamp = f"({draw(st.integers(0, 10**10))}.{draw(st.integers(0, 10**6 - 1)):06d})"
    can_id = draw(st.sampled_from(["110", "111", "7FF", "00000110", "20000004", "FFF", "1F", "9FFFFFFF"]))
    data = draw(HEX | st.sampled_from([POSE, POSE, POSE, "R", "R4", "", "##", "1122 R", "1122 T", POSE * 4]))
    channel = draw(st.sampled_from(["vcan0", "vcan0", "can0", "vcan1"]))
    mark = draw(st.sampled_from(["#", "#", "#", "##1", "##", "###"]))
    return draw(st.sampled_from([f"{stamp} {channel} {can_id}{mark}{data}"] * 9 + ["", "noise", f"{stamp} # {data}"]))


@settings(max_examples=150, deadline=None)
@given(st.lists(lines(), max_size=30), st.sampled_from([40, 200, 1 << 21]))
def test_the_fast_way_and_the_careful_way_agree_on_every_log(tmp_path_factory, text, size) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path_factory.mktemp("log") / "candump.log"
    path.write_text("\n".join(text))
    careful, reader = Chunk(), LineReader(Stamps.AS_LOGGED)
    slow = [reader.read(line.encode(), i, careful) for i, line in enumerate(text, start=1)]
    wanted = sorted(frame for frame in slow if frame is not None)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(candump, "CHUNK_BYTES", size)
        chunks = list(candump.read_candump(path))
    found = sorted(
        (line, stamp_ns, key, data.tobytes(), group.channel)
        for chunk in chunks
        for group in chunk.frames
        for line, stamp_ns, key, data in zip(
            group.lines.tolist(), group.stamps_ns.tolist(), group.keys.tolist(), group.data, strict=True
        )
    )
    assert found == wanted
    assert sum(chunk.remote for chunk in chunks) == careful.remote
    assert sum(chunk.errors for chunk in chunks) == careful.errors
    refused = [one.line for chunk in chunks for one in chunk.refused]
    assert refused == [one.line for one in careful.refused]
    assert sum(chunk.lines for chunk in chunks) == len(path.read_bytes().splitlines())


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=300))
def test_noise_is_counted_line_by_line(tmp_path_factory, noise) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path_factory.mktemp("noise") / "candump.log"
    path.write_bytes(noise)
    log = scan_log(open_candump(path), CLASSICAL)
    assert adds_up(log)
    assert log.lines == noise.replace(b"\r\n", b"\n").count(b"\n") + (not noise.endswith(b"\n") and bool(noise))


def test_a_long_log_comes_in_pieces_with_progress_and_nothing_is_lost_between_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candump, "CHUNK_BYTES", 1000)
    path = tmp_path / "candump.log"
    path.write_text("".join(f"({i}.000000) vcan0 110#{i:016X}\n" for i in range(500)) + "x" * 3000 + "\n")
    calls: list[tuple[int, int]] = []
    log = decode_log(path, CLASSICAL, progress=lambda done, total: calls.append((done, total)))
    assert log.messages["POSE"].stamps_ns.tolist() == [i * 10**9 for i in range(500)]
    assert [refused.line for refused in log.refused] == [501]
    assert len(calls) > 10
    assert calls == sorted(calls)
    assert calls[-1] == (path.stat().st_size, path.stat().st_size)

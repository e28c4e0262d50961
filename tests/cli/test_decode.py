"""`vehicle-iface decode` reads a log of any kind, or ends with status 2 and a way on."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vehicle_iface import cli

DBC = """VERSION ""
NS_ :
BS_:
BU_: ECU GW
BO_ 256 SPEED: 8 ECU
 SG_ V : 0|16@1+ (0.01,0) [0|655.35] "m/s" GW
"""
LOGS = {
    "screen.log": " (1700000000.000000)  can0  100   [8]  10 27 00 00 00 00 00 00\n",
    "vector.asc": "date Tue Nov 14 10:13:20.000 pm 2023\nbase hex  timestamps absolute\nno internal events logged\n"
    "   0.001000 1  100             Rx   d 8 10 27 00 00 00 00 00 00\n",
    "peak.trc": ";$FILEVERSION=1.1\n;$STARTTIME=45244.9\n;\n"
    "     1)         1.0  Rx         0100  8  10 27 00 00 00 00 00 00\n",
    "savvy.csv": "Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2,D3,D4,D5,D6,D7,D8\n"
    "973,00000100,false,Rx,0,8,10,27,00,00,00,00,00,00,\n",
    "dates.log": "(2023-11-14 22:13:20.000000) can0 100#1027000000000000\n",
    "bom.log": "\ufeff(1700000000.000000) can0 100#1027000000000000\n",
}
"""One frame each, as these programs write it."""


def decode(folder: Path, content: str, *options: str, name: str = "drive.log") -> int:
    """Exit status of `decode` for a log of this content; the arrays are in `out.npz` of the folder."""
    log, dbc = folder / name, folder / "bus.dbc"
    log.write_text(content, encoding="utf-8")
    dbc.write_text(DBC)
    return cli.main(["decode", str(log), "--dbc", str(dbc), "--out", str(folder / "out.npz"), *options])


@pytest.mark.parametrize("name", LOGS)
def test_the_log_of_every_program_gives_its_values(tmp_path: Path, name: str) -> None:
    assert decode(tmp_path, LOGS[name], name=name) == 0
    with np.load(tmp_path / "out.npz") as arrays:
        assert arrays["SPEED.V"].tolist() == [100.0]


def test_the_folder_of_a_recorded_drive_stands_for_its_frames(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, options = tmp_path / "drive1", ["--dbc", str(tmp_path / "bus.dbc"), "--out", str(tmp_path / "out.npz")]
    (tmp_path / "bus.dbc").write_text(DBC)
    drive.mkdir()
    assert cli.main(["decode", str(drive), *options]) == 2
    assert f"{drive}: is a folder without frames.log; name a log, or the folder that" in capsys.readouterr().err
    (drive / "frames.log").write_text("(1.000000) can0 100#1027000000000000\n")
    assert cli.main(["decode", str(drive), *options]) == 0
    with np.load(tmp_path / "out.npz") as arrays:
        assert arrays["SPEED.V"].tolist() == [100.0]


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        ("", "no frame in 0 lines"),
        ("one\ntwo\n", "no frame in 2 lines, read as candump; line 1: no frame: one. Logs that can be read: candump, "),
        ("MDF     4.10", "can_logconvert"),
        ("(1.000000) can0 7FF#00\n", "no values of SPEED of "),
        ("(1.000000) can0 100#00\n", "no values of SPEED of "),
        (
            "(1.000000) can0 100#1027000000000000\n(1.000000) can1 100#1027000000000000\n",
            "on 2 channels: can0 (1 frames), can1 (1 frames): choose one: --channel",
        ),
    ],
)
def test_a_log_without_values_ends_in_status_2_with_a_way_on_and_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, complaint: str
) -> None:
    assert decode(tmp_path, content) == 2
    assert complaint in capsys.readouterr().err
    assert not (tmp_path / "out.npz").exists()


def test_a_channel_is_chosen_and_the_rest_counted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = "(1.000000) can0 100#1027000000000000\n(2.000000) can1 100#2027000000000000\nnoise\n"
    assert decode(tmp_path, two, "--channel", "can1") == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [
        "read as candump; stamps: as logged",
        "SPEED: 1 frames",
        "3 lines, 1 decoded, 1 of other channels, 1 refused",
    ]
    assert "drive.log:3: no frame: noise" in said.err
    with np.load(tmp_path / "out.npz") as arrays:
        assert arrays["SPEED:stamp_ns"].tolist() == [2 * 10**9]
    assert decode(tmp_path, two, "--channel", "can2") == 2
    assert "--channel can2: must be one of" in capsys.readouterr().err


def test_python_can_is_not_imported_for_logs_of_candump(tmp_path: Path) -> None:
    log = tmp_path / "drive.log"
    log.write_text(LOGS["screen.log"])
    program = (
        "import sys; from pathlib import Path; from vehicle_iface.logs.columns import decode_log\n"
        f"decode_log(Path({str(log)!r}), []); sys.exit('can' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)

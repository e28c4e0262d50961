"""Texts of candump logs, and a way to decode them."""

from pathlib import Path
from typing import Protocol

import cantools
import pytest
from cantools.database import Message
from cantools.database.can import Database

from vehicle_iface.logs.columns import DecodedLog, scan_log
from vehicle_iface.logs.reading import open_candump

DBC_FOLDER = Path(__file__).parents[2] / "dbc"


def loaded(name: str) -> list[Message]:
    database = cantools.database.load_file(DBC_FOLDER / f"{name}.dbc", strict=True)
    assert isinstance(database, Database)
    return database.messages


CLASSICAL, FD = loaded("reference"), loaded("reference_fd")
REGULAR = """\
(1436509052.249713) vcan0 110#{pose}
(1436509052.250001) vcan0 111#0102030405060708
(1436509052.260000000) can1 110#{pose} R
(1436509052.270000) vcan0 110##1{pose}
(9.000001) vcan0 110##0{pose} T
(1436509053.000000) vcan0 00000110#{pose}
(1436509053.000000) vcan0 7FF#
"""
POSE = "00112233445566AA"


class Decode(Protocol):
    """Decodes a text as a log of some messages."""

    def __call__(self, text: str | bytes, of: list[Message] = ...) -> DecodedLog: ...


def adds_up(log: DecodedLog) -> bool:
    """Whether each line is counted once."""
    parts = (log.decoded, log.foreign, log.other_channels, log.remote, log.errors, log.blank, log.comments)
    return sum(parts) + len(log.refused) == log.lines


@pytest.fixture
def decode_text(tmp_path: Path) -> Decode:
    """Decode a text as a log of the reference vehicle's messages."""

    def decode(text: str | bytes, of: list[Message] = CLASSICAL) -> DecodedLog:
        path = tmp_path / "candump.log"
        path.write_bytes(text.encode() if isinstance(text, str) else text)
        return scan_log(open_candump(path), of)

    return decode

"""Another process that plays a log back on vcan0: `player.py FILE [TIMES]`; a line is `seconds identifier data`."""

import sys
import time
from pathlib import Path

from vehicle_bus_contract.reference import Frame
from vehicle_bus_contract.socketcan import open_socket, send

from tests.vcan.observer import CHANNEL

LATE_S = 0.002
"""A frame may be so late before it delays those behind it: sleeping and sending are never exact."""


def main(file: str, times: str = "1") -> None:
    """Each frame at its time, from the first on, and end; a late frame delays those behind it.

    So no two samples arrive closer to each other than in the log: of two that arrive at once the loop answers only
    the newer.
    """
    lines = [line.split() for line in Path(file).read_text().splitlines()]
    log = [(float(at_s), Frame(0, int(can_id, 16), bytes.fromhex(data))) for at_s, can_id, data in lines]
    with open_socket(CHANNEL, can_ids=()) as raw:
        for _ in range(int(times)):
            begin_s = time.monotonic() - log[0][0]
            for at_s, frame in log:
                time.sleep(max(0.0, begin_s + at_s - time.monotonic()))
                send(raw, frame)
                begin_s = max(begin_s, time.monotonic() - at_s - LATE_S)


if __name__ == "__main__":
    main(*sys.argv[1:])

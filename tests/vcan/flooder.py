"""Another process that floods vcan0: `flooder.py COUNT RATE_HZ CAN_ID…`, identifiers in hexadecimal, in turn.

Eight bytes of garbage each, the same in every run, and never with the checksum that the contract wants.
"""

import random
import sys
import time

from vehicle_bus_contract.reference import Frame, intact
from vehicle_bus_contract.socketcan import open_socket, send

from tests.vcan.observer import CHANNEL

BURST_S = 0.01


def main(count: str, rate_hz: str, *can_ids: str) -> None:
    """Send, and end; frames that the queue refuses are gone."""
    dice = random.Random(0)
    numbers = [int(can_id, 16) for can_id in can_ids]
    frames = [garbage(dice, numbers[i % len(numbers)]) for i in range(int(count))]
    burst = max(1, round(float(rate_hz) * BURST_S))
    begin_s = time.monotonic()
    with open_socket(CHANNEL, can_ids=()) as raw:
        for i in range(0, len(frames), burst):
            for frame in frames[i : i + burst]:
                send(raw, frame)
            time.sleep(max(0.0, begin_s + (i / burst + 1) * BURST_S - time.monotonic()))
    print(f"sent {len(frames) / (time.monotonic() - begin_s):.0f} frames/s")


def garbage(dice: random.Random, can_id: int) -> Frame:
    """A frame whose checksum is wrong."""
    while intact(frame := Frame(0, can_id, dice.randbytes(8))):
        pass
    return frame


if __name__ == "__main__":
    main(*sys.argv[1:])

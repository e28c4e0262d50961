"""Fills a CAN interface with unknown frames: `python load.py CHANNEL FRAMES_PER_SECOND FIRST_ID`, until SIGTERM.

It also ends when its parent ends.
"""

import os
import socket
import struct
import sys
import time

PERIOD_S = 0.005
IDS = 0x100


def main() -> None:
    channel, per_second, first_id = sys.argv[1], float(sys.argv[2]), int(sys.argv[3], 16)
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, b"")
    raw.bind((channel,))
    parent, begin, sent = os.getppid(), time.monotonic(), 0
    while os.getppid() == parent:
        due = round((time.monotonic() - begin) * per_second)
        for number in range(sent, min(due, sent + 200)):
            try:
                raw.send(struct.pack("=IB3xQ", first_id + number % IDS, 8, number))
            except OSError:
                break  # a full queue is a full bus
        sent = due
        time.sleep(PERIOD_S)


if __name__ == "__main__":
    main()

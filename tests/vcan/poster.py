"""Another process that posts trajectories: `poster.py FILE empty`, `FILE line LENGTH_M LAST_S [TIMES]`.

A line runs along +x from the origin at 3 m/s; its last point is due after LAST_S. TIMES are posted at 10 Hz.
`FILE bad` posts, five a second, what must not be driven, each named when it is posted; `FILE long` nearly as many
points as may be, on a line of 300 m; `FILE far` a line that goes on for 10¹² m; `FILE route NAME` the next seconds of
a route at 10 Hz, from where the vehicle on vcan0 is.
"""

import struct
import sys
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from vehicle_bus_contract.reference import NAMES, DecodedFrame, intact
from vehicle_bus_contract.socketcan import open_socket, receive_frames

from tests.vcan.observer import CHANNEL
from vehicle_iface import VehicleState, clock
from vehicle_iface.trajectories import RecedingRoute, make_route
from vehicle_iface.trajectories.mailbox import publish_trajectory
from vehicle_iface.trajectory import Trajectory

POINTS, MILLION_BYTES = 40, 64_000_000
BAD: dict[str, dict[str, tuple[int | slice, float]]] = {
    "no number in x": {"x_m": (7, np.nan)},
    "an infinite speed": {"speed_mps": (7, np.inf)},
    "time that goes back": {"time_from_start_ns": (7, 0)},
    "too fast": {"speed_mps": (7, 20.5)},
    "too far turned wheels": {"front_wheel_angle_rad": (7, -0.61)},
    "a corner": {"y_m": (slice(20, None), 3.0)},
    "a step back": {"x_m": (20, 9.495)},
}
"""What is wrong with a line of 40 points: where, and what stands there."""


def main(file: str, kind: str, length_m: str = "0", last_s: str = "0", times: str = "1") -> None:
    """Post, and end."""
    if kind == "bad":
        for name, content in bad_posts():
            print(f"posts {name}", flush=True)
            put(file, content, MILLION_BYTES if name == "a million points" else 0)
            time.sleep(0.2)
        return
    if kind == "route":
        follow(file, length_m)
        return
    if kind == "empty":
        publish_trajectory(file, Trajectory.empty(stamp_ns=clock.monotonic_ns()))
        return
    spacing_m = 0.016 if kind == "long" else 0.5
    length_m, last_s = ("300", "100") if kind in ("long", "far") else (length_m, last_s)
    x_m = np.arange(0.0, float(length_m), spacing_m)
    if kind == "far":
        x_m = np.append(np.arange(0.0, 300.0, 0.5), 1e12)
    zeros = np.zeros_like(x_m)
    for left in range(int(times), 0, -1):
        publish_trajectory(
            file,
            Trajectory(
                stamp_ns=clock.monotonic_ns(),
                time_from_start_ns=np.linspace(0.0, float(last_s) * 1e9, len(x_m)).astype(np.int64),
                x_m=x_m,
                y_m=zeros,
                heading_rad=zeros,
                speed_mps=zeros + 3.0,
            ),
        )
        if left > 1:
            time.sleep(0.1)


def put(file: str, content: bytes, size: int = 0) -> None:
    """Write any bytes at once, as `publish_trajectory` does, and a hole behind them up to this size."""
    fresh = Path(file).with_suffix(".fresh")
    with fresh.open("wb") as out:
        out.write(content)
        out.truncate(max(len(content), size))
    fresh.replace(file)


def bad_posts() -> Iterator[tuple[str, bytes]]:
    """Name and bytes of each; written here, since `publish_trajectory` takes trajectories, and none of these is one."""
    for name, changes in BAD.items():
        columns = line_columns()
        for column, (where, value) in changes.items():
            columns[column][where] = value
        yield name, packed(columns)
    columns = line_columns()
    yield "columns of another length", packed(columns | {"y_m": columns["y_m"][:-1]})
    yield "columns of another type", packed({name: values.astype(np.float32) for name, values in columns.items()})
    yield "what the controller does not want", packed(line_columns(7))
    yield "what the controller cannot handle", packed(line_columns(8))
    whole = packed(line_columns())
    yield "one bit more", whole[:-1] + bytes((whole[-1] ^ 1,))
    yield "half of it", whole[: len(whole) // 2]
    yield "a million points", whole


def line_columns(points: int = POINTS) -> dict[str, np.ndarray]:
    """A line along +x at 3 m/s, in the order of a post's columns."""
    columns = {"time_from_start_ns": np.arange(points) * 10**9, "x_m": np.arange(points) * 0.5}
    columns |= {name: np.zeros(points) for name in ("y_m", "heading_rad")} | {"speed_mps": np.full(points, 3.0)}
    return columns | {name: np.zeros(points) for name in ("accel_mps2", "yaw_rate_radps", "front_wheel_angle_rad")}


def packed(columns: dict[str, np.ndarray]) -> bytes:
    """A post's bytes: magic, CRC-32; then stamp, points, length of the frame's name, that name, the columns."""
    points = len(columns["time_from_start_ns"])
    body = struct.pack("@qII", clock.monotonic_ns(), points, 3) + b"map"
    body += b"".join(values.tobytes() for values in columns.values())
    return struct.pack("@8sI4x", b"VITRAJ01", zlib.crc32(body)) + body


def follow(file: str, name: str) -> None:
    """Post the next seconds of a route, from the vehicle's position, until the process is ended."""
    route = RecedingRoute(make_route(name))
    newest: dict[str, DecodedFrame] = {}
    with open_socket(CHANNEL, can_ids=NAMES) as raw:
        while True:
            newest |= {decoded.name: decoded for frame in receive_frames(raw) if (decoded := intact(frame))}
            if {"POSE", "MOTION"} <= newest.keys():
                pose, motion, now_ns = newest["POSE"], newest["MOTION"], clock.monotonic_ns()
                state = VehicleState(
                    stamp_ns=now_ns,
                    x_m=pose["POS_X"],
                    y_m=pose["POS_Y"],
                    heading_rad=motion["HEADING"],
                    speed_mps=motion["SPEED"],
                )
                trajectory = route.next(now_ns, state)
                if trajectory is not None:
                    publish_trajectory(file, trajectory)
            time.sleep(0.01)


if __name__ == "__main__":
    main(*sys.argv[1:])

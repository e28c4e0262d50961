"""The contestants of the `reaction` benchmark: each hears a state sample and answers it with a command pair.

All are given an open socket or channel and one method, `step`: hear what comes until one sample is answered. All
make and check the end-to-end CRC with the same C function. As processes: `python -m
benchmarks.parts.reaction_contestants NAME CHANNEL`.
"""

import math
import queue
import signal
import socket
import struct
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, Protocol

import can
import cantools
import numpy as np
from e2e.p01 import e2e_p01_check, e2e_p01_protect

from benchmarks.parts.reaction_vehicle import CAN_FRAME, SPEED_MPS, Course, can_frame, figure_of_eight
from vehicle_iface import PurePursuit, PurePursuitConfig, VehicleState
from vehicle_iface.control.base import ControllerBase
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime import realtime

DRIVE_COMMAND, STEER_COMMAND = 0x080, 0x081
VEHICLE_STATUS, POSE, MOTION, CHASSIS = 0x100, 0x110, 0x111, 0x112
HEARD = (VEHICLE_STATUS, POSE, MOTION, CHASSIS)
COUNTERS, AUTONOMOUS, NO_REQUEST = 15, 2, 7
WHEELBASE_M = 2.7
PERIOD_S = 0.01


class Contestant(Protocol):
    """Answers samples."""

    def step(self) -> None:
        """Hear until one sample is answered."""
        ...


class Echo:
    """(e) Frames in, fixed frames out: what the kernel and Python's socket calls cost by themselves."""

    def __init__(self, raw: socket.socket, _: Course) -> None:
        self._raw = raw
        self._answers = [can_frame(can_id, bytes(8)) for can_id in (DRIVE_COMMAND, STEER_COMMAND)]
        self._last = CHASSIS.to_bytes(4, sys.byteorder)

    def step(self) -> None:
        raw = self._raw
        while raw.recv(72)[:4] != self._last:
            pass
        for answer in self._answers:
            raw.send(answer)


class Bare:
    """(a) A bare socket loop: hand-packed bytes and the same controller, called directly; no gate, no telemetry."""

    _POSE, _MOTION, _CHASSIS = struct.Struct("<2x3s3s"), struct.Struct("<2xhhh"), struct.Struct("<2xhhh")
    _DRIVE, _STEER = struct.Struct("<BBhhBB"), struct.Struct("<BBhhh")

    def __init__(self, raw: socket.socket, course: Course) -> None:
        self._raw = raw
        self._trajectory = course.trajectory()
        self._controller: ControllerBase = PurePursuit(PurePursuitConfig(wheelbase_m=WHEELBASE_M))
        self._mode = -1
        self._pose = self._motion = (-1, 0.0, 0.0, 0.0)
        self._stamp_ns = 0
        self._counter = 0

    def step(self) -> None:
        recv = self._raw.recv
        while True:
            can_id, _, data = CAN_FRAME.unpack(recv(72))
            if not e2e_p01_check(bytearray(data), can_id):
                continue
            counter = data[1] & 0xF
            if can_id == POSE:
                x, y = self._POSE.unpack(data)
                x_m = int.from_bytes(x, "little", signed=True) * 0.005
                y_m = int.from_bytes(y, "little", signed=True) * 0.005
                self._pose = counter, x_m, y_m, 0.0
                self._stamp_ns = time.monotonic_ns()
            elif can_id == MOTION:
                heading, speed, yaw_rate = self._MOTION.unpack(data)
                self._motion = counter, heading * 0.0001, speed * 0.005, yaw_rate * 0.0002
            elif can_id == CHASSIS and self._pose[0] == counter == self._motion[0]:
                self._answer(*self._CHASSIS.unpack(data))
                return
            elif can_id == VEHICLE_STATUS:
                self._see_mode(data[2] & 7)

    def _see_mode(self, mode: int) -> None:
        """The trajectory begins when the vehicle drives off."""
        if mode == AUTONOMOUS != self._mode:
            self._controller.set_trajectory(replace(self._trajectory, stamp_ns=time.monotonic_ns()))
        self._mode = mode

    def _answer(self, accel: int, lateral_speed: int, front_wheel_angle: int) -> None:
        _, x_m, y_m, _ = self._pose
        _, heading_rad, speed_mps, yaw_rate_radps = self._motion
        state = VehicleState(
            stamp_ns=self._stamp_ns,
            frame_id="map",
            x_m=x_m,
            y_m=y_m,
            heading_rad=heading_rad,
            speed_mps=speed_mps,
            accel_mps2=accel * 0.001,
            yaw_rate_radps=yaw_rate_radps,
            lateral_speed_mps=lateral_speed * 0.001,
            front_wheel_angle_rad=front_wheel_angle * 0.0001,
        )
        command = self._controller.compute_command(state)
        self._counter = counter = (self._counter + 1) % COUNTERS
        head = counter | 0x10  # ENABLE
        accel = round(min(max(command.accel_mps2, -6.0), 3.0) * 1000.0)
        front = round(min(max(command.front_wheel_angle_rad, -0.6), 0.6) * 10000.0)
        drive = bytearray(
            self._DRIVE.pack(0, head, accel, round(command.speed_mps * 200.0), command.reason, NO_REQUEST)
        )
        steer = bytearray(self._STEER.pack(0, head, front, 0, 0))
        e2e_p01_protect(drive, DRIVE_COMMAND, increment_counter=False)
        e2e_p01_protect(steer, STEER_COMMAND, increment_counter=False)
        self._raw.send(CAN_FRAME.pack(DRIVE_COMMAND, 8, drive))
        self._raw.send(CAN_FRAME.pack(STEER_COMMAND, 8, steer))


class Robotics:
    """A pure pursuit in the manner of PythonRobotics: the nearest point is looked for on the whole course."""

    def __init__(self, course: Course, *, searches_all: bool = True) -> None:
        self.cx, self.cy = course.x_m, course.y_m
        self.searches_all = searches_all
        self.old_nearest_point_index: int | None = None

    def control(self, x: float, y: float, yaw: float, v: float) -> tuple[float, float]:
        """Acceleration and wheel angle."""
        ind, lf = self.search_target_index(x, y, v)
        alpha = math.atan2(self.cy[ind] - y, self.cx[ind] - x) - yaw
        delta = math.atan2(2.0 * WHEELBASE_M * math.sin(alpha) / lf, 1.0)
        return 1.0 * (SPEED_MPS - v), delta

    def search_target_index(self, x: float, y: float, v: float) -> tuple[int, float]:
        if self.searches_all or self.old_nearest_point_index is None:
            dx = [x - icx for icx in self.cx]
            dy = [y - icy for icy in self.cy]
            ind = int(np.argmin(np.hypot(dx, dy)))
        else:
            ind = self.old_nearest_point_index
            distance_this_index = math.hypot(self.cx[ind] - x, self.cy[ind] - y)
            while True:
                after = (ind + 1) % len(self.cx)
                distance_next_index = math.hypot(self.cx[after] - x, self.cy[after] - y)
                if distance_this_index < distance_next_index:
                    break
                ind, distance_this_index = after, distance_next_index
        self.old_nearest_point_index = ind
        lf = 0.1 * v + 2.0
        for _ in range(len(self.cx)):
            if lf <= math.hypot(self.cx[ind] - x, self.cy[ind] - y):
                break
            ind = (ind + 1) % len(self.cx)
        return ind, lf


class PythonCan:
    """(c) python-can's `Bus.recv` and cantools in a loop."""

    def __init__(self, bus: can.BusABC, course: Course, *, searches_all: bool = True) -> None:
        self.bus = bus
        self.db: Any = cantools.database.load_file(load_profile("reference").dbc)
        self.controller = Robotics(course, searches_all=searches_all)
        self.state: dict[int, dict[str, Any]] = {}
        self.counter = 0

    def step(self) -> None:
        while True:
            message = self.bus.recv()
            if message is not None and self.note(message) and self.is_whole():
                self.answer()
                return

    def note(self, message: can.Message) -> bool:
        """Decode one message; whether it was the last one of a sample."""
        if not e2e_p01_check(bytearray(message.data), message.arbitration_id):
            return False
        self.state[message.arbitration_id] = self.db.decode_message(message.arbitration_id, message.data)
        return message.arbitration_id == CHASSIS

    def is_whole(self) -> bool:
        """Whether the newest frames belong together."""
        return len({self.state.get(can_id, {}).get("COUNTER") for can_id in (POSE, MOTION, CHASSIS)}) == 1

    def answer(self) -> None:
        """Compute, encode, send."""
        pose, motion = self.state[POSE], self.state[MOTION]
        accel, delta = self.controller.control(pose["POS_X"], pose["POS_Y"], motion["HEADING"], motion["SPEED"])
        self.counter = (self.counter + 1) % COUNTERS
        self.send(
            "DRIVE_COMMAND",
            ENABLE=1,
            SAFE_STOP=0,
            ACCEL_REQUEST=min(max(accel, -6.0), 3.0),
            SPEED_REQUEST=SPEED_MPS,
            REASON="NOMINAL",
            GEAR_REQUEST="NO_REQUEST",
        )
        self.send(
            "STEER_COMMAND",
            ENABLE=1,
            FRONT_WHEEL_ANGLE_REQUEST=min(max(delta, -0.6), 0.6),
            REAR_WHEEL_ANGLE_REQUEST=0.0,
        )

    def send(self, name: str, **signals: object) -> None:
        """One message with its counter and CRC."""
        message = self.db.get_message_by_name(name)
        data = bytearray(message.encode({"CRC": 0, "COUNTER": self.counter, **signals}))
        e2e_p01_protect(data, message.frame_id, increment_counter=False)
        self.bus.send(can.Message(arbitration_id=message.frame_id, data=data, is_extended_id=False))


class Timed(PythonCan):
    """(d) python-can's `Notifier` thread puts messages into a queue; a timer of 10 ms takes them out and answers."""

    def __init__(self, bus: can.BusABC, course: Course) -> None:
        super().__init__(bus, course)
        self.messages: queue.Queue[can.Message] = queue.Queue()
        self.notifier = can.Notifier(bus, [self.messages.put])
        self.next_s = time.time()

    def step(self) -> None:
        """One turn of the timer: the newest sample is answered, if there is one."""
        self.next_s += PERIOD_S
        time.sleep(max(0.0, self.next_s - time.time()))
        is_new = False
        while not self.messages.empty():
            is_new = self.note(self.messages.get()) or is_new
        if is_new and self.is_whole():
            self.answer()


def raw_socket(channel: str) -> socket.socket:
    """A socket on an interface that hears the vehicle's messages only."""
    raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    filters = b"".join(struct.pack("=II", can_id, 0x7FF) for can_id in HEARD)
    raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
    raw.bind((channel,))
    return raw


def python_can_bus(channel: str) -> can.BusABC:
    """The usual way to open it."""
    wanted: Iterable[Any] = [{"can_id": can_id, "can_mask": 0x7FF, "extended": False} for can_id in HEARD]
    return can.Bus(channel=channel, interface="socketcan", can_filters=list(wanted))


PROCESSES: dict[str, Callable[[str, Course], Contestant]] = {
    "echo": lambda channel, course: Echo(raw_socket(channel), course),
    "bare": lambda channel, course: Bare(raw_socket(channel), course),
    "python-can": lambda channel, course: PythonCan(python_can_bus(channel), course),
    "notifier": lambda channel, course: Timed(python_can_bus(channel), course),
}


def main() -> None:
    """Answer until told to end."""
    name, channel, ready = sys.argv[1:]
    contestant = PROCESSES[name](channel, figure_of_eight())
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    realtime.apply_settings()  # for all alike: what is compared is the program, not the scheduler
    Path(ready).touch()
    while True:
        contestant.step()


if __name__ == "__main__":
    main()

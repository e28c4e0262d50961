#!/usr/bin/env python3
"""A second controller for the reference vehicle's bus, made from raw sockets and the standard library.

It was written from the bus contract alone and shares no code with the program or its tools, so that the bench is tested
with an independent controller. It is correct; `--defect` breaks it in one place (see `defects`).

Exit status: 0 done, 2 bad usage or route, 3 the bus cannot be used, 4 ended in a latched fault.
"""

import argparse
import errno
import math
import os
import select
import signal
import socket
import struct
import sys
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import pairwise
from pathlib import Path

from defects import DEFECTS
from minimal_recorder import Recorder
from minimal_route import FRAMES, Route, read_route
from minimal_view import View

MS = 1_000_000
CAN_RAW_ERR_FILTER, CAN_ERR_BUSOFF = 2, 0x40
DRIVE_COMMAND, STEER_COMMAND, BODY_COMMAND, CONTROLLER_STATUS = 0x080, 0x081, 0x082, 0x180
VEHICLE_STATUS, POSE, MOTION, CHASSIS = 0x100, 0x110, 0x111, 0x112
OURS = (DRIVE_COMMAND, STEER_COMMAND, BODY_COMMAND, CONTROLLER_STATUS)
SAMPLE = (POSE, MOTION, CHASSIS)
RECEIVED = (VEHICLE_STATUS, *SAMPLE, *OURS)
MANUAL, READY, AUTONOMOUS, FAULT, EMERGENCY_STOP = range(5)
REVERSE, DRIVE, NO_REQUEST = 1, 3, 7
Reason = IntEnum(
    "Reason",
    "NOMINAL NO_TRAJECTORY EMPTY_TRAJECTORY PAST_END_SPACE PAST_END_TIME FRAME_MISMATCH STATE_STALE STATE_INVALID"
    " CONTROLLER_ERROR DEVIATION DRIVER_OVERRIDE VEHICLE_NOT_AUTONOMOUS VEHICLE_FAULT LINK_DOWN DUPLICATE_COMMANDER"
    " SHUTDOWN DEADLINE_MISSED NOT_ENGAGED",
    start=0,
)

WHEELBASE_M = 2.7
WHEEL_RAD, WHEEL_RADPS, WHEEL_ENGAGING_RADPS, WHEEL_APART_RAD = 0.6, 0.8, 0.3, 0.3
WHEEL_BY_SPEED = ((0.0, 0.6), (5.0, 0.6), (10.0, 0.2), (20.0, 0.05))
LATERAL_MPS2, LATERAL_MPS3 = 3.0, 5.0
ACCEL_MPS2, ACCEL_ENGAGING_MPS2, BRAKE_MPS2, ACCEL_MPS3 = 3.0, 1.0, 6.0, 30.0
SPEED_MPS, GEAR_CHANGE_MPS, STOP_MPS2, DRIVER_NM = 20.0, 0.5, 3.0, 3.0
OFF_PATH_M, OFF_HEADING_RAD, OVERSPEED_MPS, ROLLBACK_MPS = 3.0, 0.8, 1.0, 0.5
CLEAN_PAIRS = 50  # in a row, after three that found no room
STANDING_MPS, CREEP_MPS = 0.01, 0.3
AHEAD_S = 0.4  # the speed is led to that of the point which is reached by then
APART_MPS, APART_NS, CONTRADICTIONS = 0.4, 1000 * MS, 15
HOLD_NS = {Reason.STATE_STALE: 200 * MS, Reason.STATE_INVALID: 500 * MS, Reason.FRAME_MISMATCH: 500 * MS}

PERIOD_NS, SLOW_PERIOD_NS = 10 * MS, 100 * MS
STALE_NS, SILENT_NS, ANSWER_AGE_NS, STATUS_STALE_NS = 50 * MS, 500 * MS, 100 * MS, 100 * MS
FRESH_NS, GIVE_UP_NS, SHUTDOWN_NS, REOPEN_NS, QUEUE_FULL_NS = 500 * MS, 3000 * MS, 10_000 * MS, 100 * MS, 100 * MS


def _divided(byte: int) -> int:
    for _ in range(8):
        byte = (byte << 1 ^ 0x11D) if byte & 0x80 else byte << 1
    return byte


_CRC = bytes(map(_divided, range(256)))


def crc8(can_id: int, data: bytes) -> int:
    """Compute the CRC with polynomial 0x1D over the data id, low byte first, and everything after the CRC."""
    rest = _CRC[_CRC[can_id & 0xFF] ^ can_id >> 8]
    for byte in data[1:]:
        rest = _CRC[rest ^ byte]
    return rest


@dataclass(frozen=True, slots=True)
class State:
    """One sample of the vehicle in SI units."""

    stamp_ns: int
    counter: int
    frame: int
    is_valid: bool
    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    yaw_rate_radps: float
    wheel_rad: float


@dataclass(frozen=True, slots=True)
class Status:
    """The content of VEHICLE_STATUS."""

    mode: int
    gear: int
    driver_acts: bool


def ready(raw: socket.socket | None, event: int, within_s: float) -> bool:
    """Whether the socket is ready. It uses `poll`, because `select` supports no descriptor above 1023."""
    poll = select.poll()
    if raw is not None:
        poll.register(raw, event)
    return bool(poll.poll(max(0.0, within_s * 1e3)))


class Bus:
    """A raw socket that receives the identifiers of the contract, without its own frames."""

    def __init__(self, channel: str) -> None:
        """Raises `OSError` when there is no such interface, or it is down."""
        self.raw = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        try:
            exactly = socket.CAN_SFF_MASK | socket.CAN_EFF_FLAG | socket.CAN_RTR_FLAG
            filters = b"".join(struct.pack("=II", can_id, exactly) for can_id in RECEIVED)
            self.raw.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FILTER, filters)
            self.raw.setsockopt(socket.SOL_CAN_RAW, CAN_RAW_ERR_FILTER, struct.pack("=I", CAN_ERR_BUSOFF))
            self.raw.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 0)  # the least there is: nothing old may wait
            self.raw.setblocking(False)
            self.raw.bind((channel,))
            pending = self.raw.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
            if pending:
                raise OSError(pending, os.strerror(pending))
        except OSError:
            self.raw.close()
            raise

    def received(self) -> list[tuple[int, bytes]]:
        """Return all queued data frames; raises `OSError` when the link is or was down, or is bus off."""
        frames = []
        for _ in range(1000):
            try:
                packet = self.raw.recv(72)
            except BlockingIOError:
                break
            word, length = struct.unpack_from("=IB", packet)
            if word & socket.CAN_ERR_FLAG:
                raise OSError("bus off")
            if len(packet) == 16 and length == 8 and word <= socket.CAN_SFF_MASK:
                frames.append((word, packet[8:]))
        return frames

    def has_room(self) -> bool:
        """Whether the socket has sent nearly all earlier frames."""
        return ready(self.raw, select.POLLOUT, 0.0)

    def send(self, can_id: int, data: bytes) -> bool:
        """Send a frame; return false if there was no room."""
        try:
            self.raw.send(struct.pack("=IB3x", can_id, len(data)) + data)
        except BlockingIOError:
            return False
        except OSError as error:
            if error.errno != errno.ENOBUFS:
                raise
            return False
        return True


class Receiver:
    """Turns frames into whole samples and statuses. It checks CRC, counters and values, then physical plausibility."""

    def __init__(self, defect: str) -> None:
        self.checks_crc = defect != "crc_unchecked"
        self._counters: dict[int, int] = {}
        self._damaged = {can_id: deque[bool](maxlen=16) for can_id in RECEIVED}
        self._parts: dict[int, tuple[int, dict[int, bytes]]] = {}
        self._last: State | None = None
        self._still_m = 0.0
        self._places: deque[State] = deque()
        self.doubts = 0
        """Samples in a row that cannot be true."""

    def is_whole(self, can_id: int, data: bytes) -> bool:
        """Whether the CRC is right, the counter is 1 to 3 steps on, and most recent frames of the message were
        undamaged."""
        damaged = self._damaged[can_id]
        damaged.append(self.checks_crc and data[0] != crc8(can_id, data))
        counter = data[1] & 0xF
        if damaged[-1] or counter > 14:
            return False
        before = self._counters.get(can_id)
        self._counters[can_id] = counter
        return (before is None or 1 <= (counter - before) % 15 <= 3) and sum(damaged) <= 8

    def status(self, data: bytes) -> Status | None:
        """Decode the status; None when a value is impossible."""
        gear, mode = data[1] >> 4 & 7, data[2] & 7
        torque_nm, rear_raw = struct.unpack_from("<bh", data, 3)
        if gear > 3 or mode > EMERGENCY_STOP or abs(rear_raw) > 10_000:
            return None
        if data[6] and mode != EMERGENCY_STOP:
            mode = FAULT  # a fault code is a fault, whatever the mode says
        acts = bool(data[1] & 0x80 or data[2] & 0x08) or abs(torque_nm) * 0.1 >= DRIVER_NM - 1e-9
        return Status(mode, gear, acts)

    def sample(self, can_id: int, data: bytes, now_ns: int) -> State | None:
        """Return the sample that this part completes, or None."""
        if not _is_possible(can_id, data):
            return None
        counter = data[1] & 0xF
        first_ns, parts = self._parts.get(counter, (now_ns, {}))
        if now_ns - first_ns > STALE_NS:
            first_ns, parts = now_ns, {}
        parts[can_id] = data
        self._parts[counter] = first_ns, parts
        if len(parts) < len(SAMPLE):
            return None
        self._parts = {c: (at_ns, p) for c, (at_ns, p) in self._parts.items() if c != counter and at_ns >= first_ns}
        pose, (heading, speed, yaw) = parts[POSE], struct.unpack_from("<hhh", parts[MOTION], 2)
        return State(
            stamp_ns=now_ns,
            counter=counter,
            frame=pose[1] >> 4 & 3,
            is_valid=bool(pose[1] & 0x40),
            x_m=int.from_bytes(pose[2:5], "little", signed=True) * 0.005,
            y_m=int.from_bytes(pose[5:8], "little", signed=True) * 0.005,
            heading_rad=heading * 0.0001,
            speed_mps=speed * 0.005,
            yaw_rate_radps=yaw * 0.0002,
            wheel_rad=struct.unpack_from("<h", parts[CHASSIS], 6)[0] * 0.0001,
        )

    def is_plausible(self, state: State) -> bool:
        """Whether the sample is plausible after the last plausible one."""
        last, dt_s = self._last, 0.01
        if last is not None:
            dt_s = max((state.stamp_ns - last.stamp_ns) / 1e9, (state.counter - last.counter) % 15 * 0.01)
        if abs(state.speed_mps) > 40.0 or abs(state.yaw_rate_radps) > 3.0 or self._contradicts(state, last, dt_s):
            self.doubts += 1
            self._places.clear()
            return False
        self._last, self.doubts = state, 0
        return True

    def forget(self) -> None:
        """Forget the last sample: the next one is not compared with it."""
        self._last, self._still_m = None, 0.0
        self._places.clear()

    def is_speed_wrong(self, state: State) -> bool:
        """Whether the way along its heading in the last second, in one frame, is not that of its speeds."""
        if not state.is_valid or (self._places and self._places[-1].frame != state.frame):
            self._places.clear()
        self._places.append(state)
        while state.stamp_ns - self._places[0].stamp_ns > APART_NS:
            self._places.popleft()
        passed_s = (state.stamp_ns - self._places[0].stamp_ns) / 1e9
        if passed_s < 0.9 * APART_NS / 1e9:
            return False
        way_m = told_m = 0.0
        for a, b in pairwise(self._places):
            way_m += (b.x_m - a.x_m) * math.cos(b.heading_rad) + (b.y_m - a.y_m) * math.sin(b.heading_rad)
            told_m += b.speed_mps * (b.stamp_ns - a.stamp_ns) / 1e9
        return abs(way_m - told_m) > APART_MPS * passed_s

    def _contradicts(self, state: State, last: State | None, dt_s: float) -> bool:
        bicycle_radps = state.speed_mps * math.tan(state.wheel_rad) / WHEELBASE_M
        if abs(state.yaw_rate_radps - bicycle_radps) > 0.8:
            return True
        if last is None:
            return False
        if abs(state.speed_mps - last.speed_mps) > 20.0 * dt_s + 0.5:
            return True
        if not (state.is_valid and last.is_valid and state.frame == last.frame):
            return False
        moved_m = math.hypot(state.x_m - last.x_m, state.y_m - last.y_m)
        turned_rad = abs(math.remainder(state.heading_rad - last.heading_rad, math.tau))
        self._still_m = 0.0 if moved_m else self._still_m + abs(state.speed_mps) * 0.01
        fastest_mps = max(abs(state.speed_mps), abs(last.speed_mps))
        turning_radps = max(abs(state.yaw_rate_radps), abs(last.yaw_rate_radps))
        jumps = moved_m > fastest_mps * dt_s + 0.5 or turned_rad > turning_radps * dt_s + 0.2
        return jumps or self._still_m > 0.5


def _is_possible(can_id: int, data: bytes) -> bool:
    if can_id == POSE:
        return data[1] >> 4 & 3 in FRAMES.values()
    most = (32_768, 20_000, 32_768) if can_id == MOTION else (20_000, 30_000, 10_000)
    return all(abs(raw) <= limit for raw, limit in zip(struct.unpack_from("<hhh", data, 2), most, strict=True))


class Controller:
    """Receives samples and answers each; stops, releases the vehicle or goes silent when something is wrong.

    `phase` is standby, engaging, engaged, out (latched: releases with each answer) or silent (latched: sends nothing).
    """

    def __init__(self, channel: str, route: Route, *, is_armed: bool, defect: str = "") -> None:
        """Raises `ValueError` for a route that the wheels cannot follow, `OSError` without a bus."""
        route.check_curvature(1.1 * math.tan(WHEEL_RAD) / WHEELBASE_M)
        self.recorder: Recorder | None = None
        self.view: View | None = None
        self.channel, self.route, self.is_armed, self.defect = channel, route, is_armed, defect
        self.phase, self.latched = "standby", Reason.NOT_ENGAGED
        self.bus: Bus | None = Bus(channel)
        self.is_over = False
        self.orders: list[int] = []
        """Signals that have come and are not obeyed yet."""
        self.ending_ns = 0
        self.sent = dict.fromkeys(OURS, 14)
        self.reopen_ns = self.pairs = 0
        self.reset()

    def reset(self) -> None:
        """Forget everything that was received over the link."""
        self.receiver = Receiver(self.defect)
        self.state: State | None = None
        self.status: Status | None = None
        self.answers: deque[tuple[int, State, bool]] = deque()
        now_ns = time.monotonic_ns()
        self.read_ns = now_ns
        self.sample_ns = self.status_ns = self.fresh_ns = self.pair_ns = self.slow_ns = self.phase_ns = 0
        self.refused = self.refused_ns = self.clean = 0
        self.held, self.held_ns = Reason.NOMINAL, 0
        self.contradictions, self.is_doubtful = 0, False
        self.wheel_rad = self.accel_mps2 = 0.0
        self.said, self.is_enabled, self.is_stop = Reason.NOT_ENGAGED, False, False
        self.strayed: Reason = Reason.NOMINAL
        self.ended: Reason = Reason.NOMINAL

    @property
    def commands(self) -> bool:
        """Whether the vehicle is being engaged or driven."""
        return self.phase in ("engaging", "engaged")

    def enter(self, phase: str, reason: Reason = Reason.NOMINAL) -> None:
        """Enter another phase and print it."""
        self.phase, self.latched, self.phase_ns = phase, reason, time.monotonic_ns()
        if phase == "standby":
            self.refused = self.refused_ns = 0
        elif phase == "engaging":
            self.route.begin_again()
            self.strayed = self.ended = self.held = Reason.NOMINAL
            self.contradictions, self.is_doubtful = 0, False
        print(f"{phase.upper()} ({Reason(reason).name})", flush=True)

    def run(self) -> int:
        """Run until told to end; return the exit status."""
        while not self.is_over:
            self.step()
        if self.bus is not None:
            self.bus.raw.close()
        if self.recorder is not None:
            self.recorder.close()
        if self.view is not None:
            self.view.close()
        return self.exit_status

    @property
    def exit_status(self) -> int:
        """What it would end with now."""
        is_out = self.phase == "out" and self.latched != Reason.DRIVER_OVERRIDE
        is_fault = self.phase == "silent" or is_out or self.is_doubtful
        return 4 if is_fault else 0

    def step(self) -> None:
        """Wait for frames, and answer them."""
        self.wait()
        now_ns = time.monotonic_ns()
        try:
            self.obey(now_ns)
            if self.bus is None:
                self.reopen(now_ns)
            else:
                self.receive(now_ns)
                self.send_due(now_ns)
                self.send_slow_when_due(now_ns)
        except OSError as error:
            self.lose_link(now_ns, error)

    def wait(self) -> None:
        """Wait for frames, at most one period."""
        until_ns = self.answers[0][0] if self.answers else time.monotonic_ns() + PERIOD_NS
        ready(self.bus.raw if self.bus is not None else None, select.POLLIN, (until_ns - time.monotonic_ns()) / 1e9)

    def obey(self, now_ns: int) -> None:
        """Process the operator's signals."""
        while self.orders:
            order = self.orders.pop(0)
            if order == signal.SIGUSR1:
                if self.is_armed and self.bus is not None and not self.commands and not self.ending_ns:
                    self.enter("standby", Reason.NOT_ENGAGED)
            elif self.ending_ns:
                self.let_go()
            else:
                self.ending_ns = now_ns
        if self.ending_ns and (not self.is_armed or self.phase == "silent"):
            self.is_over = True
        elif self.ending_ns and now_ns - self.ending_ns > (SHUTDOWN_NS if self.commands else STALE_NS):
            self.let_go()

    def let_go(self) -> None:
        """One pair with ENABLE 0, whatever the vehicle does, and the end."""
        if self.is_armed and self.phase != "silent":
            self.send_pair(0, Reason.SHUTDOWN if self.phase != "out" else self.latched)
        self.is_over = True

    def lose_link(self, now_ns: int, error: OSError) -> None:
        """Silent; the socket is of no more use."""
        if self.bus is not None:
            self.bus.raw.close()
            print(f"{self.channel}: {error}", flush=True)
        self.bus, self.reopen_ns = None, now_ns + REOPEN_NS
        if self.phase != "silent" and self.is_armed:
            self.enter("silent", Reason.LINK_DOWN)

    def reopen(self, now_ns: int) -> None:
        """Ten times a second, on whatever interface has the name now."""
        if now_ns < self.reopen_ns:
            return
        self.reopen_ns = now_ns + REOPEN_NS
        self.bus = Bus(self.channel)
        print(f"{self.channel}: open again", flush=True)
        self.reset()

    def receive(self, now_ns: int) -> None:
        """Everything that waits, before anything is answered.

        No frame is older than the last look at the socket; after a long pause none is taken for young.
        """
        assert self.bus is not None
        frames = self.bus.received()
        is_old, self.read_ns = now_ns - self.read_ns > ANSWER_AGE_NS, now_ns
        for can_id, data in frames:
            if can_id in OURS:
                if self.is_armed and self.phase != "silent":
                    self.enter("silent", Reason.DUPLICATE_COMMANDER)
            elif not self.receiver.is_whole(can_id, data):
                continue
            elif can_id == VEHICLE_STATUS:
                status = self.receiver.status(data)
                if status is not None:
                    self.status, self.status_ns = status, self.status_ns if is_old else now_ns
                    self.follow(status)
            elif not is_old:
                state = self.receiver.sample(can_id, data, now_ns)
                if state is not None:
                    self.take(state)

    def take(self, state: State) -> None:
        """A complete sample: the state, if it can be true, and to be answered."""
        self.sample_ns = state.stamp_ns
        is_true = self.receiver.is_plausible(state)
        if is_true:
            if self.state is None or state.stamp_ns - self.state.stamp_ns > STALE_NS:
                self.fresh_ns = state.stamp_ns
            self.state = state
        delay_ns = 30 * MS if self.defect == "late_by_30_ms" else 0
        self.answers.append((state.stamp_ns + delay_ns, state, is_true))

    def follow(self, status: Status) -> None:
        """What the vehicle says of itself ends, or completes, an engagement."""
        if not self.commands:
            return
        if status.mode in (FAULT, EMERGENCY_STOP):
            self.enter("out", Reason.VEHICLE_FAULT)
        elif status.driver_acts or status.mode == MANUAL:
            if self.defect != "commands_after_override":
                self.enter("out", Reason.DRIVER_OVERRIDE)
        elif self.phase == "engaging" and status.mode == AUTONOMOUS:
            self.enter("engaged")
        elif self.phase == "engaged" and status.mode != AUTONOMOUS and self.defect != "commands_after_override":
            self.enter("out", Reason.VEHICLE_NOT_AUTONOMOUS)

    def send_due(self, now_ns: int) -> None:
        """Answer what is due; without samples stop, and then say nothing."""
        watches = self.defect != "timeout_removed"
        age_ns = now_ns - self.state.stamp_ns if self.state is not None else 0
        if age_ns >= SILENT_NS:
            self.receiver.forget()
            if self.commands and watches:
                self.enter("silent", Reason.STATE_INVALID if self.receiver.doubts >= 3 else Reason.STATE_STALE)
        if self.refused_ns and now_ns - self.refused_ns >= QUEUE_FULL_NS and self.phase != "silent":
            self.enter("silent", Reason.LINK_DOWN)
        if self.phase == "engaging" and now_ns - self.phase_ns >= GIVE_UP_NS:
            self.enter("out", Reason.VEHICLE_NOT_AUTONOMOUS)
        if self.phase == "standby" and self.is_armed and self.is_ready(now_ns):
            self.enter("engaging")
        while self.answers and self.answers[0][0] <= now_ns and not self.is_over:
            _, state, is_true = self.answers.popleft()
            if self.is_armed and self.phase != "silent":
                self.answer(state, now_ns, is_true=is_true)
        is_alone = now_ns - self.sample_ns >= STALE_NS and now_ns - self.pair_ns >= PERIOD_NS
        if self.commands and is_alone and watches and self.state is not None and not self.is_over:
            self.command(self.state, Reason.STATE_STALE, now_ns)

    def is_ready(self, now_ns: int) -> bool:
        """Whether to engage: the vehicle is READY, and samples have come for half a second."""
        if self.state is None or self.status is None or self.ending_ns:
            return False
        is_fresh = now_ns - self.state.stamp_ns < STALE_NS and now_ns - self.status_ns < STATUS_STALE_NS
        is_asked = self.status.mode == READY and not self.status.driver_acts
        return is_fresh and is_asked and now_ns - max(self.fresh_ns, self.phase_ns) >= FRESH_NS

    def answer(self, state: State, now_ns: int, *, is_true: bool) -> None:
        """One pair for one sample; none for a first and a second one in a row that cannot be true."""
        if not self.commands:
            self.is_over = bool(self.ending_ns)
            self.send_pair(0, Reason.SHUTDOWN if self.is_over and self.phase == "standby" else self.latched)
        elif is_true:
            reason = self.reason(state, now_ns)
            if self.ending_ns and abs(state.speed_mps) < STANDING_MPS:
                self.is_over = True
                self.send_pair(0, Reason.SHUTDOWN)
            else:
                self.command(state, reason, now_ns)
        elif self.state is not None and self.receiver.doubts >= 3:
            self.command(self.state, Reason.STATE_INVALID, now_ns)

    def reason(self, state: State, now_ns: int) -> Reason:
        """Why the vehicle is to be stopped; NOMINAL: it is not."""
        if self.refused >= 3:
            return Reason.LINK_DOWN
        if now_ns - self.status_ns > STATUS_STALE_NS:
            return Reason.STATE_STALE
        self.is_doubtful = self.receiver.is_speed_wrong(state) or self.has_wrong_gear(state) or self.is_doubtful
        if not state.is_valid or self.is_doubtful:
            return Reason.STATE_INVALID
        if state.frame != self.route.frame and self.defect != "frame_ignored":
            return Reason.FRAME_MISMATCH
        self.route.locate(state)
        rolls_mps = state.speed_mps * self.route.direction
        is_off = self.route.off_m > OFF_PATH_M or abs(self.route.off_rad) > OFF_HEADING_RAD
        if self.route.is_past or self.ended:
            self.ended = self.ended or Reason.PAST_END_SPACE
        elif self.driven_s(now_ns) > self.route.end_s:
            self.ended = Reason.PAST_END_TIME
        elif is_off or abs(rolls_mps) > SPEED_MPS + OVERSPEED_MPS or rolls_mps < -ROLLBACK_MPS:
            self.strayed = Reason.DEVIATION
        return self.strayed or self.ended or (Reason.SHUTDOWN if self.ending_ns else Reason.NOMINAL)

    def has_wrong_gear(self, state: State) -> bool:
        """Whether the gear has contradicted the direction of travel in many samples."""
        against = DRIVE if state.speed_mps < 0.0 else REVERSE
        is_against = abs(state.speed_mps) > GEAR_CHANGE_MPS and self.status is not None and self.status.gear == against
        self.contradictions = self.contradictions + 1 if is_against else 0
        return self.contradictions >= CONTRADICTIONS

    def hold(self, reason: Reason, now_ns: int) -> Reason:
        """A stop lasts until its cause has been gone for a while."""
        if reason in HOLD_NS:
            self.held, self.held_ns = reason, now_ns
        elif reason == Reason.NOMINAL and self.held and now_ns - self.held_ns < HOLD_NS[self.held]:
            return self.held
        return reason

    def driven_s(self, now_ns: int) -> float:
        """Time since the engagement, which is the route's time."""
        return (now_ns - self.phase_ns) / 1e9 if self.phase == "engaged" else 0.0

    def command(self, state: State, reason: Reason, now_ns: int) -> None:
        """Drive on, or stop for a reason; within the limits either way."""
        reason = self.hold(reason, now_ns)
        wheel_rad, speed_mps, gear, jerk_mps3 = self.wheel_rad, 0.0, NO_REQUEST, LATERAL_MPS3
        if reason == Reason.NOMINAL:
            wheel_rad = self.wanted_wheel_rad(state, now_ns)
            if not math.isfinite(wheel_rad) and self.defect != "nan_path":
                wheel_rad, reason = self.wheel_rad, Reason.CONTROLLER_ERROR
        else:
            wheel_rad, jerk_mps3 = 0.0, math.inf if self.defect == "stop_swerves" else LATERAL_MPS3
        if reason == Reason.NOMINAL:
            speed_mps, gear = self.wanted_speed_mps(state, now_ns)
        dt_s = min(0.05, max(0.0, (now_ns - self.pair_ns) / 1e9))
        self.wheel_rad = self.limited_wheel_rad(wheel_rad, state, dt_s, jerk_mps3)
        self.accel_mps2 = self.limited_accel_mps2(speed_mps, state, dt_s, is_stop=reason != Reason.NOMINAL)
        self.send_pair(1, reason, speed_mps, gear)

    def wanted_wheel_rad(self, state: State, now_ns: int) -> float:
        """Pure pursuit: the arc through a point ahead, the same formula in reverse."""
        if self.defect == "nan_path" and self.driven_s(now_ns) > 3.0:
            return math.nan
        x_m, y_m = self.route.point_ahead(2.0 + 0.4 * abs(state.speed_mps))
        dx, dy = x_m - state.x_m, y_m - state.y_m
        left_m = dy * math.cos(state.heading_rad) - dx * math.sin(state.heading_rad)
        wheel_rad = math.atan(WHEELBASE_M * 2.0 * left_m / max(0.01, dx * dx + dy * dy))
        return -wheel_rad if self.defect == "steer_sign_swapped" else wheel_rad

    def wanted_speed_mps(self, state: State, now_ns: int) -> tuple[float, int]:
        """The route's speed with its sign, to a stop where the leg ends, and the gear for it."""
        left_m = self.route.left_of_leg_m()
        if left_m < 0.1 and abs(state.speed_mps) < 0.05 and self.route.may_leave_leg(self.driven_s(now_ns)):
            self.route.next_leg()
            left_m = self.route.left_of_leg_m()
        direction = self.route.direction
        speed_mps = min(max(CREEP_MPS, self.route.speed_mps(AHEAD_S * abs(state.speed_mps))), SPEED_MPS)
        speed_mps = 0.0 if left_m < 0.05 else max(CREEP_MPS, min(speed_mps, math.sqrt(1.4 * left_m)))
        gear = DRIVE if direction > 0 else REVERSE
        if self.status is not None and self.status.gear == gear:
            return direction * speed_mps, NO_REQUEST
        return 0.0, gear if abs(state.speed_mps) < GEAR_CHANGE_MPS else NO_REQUEST

    def limited_wheel_rad(self, wanted_rad: float, state: State, dt_s: float, jerk_mps3: float) -> float:
        """Within angle, lateral acceleration, distance from the measured wheels, and, last, rate."""
        v_mps = max(0.1, abs(state.speed_mps))
        most_rad = min(_at(v_mps, WHEEL_BY_SPEED), math.atan(LATERAL_MPS2 * WHEELBASE_M / v_mps**2))
        most_rad *= 1.1 if self.defect == "limit_off_by_10_percent" else 1.0
        wanted_rad = min(most_rad, max(-most_rad, wanted_rad))
        wanted_rad = min(state.wheel_rad + WHEEL_APART_RAD, max(state.wheel_rad - WHEEL_APART_RAD, wanted_rad))
        fastest_radps = min(
            WHEEL_RADPS if self.phase == "engaged" else WHEEL_ENGAGING_RADPS, jerk_mps3 * WHEELBASE_M / v_mps**2
        )
        step_rad = fastest_radps * dt_s
        return min(self.wheel_rad + step_rad, max(self.wheel_rad - step_rad, wanted_rad))

    def limited_accel_mps2(self, wanted_mps: float, state: State, dt_s: float, *, is_stop: bool) -> float:
        """Along the body's x axis; drive is let go of at once, everything else is led there."""
        v_mps, before_mps2 = state.speed_mps, self.accel_mps2
        if is_stop:
            forward = -1.0 if self.status is not None and self.status.gear == REVERSE else 1.0
            travel = math.copysign(1.0, v_mps) if abs(v_mps) >= STANDING_MPS else forward
            wanted_mps2 = 0.0 if self.defect == "stop_without_brake" else -STOP_MPS2 * travel
            before_mps2 = 0.0 if before_mps2 * travel > 0.0 else before_mps2
        else:
            drive_mps2 = ACCEL_MPS2 if self.phase == "engaged" else ACCEL_ENGAGING_MPS2
            drive_mps2 = min(drive_mps2, _at(abs(v_mps), ((0.0, 3.0), (10.0, 3.0), (20.0, 1.5))))
            travel = math.copysign(1.0, wanted_mps if wanted_mps else v_mps)
            along_mps2 = min(drive_mps2, max(-BRAKE_MPS2, 2.5 * (wanted_mps - v_mps) * travel))
            wanted_mps2 = along_mps2 * travel
        step_mps2 = math.inf if self.defect == "jerk_unlimited" else ACCEL_MPS3 * dt_s
        led_mps2 = min(before_mps2 + step_mps2, max(before_mps2 - step_mps2, wanted_mps2))
        most_mps2, least_mps2 = (ACCEL_MPS2, -BRAKE_MPS2) if travel > 0.0 else (BRAKE_MPS2, -ACCEL_MPS2)
        return min(most_mps2, max(least_mps2, led_mps2))

    def send_pair(self, enable: int, reason: Reason, speed_mps: float = 0.0, gear: int = NO_REQUEST) -> None:
        """Send DRIVE_COMMAND, STEER_COMMAND and whatever else is due. Only a sent frame uses up a counter value."""
        is_stop = enable and reason != Reason.NOMINAL
        if not enable:
            self.accel_mps2, self.wheel_rad = 0.0, 0.0
            if self.state is not None:
                self.wheel_rad = min(WHEEL_RAD, max(-WHEEL_RAD, self.state.wheel_rad))
        said = Reason.NOMINAL if is_stop and self.defect == "stop_without_reason" else reason
        accel_raw, speed_raw = round(self.accel_mps2 / 0.001), round(speed_mps / 0.005)
        now_ns = time.monotonic_ns()
        self.pairs += 1
        self.pair_ns = now_ns
        is_repeated = self.defect == "counter_repeated_with_fresh_crc" and self.pairs % 50 == 0
        flags = enable << 4 | (0x20 if is_stop else 0)
        drive = struct.pack("<BhhBB", flags, accel_raw, speed_raw, said, gear)
        steer = struct.pack("<Bhh2x", enable << 4, round(self.wheel_rad / 0.0001), 0)
        step = 0 if is_repeated else 1
        if self.recorder is not None:
            self.recorder.write(now_ns / 1e9, enable, reason, self.accel_mps2, self.wheel_rad, speed_mps)
        if self.view is not None:
            self.view.show(now_ns / 1e9, enable, reason, self.accel_mps2, self.wheel_rad, speed_mps)
        assert self.bus is not None
        has_room = self.bus.has_room()
        if has_room and self.send(DRIVE_COMMAND, drive, step) and self.send(STEER_COMMAND, steer, step):
            self.clean, self.refused_ns = self.clean + 1, 0
            self.refused = self.refused if self.clean < CLEAN_PAIRS and self.refused >= 3 else 0
        else:
            self.clean, self.refused, self.refused_ns = 0, self.refused + 1, self.refused_ns or now_ns
        self.said, self.is_enabled, self.is_stop = said, bool(enable), bool(is_stop)
        self.send_slow_when_due(now_ns)

    def send_slow_when_due(self, now_ns: int) -> None:
        """Send lights and the controller's own status, also while samples have a short gap."""
        is_answering = self.pairs > 0 and now_ns - self.pair_ns <= SILENT_NS and self.phase != "silent"
        if self.bus is not None and is_answering and now_ns >= self.slow_ns and self.bus.has_room():
            self.slow_ns = max(self.slow_ns + SLOW_PERIOD_NS, now_ns + SLOW_PERIOD_NS // 2)
            self.send_slow(self.said, is_enabled=self.is_enabled, is_stop=self.is_stop, now_ns=now_ns)

    def send_slow(self, reason: Reason, *, is_enabled: bool, is_stop: bool, now_ns: int) -> None:
        """Send lights and the controller's own status."""
        has_hazard = is_stop and reason not in (Reason.PAST_END_SPACE, Reason.PAST_END_TIME)
        self.send(BODY_COMMAND, struct.pack("<B6x", has_hazard << 4))
        named = {"standby": 1, "engaging": 2, "engaged": 4 if is_stop else 3, "out": 5}
        is_let_go = self.phase == "engaged" and not is_enabled
        state = 1 if is_let_go or self.latched == Reason.DRIVER_OVERRIDE else named[self.phase]
        indices = self.route.furthest_row(), self.route.index_at(self.driven_s(now_ns))
        self.send(CONTROLLER_STATUS, struct.pack("<BBHHB", state << 4, reason, *(min(65535, i) for i in indices), 0))

    def send(self, can_id: int, content: bytes, step: int = 1) -> bool:
        """Add counter and CRC and send; return whether the frame was sent."""
        assert self.bus is not None
        counter = (self.sent[can_id] + step) % 15
        data = bytes((0, content[0] | counter)) + content[1:]
        if not self.bus.send(can_id, bytes((crc8(can_id, data),)) + data[1:]):
            return False
        self.sent[can_id] = counter
        return True


def _at(x: float, table: Sequence[tuple[float, float]]) -> float:
    """Interpolate linearly between the rows of the table."""
    for (x0, y0), (x1, y1) in pairwise(table):
        if x <= x1:
            return y0 + (x - x0) / (x1 - x0) * (y1 - y0)
    return table[-1][1]


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse the command line and run the controller."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--channel", required=True, help="SocketCAN interface")
    parser.add_argument("--route", required=True, type=Path, help="CSV: time_s,x_m,y_m,heading_rad,speed_mps")
    parser.add_argument("--arm", action="store_true", help="drive; without it no frame is sent")
    parser.add_argument("--record", type=Path, metavar="DIR", help="record each pair in this new folder")
    parser.add_argument(
        "--show", type=int, metavar="PORT", help="send each pair to the page at this port (minimal_view.py)"
    )
    parser.add_argument("--defect", choices=DEFECTS, default="", metavar="NAME", help=", ".join(DEFECTS))
    given = parser.parse_args(arguments)
    try:
        route = read_route(given.route)
    except (OSError, ValueError) as error:
        parser.error(str(error))
    try:
        controller = Controller(given.channel, route, is_armed=given.arm, defect=given.defect)
        if given.record is not None:
            blocks, is_required = given.defect == "recorder_blocks", given.defect == "recorder_required"
            controller.recorder = Recorder(given.record, blocks=blocks, is_required=is_required)
        if given.show is not None:
            blocks, is_required = given.defect == "view_blocks", given.defect == "view_required"
            controller.view = View(given.show, blocks=blocks, is_required=is_required)
    except ValueError as error:
        parser.error(f"{given.route}: {error}")
    except OSError as error:
        print(f"{given.channel}: {error}", file=sys.stderr)
        return 3
    for number in (signal.SIGUSR1, signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, _: controller.orders.append(number))
    print(f"minimal controller on {given.channel}{', armed' if given.arm else ''} {given.defect}".rstrip(), flush=True)
    return controller.run()


if __name__ == "__main__":
    sys.exit(main())

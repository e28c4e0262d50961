"""Received frames, through decoder, state assembler, plausibility and engagement.

The first byte chooses the vehicle; then frames as `engine.traffic` makes them, 0 to 12.75 ms apart.
Law: each frame is taken or counted as dropped; what comes out is finite, no sample is from the future, and nobody is
engaged who has not heard an autonomous vehicle. Where the decoder in C is built, the one in Python does the same.
"""

import dataclasses
import math
import os
from collections.abc import Iterator
from unittest import mock

from fuzzing.engine.input_bytes import Bytes
from fuzzing.engine.traffic import Traffic
from vehicle_iface import wire
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime.assembly import build_state_assembler
from vehicle_iface.safety.engagement import Engagement, EngagementTiming
from vehicle_iface.safety.modes import Mode
from vehicle_iface.safety.plausibility import PlausibilityCheck
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.state import VehicleState
from vehicle_iface.units import NS_PER_MS, NS_PER_S

LENGTH = 2048
_DATABASES = [load_database(load_profile(name)) for name in ("reference", "reference_fd")]
_STEP_NS = 50_000
_TIMING = EngagementTiming(
    settle_ns=20 * NS_PER_MS,
    stale_ns=50 * NS_PER_MS,
    lost_ns=500 * NS_PER_MS,
    status_stale_ns=100 * NS_PER_MS,
    engage_timeout_ns=3 * NS_PER_S,
    end_ns=10 * NS_PER_S,
    steer_torque_nm=3.0,
)


class _Receiver:
    """Every part that receives a frame, in the order of the loop."""

    def __init__(self, database: VehicleDatabase) -> None:
        profile = database.profile
        self.decoder, self.assembler = Decoder(database.received), build_state_assembler(database)
        with mock.patch.dict(os.environ, {wire.VARIABLE: "python"}):
            self._in_python = Decoder(database.received)
        self.plausibility = PlausibilityCheck(profile.plausibility, wheelbase_m=profile.geometry.wheelbase_m)
        self.engagement = Engagement(_TIMING, armed=True)

    def receive(self, traffic: Traffic, now_ns: int) -> None:
        self.engagement.on_tick(now_ns)
        frame = traffic.next_frame(now_ns)
        received = self.decoder.decode(frame)
        assert repr(received) == repr(self._in_python.decode(frame))
        assert (self.decoder.drops, self.decoder.lost) == (self._in_python.drops, self._in_python.lost)
        if received is None:
            return
        assert all(value is None or math.isfinite(value) for value in received.values)
        sample = self.assembler.take(received)
        status = self.assembler.status
        if sample is not None:
            _check(sample.state)
            assert max(sample.state.stamp_ns, sample.completed_ns) <= now_ns
            if self.plausibility.is_plausible(sample.state, pose_valid=sample.pose_valid):
                self.engagement.on_sample(sample.state.stamp_ns, now_ns)
        elif status is not None and status.stamp_ns == received.stamp_ns:
            before = self.engagement.mode
            self.engagement.on_status(status, now_ns)
            if self.engagement.mode is Mode.ENGAGED and before is not Mode.ENGAGED:
                assert status.mode.name == "AUTONOMOUS"


def run(data: bytes) -> None:
    source = Bytes(data)
    database = _DATABASES[source.number() % 2]
    receiver, traffic = _Receiver(database), Traffic(database, source)
    now_ns, frames = NS_PER_S, 0
    while source:
        now_ns += source.number() * _STEP_NS
        receiver.receive(traffic, now_ns)
        frames += 1
    assert receiver.decoder.accepted + sum(receiver.decoder.drops.values()) == frames


def _check(state: VehicleState) -> None:
    for field in dataclasses.fields(state):
        value = getattr(state, field.name)
        assert not isinstance(value, float) or math.isfinite(value), field.name


def seeds() -> Iterator[bytes]:
    """What the simulated vehicles say: at rest, and as an autonomous one would."""
    for number, database in enumerate(_DATABASES):
        vehicle = simulated_vehicle(database, start_ns=0)
        sample_messages = [message.can_id for message in (*database.received, *database.sent)]
        told = bytearray([number])
        for tick in range(6):
            for frame in vehicle.advance(tick * 10 * NS_PER_MS):
                told += bytes([60, sample_messages.index(frame.can_id)]) + frame.data
        yield bytes(told)
    yield b"\0\0\x70" + (0x110).to_bytes(4, "little") + b"\x04\x08" + bytes(8)

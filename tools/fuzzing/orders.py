"""Lines for the simulated vehicle's pedals, and the frames that it sends under them.

Law: each line has an answer of one line, nothing is raised, and all that is sent is within the contract.
"""

import math
from collections.abc import Iterator

from vehicle_iface.codec.database import load_database
from vehicle_iface.codec.decoder import Decoder, DropCause
from vehicle_iface.profile import load_profile
from vehicle_iface.sim.driver_commands import COMMANDS, execute
from vehicle_iface.sim.driver_socket import LONGEST_LINE
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.units import NS_PER_MS

LENGTH = 300
_DATABASE = load_database(load_profile("reference"))
_BY_DAMAGE = {DropCause.BAD_CRC, DropCause.REPEATED, DropCause.WRONG_SEQUENCE}
"""What orders for damage may lead to."""


def run(data: bytes) -> None:
    vehicle = simulated_vehicle(_DATABASE, start_ns=0)
    decoder = Decoder(_DATABASE.received)
    for number, line in enumerate(data.split(b"\n")[:20]):
        answer = execute(vehicle, line[:LONGEST_LINE].decode("utf-8", "replace"))
        assert answer, "no answer"
        assert len(answer.splitlines()) == 1, "more than a line"
        answer.encode()
        for frame in vehicle.advance(number * 20 * NS_PER_MS):
            decoder.decode(frame)
        assert all(math.isfinite(getattr(vehicle.state, field)) for field in ("x_m", "y_m", "speed_mps"))
    assert {cause for cause, _ in decoder.drops} <= _BY_DAMAGE, decoder.drops


def seeds() -> Iterator[bytes]:
    yield from (usage.split()[0].encode() for usage, _ in COMMANDS.values())
    yield b"brake 1\nbrake 0\nthrottle 1\nsteer -3.5\ngear DRIVE\nready\nfault 7\nreset\nready"
    yield b"emergency_stop\npose_valid 0\nframe ODOM\nmute STATE on\nmute ALL off\nhelp"
    yield b"corrupt POSE 3\nskip_counter STATE 2\nfreeze on\njump 1.5 -2e3\nstatus"

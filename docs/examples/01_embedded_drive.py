"""Drive a simulated vehicle round a circle inside this process: no CAN interface, no viewer.

    python docs/examples/01_embedded_drive.py [SECONDS]

The loop is the one that `vehicle-iface run` uses; the bus is an object whose other end is a simulated vehicle.
"""

import sys

from vehicle_iface import clock, compose, drivable
from vehicle_iface.codec.database import load_database
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime.summary import table
from vehicle_iface.sim.embedded import EmbeddedBus
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.trajectories import RecedingRoute
from vehicle_iface.units import ns_from_s


def main(seconds: float) -> int:
    """Drive for `seconds`, stop, and print what happened. Returns 1 where the drive ended in a latched fault."""
    profile = load_profile("reference")  # or the path of your own .toml
    database = load_database(profile)  # the DBC, checked against the profile
    vehicle = simulated_vehicle(database, start_ns=clock.monotonic_ns())
    loop = compose.build_loop(
        database=database,
        open_bus=lambda: EmbeddedBus(vehicle, clock.monotonic_ns, clock.sleep_until),
        controller=compose.build_controller("pure_pursuit", profile),
        source=RecedingRoute(drivable.build_route("circle", profile)),
        telemetry=None,
        armed=True,
    )
    end_ns = clock.monotonic_ns() + ns_from_s(seconds)
    while not loop.shutdown.is_done:
        if clock.monotonic_ns() >= end_ns:
            loop.shutdown.begin_on_schedule()  # brakes to standstill and releases the vehicle; then the loop is done
        loop.step()
    print(table(loop.summary()))
    return int(loop.shutdown.ended_in_fault)


if __name__ == "__main__":
    sys.exit(main(float(sys.argv[1]) if len(sys.argv) > 1 else 5.0))

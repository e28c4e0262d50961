"""`vehicle-iface sim` and `vehicle-iface driver`: run the simulated vehicle, and act as its driver."""

import argparse
import logging
from contextlib import closing

from vehicle_iface import clock
from vehicle_iface.bus.base import Bus
from vehicle_iface.cli.channels import find_channels
from vehicle_iface.cli.exit_status import BAD_USAGE, DONE
from vehicle_iface.cli.frames import check_frame
from vehicle_iface.cli.option_types import EMBEDDED
from vehicle_iface.cli.signals import Flag, on_end_signals
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.opening import open_buses, require_socketcan
from vehicle_iface.profile import load_profile
from vehicle_iface.runtime import realtime
from vehicle_iface.sim.driver_socket import DriverSocket, default_path, send_line
from vehicle_iface.sim.model import BicycleState
from vehicle_iface.sim.node import run_vehicle
from vehicle_iface.sim.wire import simulated_vehicle
from vehicle_iface.units import ns_from_s

log = logging.getLogger("vehicle_iface")


def run_simulator(options: argparse.Namespace) -> int:
    """Run the simulated vehicle until it is interrupted or `--duration` is over."""
    profile = load_profile(options.profile)
    if options.interface == EMBEDDED:
        raise ConfigError("--interface embedded: that bus has its vehicle in `run`; sim needs one of its own")
    channels = find_channels(options.channels, profile, command="sim", interface=options.interface)
    require_socketcan(options.interface, profile)
    database = load_database(profile)
    frame_id = check_frame(options.frame, database)
    try:
        vehicle = simulated_vehicle(
            database, start_ns=clock.monotonic_ns(), start=_parse_start(options.start), frame_id=frame_id
        )
    except InvalidValueError as error:
        raise ConfigError(f"--start {options.start}: {error}") from None
    end = Flag()
    on_end_signals(end.set)
    deadline_ns = clock.monotonic_ns() + ns_from_s(options.duration) if options.duration else None
    path = options.driver_socket or default_path("-".join(channels.values()))

    def is_over() -> bool:
        return end.is_set or (deadline_ns is not None and clock.monotonic_ns() >= deadline_ns)

    def open_bus() -> Bus:
        return open_buses(options.interface, channels, database.profile, received=database.sent)

    with closing(DriverSocket(path)) as driver:
        bus = open_bus()
        log.info("simulated vehicle on %s, driver socket %s", bus.description, path)
        for lack in realtime.apply_settings():
            log.warning("%s", lack)
        run_vehicle(vehicle, bus, driver, clock.monotonic_ns, is_over, reopen=open_bus)
    counters = ", ".join(f"{name} {count}" for name, count in sorted(vehicle.counters.items()) if count)
    on_end_signals(None)
    print_safely(f"  vehicle ended {vehicle.mode.name} at {vehicle.state.speed_mps:.2f} m/s: {counters}")
    return DONE


def send_driver_command(options: argparse.Namespace) -> int:
    """Send one line to the driver socket of a simulated vehicle and print the answer."""
    answer = send_line(options.path, " ".join(options.line))
    print(answer)
    return BAD_USAGE if answer.startswith("error") else DONE


def _parse_start(text: str) -> BicycleState:
    try:
        x_m, y_m, heading_rad = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--start {text!r}: must be X,Y,HEADING in metres and radians, like 0,0,1.57") from None
    return BicycleState(x_m=x_m, y_m=y_m, heading_rad=heading_rad)

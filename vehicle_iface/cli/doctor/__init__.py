"""`vehicle-iface doctor`: reports what this machine lacks for driving a vehicle, each with a command that fixes it.

It only reads and tries; it changes nothing and needs no privileges. It reports what it could not check.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path

from vehicle_iface.cli.channels import find_channels
from vehicle_iface.cli.doctor.can import check_interface, check_receive_buffer, check_socketcan, granted_bytes
from vehicle_iface.cli.doctor.findings import Diagnostic, as_json, as_text, is_ready, read_text
from vehicle_iface.cli.doctor.system import (
    check_clock,
    check_governor,
    check_memory_files,
    check_realtime,
    check_software,
    check_throttling,
    check_wire,
    describe_other_system,
    read_number,
)
from vehicle_iface.cli.exit_status import BAD_USAGE, DONE
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.profile import Bus, load_profile
from vehicle_iface.telemetry import telemetry_path


def examine_machine(options: argparse.Namespace) -> int:
    """Print all diagnostics; return 2 if something required is missing."""
    profile = load_profile(options.profile)
    channels = find_channels(options.channels, profile, command="doctor")
    diagnostics = examine({channel: profile.all_buses[name] for name, channel in channels.items()})
    print_safely(as_json(diagnostics) if options.json else as_text(diagnostics))
    return DONE if is_ready(diagnostics) else BAD_USAGE


def examine(buses: Mapping[str, Bus], *, system: str = sys.platform) -> list[Diagnostic]:
    """Check everything that a vehicle on `buses` needs. `buses` maps interface names to the profile's buses."""
    if system != "linux":
        return [*describe_other_system(system), *check_software()]
    return [
        *check_socketcan(buses),
        *(found for channel, bus in buses.items() for found in check_interface(channel, bus)),
        *check_receive_buffer(granted_bytes()),
        *check_realtime(),
        *check_throttling(
            read_number("/proc/sys/kernel/sched_rt_runtime_us"), read_number("/proc/sys/kernel/sched_rt_period_us")
        ),
        *check_governor(
            read_text(path) for path in Path("/sys/devices/system/cpu").glob("cpu*/cpufreq/scaling_governor")
        ),
        *check_clock(
            *(
                read_text(f"/sys/devices/system/clocksource/clocksource0/{which}_clocksource").split()
                for which in ("current", "available")
            )
        ),
        *check_memory_files(telemetry_path("default").parent),
        *check_wire(),
        *check_software(),
    ]

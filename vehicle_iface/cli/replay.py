"""`vehicle-iface replay`: puts the frames of a recording back on a bus."""

import argparse
from pathlib import Path

from vehicle_iface.arming import is_virtual
from vehicle_iface.cli.channels import find_channels
from vehicle_iface.cli.exit_status import DONE
from vehicle_iface.cli.signals import Flag, on_end_signals
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.codec.database import load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.frame import FrameKey
from vehicle_iface.logs.replay import ReplayCounts, replay_log
from vehicle_iface.profile import load_profile
from vehicle_iface.recorder import files
from vehicle_iface.rerun.drive import load_options


def replay(options: argparse.Namespace) -> int:
    """Send the recorded frames until the end of the log, or a signal."""
    folder = Path(options.recording)
    recorded = load_options(folder)
    database = load_database(load_profile(folder / files.PROFILE / recorded.profile))
    profile = database.profile
    channels = find_channels(options.channels, profile, command="replay", interface=options.interface)
    for channel in channels.values():
        if not options.real_bus and not is_virtual(options.interface, channel):
            raise ConfigError(
                f"{channel} may be a real bus, where every node takes recorded frames for true: replay on vcan0, "
                "or add --real-bus"
            )
    if not (folder / files.FRAMES).exists():
        raise ConfigError(f"{folder}: no {files.FRAMES}: only the frames of a bus with a socket are recorded")
    numbers = {name: number for number, name in enumerate(recorded.channels)}
    ours = frozenset(message.key for message in database.sent)
    over = Flag()
    on_end_signals(over.set)
    counts = replay_log(
        folder / files.FRAMES,
        options.interface,
        dict(zip(recorded.channels, channels.values(), strict=True)),
        fd_channels=[
            channel for channel, bus in zip(channels.values(), profile.all_buses.values(), strict=True) if bus.fd
        ],
        leaves_out=lambda channel, can_id, is_extended: (
            not options.with_commands and FrameKey(can_id, is_extended, numbers[channel]) in ours
        ),
        is_over=lambda: over.is_set,
    )
    print_safely(_describe(counts))
    return DONE


def _describe(counts: ReplayCounts) -> str:
    rest = [
        (counts.left_out, "that the controller had sent were left out (--with-commands)"),
        (counts.errors, "error frames were left out"),
        (counts.other_channels, "of other channels were left out"),
        (counts.damaged, "damaged lines were left out"),
    ]
    return "; ".join([f"{counts.sent:,} frames sent", *(f"{count:,} {text}" for count, text in rest if count)])

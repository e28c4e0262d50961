"""Vehicle profiles: TOML, from the file to a loop that is made of it.

Law: a profile or `ConfigError`; inspecting gives findings. A profile that fits its DBC makes a loop and a controller.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import cast
from unittest.mock import create_autospec

from fuzzing.engine.input_bytes import written
from vehicle_iface import compose, drivable
from vehicle_iface.bus.base import Bus
from vehicle_iface.codec import lint
from vehicle_iface.codec.binding import Binding
from vehicle_iface.codec.consistency import find_faults
from vehicle_iface.codec.database import build_database
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.errors import ConfigError, InvalidValueError
from vehicle_iface.profile import Profile, inspect_profile, load_profile
from vehicle_iface.trajectories.mailbox import Mailbox

LENGTH = 12000
_DBC = {name: read_dbc(Path(load_profile(name).dbc)) for name in ("reference", "reference_fd")}


def run(data: bytes) -> None:
    path = written("fuzzed.toml", data)
    for finding in lint.check_file(path):
        assert "\n" not in str(finding)
    try:
        inspect_profile(path)
        profile = load_profile(path)
    except ConfigError:
        return
    _drive_with(profile)


def _drive_with(profile: Profile) -> None:
    file = _DBC.get(Path(profile.dbc).stem)
    if file is None:
        return
    binding = Binding(profile, file)
    if find_faults(binding):
        return
    database = build_database(binding)
    try:
        controller = compose.build_controller("pure_pursuit", profile)
        drivable.build_route("oval", profile)
    except (ConfigError, InvalidValueError):
        return
    compose.build_loop(
        database=database,
        open_bus=lambda: cast(Bus, create_autospec(Bus, instance=True, description="none")),
        controller=controller,
        source=Mailbox(),
        telemetry=None,
        armed=True,
        now_ns=lambda: 0,
    )


def seeds() -> Iterator[bytes]:
    for name in _DBC:
        text = Path(load_profile(name).file).read_text(encoding="utf-8")
        yield re.sub(r"\s*#.*$", "", text, flags=re.MULTILINE).encode()

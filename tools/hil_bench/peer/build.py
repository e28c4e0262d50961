"""The bus and the vehicle of a profile: the reference vehicle's where the profile has its contract, else a peer's."""

from collections.abc import Iterable, Mapping
from typing import Any

from vehicle_bus_contract import judge as contract
from vehicle_bus_contract.judge import Record
from vehicle_bus_contract.reference import Frame

from hil_bench.peer.examine import examine_peer
from hil_bench.peer.vehicle import PeerVehicle
from hil_bench.peer.wire import PeerWire
from hil_bench.plant import Plant
from hil_bench.profile import read_files
from hil_bench.vehicle import Vehicle
from hil_bench.wire import REQUIRED, Wire

NOT_OF_THE_CONTRACT = ("signals", "protection", "send", "buses")


def open_wire(profile: str) -> Wire:
    """The bus of any profile. Raises `ProfileError`."""
    tables = read_files(profile, strict=False).profile
    return Wire(profile) if has_bus_contract(tables) else PeerWire(profile)


def has_bus_contract(profile: Mapping[str, Any]) -> bool:
    """True where commands have the reference vehicle's signals, and every message its protection."""
    command = profile.get("command", {})
    return (
        "e2e" in profile
        and not any(table in profile for table in NOT_OF_THE_CONTRACT)
        and command.keys() <= {"signals"}
        and all(key in profile.get(part, {}).get("signals", {}) for part, keys in REQUIRED.items() for key in keys)
        and "pose" not in profile["state"]
        and not any(isinstance(form, Mapping) for form in profile["state"]["signals"].values())
    )


def examine(wire: Wire, frames: Iterable[Frame]) -> Record:
    """Judge a record of frames by the bus contract, or by a peer's profile."""
    return examine_peer(wire, frames) if isinstance(wire, PeerWire) else contract.examine(frames, wire)


def build_vehicle(wire: Wire) -> Vehicle:
    """The vehicle that the bench plays."""
    plant = Plant(wheelbase_m=float(wire.profile["geometry"]["wheelbase_m"]))
    return PeerVehicle(wire, plant) if isinstance(wire, PeerWire) else Vehicle(wire, plant)

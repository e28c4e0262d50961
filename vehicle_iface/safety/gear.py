"""Checks the reported gear against the direction of travel: no driving forwards in REVERSE, NEUTRAL or PARK."""

import logging

from vehicle_iface.status import Gear
from vehicle_iface.units import NS_PER_MS

log = logging.getLogger(__name__)

CONTRADICTS_NS = 200 * NS_PER_MS
"""A gear that does not fit for less is a change of gear."""
_DRIVE = Gear.DRIVE  # enumerations are slow to read


class GearCheck:
    """Compares the reported gear with the direction in which the vehicle is driven. Time is given."""

    def __init__(self, gear_change_speed_mps: float) -> None:
        """Up to this speed any gear may be in."""
        self._gear_change_speed_mps = gear_change_speed_mps
        self._since_ns: int | None = None
        self._contradicted: bool
        """Whether the gear has contradicted for long enough; set together with `_since_ns`."""
        self.count = 0
        """How often a contradiction was found."""

    def contradicts(self, speed_mps: float, needed: Gear, gear: Gear | None, now_ns: int) -> bool:
        """Whether the vehicle has moved as needed for 200 ms in a gear in which it cannot be driven so.

        `needed` is DRIVE, REVERSE, or NO_REQUEST for no direction; a `gear` of None is unknown. A vehicle that rolls
        against the needed direction may be in the needed gear.
        """
        along_mps = speed_mps if needed is _DRIVE else -speed_mps if needed is Gear.REVERSE else 0.0
        if gear is None or gear is needed or along_mps <= self._gear_change_speed_mps:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns, self._contradicted = now_ns, False
        if not self._contradicted and now_ns - self._since_ns >= CONTRADICTS_NS:
            self._contradicted = True
            self.count += 1
            log.warning("the gear is %s while the vehicle is driven at %.4g m/s", gear.name, speed_mps)
        return self._contradicted

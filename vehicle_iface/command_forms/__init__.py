"""From a permitted command to the form that the vehicle obeys, and back.

`build_former(profile, ranges)` makes what turns a `SafeCommand` (acceleration and road wheel angle, in SI units) into
the `WireCommand` that is encoded. `CommandReader` is the reverse, for a shadow and a simulated vehicle.
"""

from vehicle_iface.command_forms.former import CommandFormer, build_former
from vehicle_iface.command_forms.motion import MeasuredMotion, WireRange
from vehicle_iface.command_forms.reader import CommandReader, RequestedMotion

__all__ = ["CommandFormer", "CommandReader", "MeasuredMotion", "RequestedMotion", "WireRange", "build_former"]

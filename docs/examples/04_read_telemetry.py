"""Watch a running loop from another process: state, reference and counters, without costing the loop anything.

python docs/examples/04_read_telemetry.py [ADDRESS] [SECONDS]
"""

import sys

from vehicle_iface import Reason, clock
from vehicle_iface.status import ControllerState
from vehicle_iface.telemetry import TelemetryReader
from vehicle_iface.units import ns_from_s


def main(address: str, seconds: float) -> None:
    """Print one line each half second."""
    end_ns = clock.monotonic_ns() + ns_from_s(seconds)
    with TelemetryReader(address) as reader:
        while clock.monotonic_ns() < end_ns:
            reader.poll()
            snapshot, details = reader.newest(), reader.details()
            if snapshot is None:
                print(reader.problem)
            else:
                age_ms = (clock.monotonic_ns() - snapshot.published_ns) / 1e6
                print(
                    f"{ControllerState(snapshot.controller_state).name} {Reason(snapshot.reason).name}: "
                    f"{snapshot.speed_mps:.2f} m/s at ({snapshot.x_m:.2f}, {snapshot.y_m:.2f}) m, lateral error "
                    f"{snapshot.lateral_error_m:+.3f} m, {age_ms:.0f} ms old, "
                    f"drops {details.drops if details is not None else {}}",
                    flush=True,
                )
            clock.sleep_until(clock.monotonic_ns() + ns_from_s(0.5))


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "default", float(sys.argv[2]) if len(sys.argv) > 2 else 10.0)

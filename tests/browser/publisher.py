"""A process that publishes a drive along a figure of eight, as a loop would, without a bus.

It listens to one-word orders on standard input: a state of `_STATES`, or `freeze` (alive and silent) or `quit` (in
order). In `stale` the state grows old, `lost` is shadow without a reference, `ending` asks the driver to take over,
`broken` is a fault of the vehicle, `fast` adds 25 m/s, and positions of `huge` cannot be drawn.
"""

import argparse
import math
import os
import select
import sys

import numpy as np

from vehicle_iface import Reason, Trajectory, clock
from vehicle_iface.status import ControllerState, Gear, VehicleMode
from vehicle_iface.telemetry import SessionInfo, Snapshot, TelemetryWriter
from vehicle_iface.telemetry.details import LinkDetails, LiveDetails
from vehicle_iface.telemetry.events import EventKind, LoopEvent
from vehicle_iface.units import NS_PER_S, s_from_ns, wrapped_rad

_PERIOD_NS = NS_PER_S // 100
_LAP_S = 40.0
_POINTS = 2000
_WHEELBASE_M = 2.7


def figure_eight(stamp_ns: int, laps: int = 3) -> Trajectory:
    """Laps of an eight 60 m wide, slower in its bends."""
    u = np.linspace(0.0, laps * math.tau, laps * _POINTS)
    x_m, y_m = 30.0 * np.sin(u), 30.0 * np.sin(u) * np.cos(u)
    step_m = np.hypot(np.gradient(x_m), np.gradient(y_m))
    heading_rad = np.unwrap(np.arctan2(np.gradient(y_m), np.gradient(x_m)))
    curvature_per_m = np.gradient(heading_rad) / step_m
    speed_mps = np.clip(np.sqrt(1.6 / np.maximum(np.abs(curvature_per_m), 1e-3)), 2.0, 9.0)
    time_s = np.concatenate(([0.0], np.cumsum(step_m[1:] / speed_mps[1:])))
    return Trajectory(
        stamp_ns=stamp_ns,
        time_from_start_ns=(time_s * NS_PER_S).astype(np.int64),
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading_rad,
        speed_mps=speed_mps,
        yaw_rate_radps=curvature_per_m * speed_mps,
        front_wheel_angle_rad=np.arctan(curvature_per_m * _WHEELBASE_M),
    )


class Drive:
    """What the loop would know at each instant of the drive."""

    def __init__(self, trajectory: Trajectory, version: int) -> None:
        self._path = trajectory
        self._version = version
        self._samples = 0
        self.order = "engaged"
        self._stopped_at_ns = 0

    def snapshot(self, now_ns: int) -> Snapshot:
        is_stale = self.order == "stale"
        self._stopped_at_ns = 0 if not is_stale else self._stopped_at_ns or now_ns
        stamp_ns = self._stopped_at_ns or now_ns - 900_000
        self._samples += not is_stale
        path, index = self._path, self._index(stamp_ns)
        behind = max(index - 12, 0)
        wobble_m = 0.25 * math.sin(index / 90.0)
        heading_rad = float(path.heading_rad[behind])
        ahead = min(index + 60, len(path) - 1)
        accel_mps2 = 0.8 * math.sin(index / 140.0)
        state, reason = _STATES[self.order]
        is_sent = state in (ControllerState.ENGAGED, ControllerState.STOPPING)
        offset_m = 1e300 if self.order == "huge" else 0.0
        return Snapshot(
            published_ns=now_ns,
            controller_state=state,
            reason=reason,
            has_state=True,
            stamp_ns=stamp_ns,
            x_m=float(path.x_m[behind]) - wobble_m * math.sin(heading_rad) + offset_m,
            y_m=math.nan if offset_m else float(path.y_m[behind]) + wobble_m * math.cos(heading_rad),
            heading_rad=wrapped_rad(heading_rad + 0.02 * math.sin(index / 60.0)),
            speed_mps=float(path.speed_mps[behind]) + 0.15 * math.sin(index / 30.0) + 25.0 * (self.order == "fast"),
            accel_mps2=accel_mps2 - 0.1,
            yaw_rate_radps=float(path.yaw_rate_radps[behind]),
            front_wheel_angle_rad=float(path.front_wheel_angle_rad[behind]),
            has_status=True,
            vehicle_mode=VehicleMode.FAULT if self.order == "broken" else VehicleMode.AUTONOMOUS,
            gear=Gear.DRIVE,
            trajectory_version=self._version,
            has_reference=self.order != "lost",
            spatial_index=behind,
            temporal_index=index,
            spatial_reference_x_m=float(path.x_m[behind]),
            spatial_reference_y_m=float(path.y_m[behind]),
            temporal_reference_x_m=float(path.x_m[index]),
            temporal_reference_y_m=float(path.y_m[index]),
            reference_speed_mps=float(path.speed_mps[behind]),
            lateral_error_m=wobble_m,
            heading_error_rad=0.02 * math.sin(index / 60.0),
            has_lookahead=not is_stale,
            lookahead_x_m=float(path.x_m[ahead]),
            lookahead_y_m=float(path.y_m[ahead]),
            has_requested=True,
            requested_accel_mps2=-3.0 if is_stale else accel_mps2,
            requested_front_wheel_angle_rad=float(path.front_wheel_angle_rad[index]),
            sent=is_sent,
            sent_accel_mps2=-3.0 if is_stale else min(accel_mps2, 0.6),
            sent_front_wheel_angle_rad=float(path.front_wheel_angle_rad[index]) * 0.97,
            latency_ns=310_000 + 40_000 * (self._samples % 5),
            samples=self._samples,
            commands=self._samples,
            drops=self._samples // 500,
            handover_pending=self.order == "ending",
        )

    def _index(self, stamp_ns: int) -> int:
        past = np.searchsorted(self._path.time_from_start_ns, stamp_ns - self._path.stamp_ns, side="right")
        return min(max(int(past) - 1, 0), len(self._path) - 1)


_STATES = {
    "engaged": (ControllerState.ENGAGED, Reason.NOMINAL),
    "fast": (ControllerState.ENGAGED, Reason.NOMINAL),
    "override": (ControllerState.STANDBY, Reason.DRIVER_OVERRIDE),
    "ending": (ControllerState.STOPPING, Reason.SHUTDOWN),
    "broken": (ControllerState.FAULT, Reason.VEHICLE_FAULT),
    "huge": (ControllerState.ENGAGED, Reason.NOMINAL),
    "stale": (ControllerState.STOPPING, Reason.STATE_STALE),
    "fault": (ControllerState.FAULT, Reason.DEVIATION),
    "shadow": (ControllerState.SHADOW, Reason.NOT_ENGAGED),
    "lost": (ControllerState.SHADOW, Reason.NO_TRAJECTORY),
}


def _ordered(drive: Drive) -> bool:
    """Take orders from standard input; False when there will be no more."""
    while select.select([0], [], [], 0)[0]:
        words = os.read(0, 4096).split()
        if not words or words[-1] == b"quit":
            return False
        drive.order = words[-1].decode()
    return True


def _details(now_ns: int) -> LiveDetails:
    drops = {"bad CRC POSE": int(s_from_ns(now_ns)) % 7}
    return LiveDetails(link=LinkDetails(state="UP"), drops=drops, loop={"length": 0})


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("address")
    parser.add_argument("--bus", default="SocketCAN vcan0")
    parser.add_argument("--hint", default="")
    parser.add_argument("--route", default="figure8")
    parser.add_argument("--arming", default="armed")
    options = parser.parse_args()
    info = SessionInfo(
        channel="vcan0",
        bus=options.bus,
        bus_hint=options.hint,
        profile="reference",
        route=options.route,
        arming=options.arming,
        pid=os.getpid(),
    )
    now_ns = clock.monotonic_ns()
    trajectory = figure_eight(now_ns)
    with TelemetryWriter(options.address, info) as writer:
        drive = Drive(trajectory, writer.publish_trajectory(trajectory))
        number, noted = 0, ""
        print("publishing", flush=True)
        while _ordered(drive):
            if drive.order != "freeze":
                now_ns = clock.monotonic_ns()
                writer.publish(drive.snapshot(now_ns))
                writer.publish_details(_details(now_ns))
                if drive.order != noted:
                    noted, number = drive.order, number + 1
                    state, reason = _STATES[noted]
                    writer.publish_event(
                        LoopEvent(number=number, at_ns=now_ns, kind=EventKind.MODE, name=state.name, text=reason.name)
                    )
            clock.sleep_until(clock.monotonic_ns() + _PERIOD_NS)
    sys.exit(0)


if __name__ == "__main__":
    main()

"""Simulated drives as logs, with the noise of sensors that are good enough to drive by."""

from collections.abc import Callable, Iterable, Sequence
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from tests.harness import Drive, reference
from tests.kinematics import SensorNoise
from vehicle_iface.codec.decoder import Decoder
from vehicle_iface.codec.encoder import Encoder
from vehicle_iface.frame import CanFrame
from vehicle_iface.profile import load_profile
from vehicle_iface.review.review import Review, review_drive
from vehicle_iface.review.series import read_drive
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.route import RouteConfig
from vehicle_iface.trajectories.shapes import make_route
from vehicle_iface.units import NS_PER_MS, wrapped_rad

DBC_FOLDER = Path(__file__).resolve().parents[2] / "dbc"
Frames = Sequence[CanFrame]


@cache
def record(route: str, seconds: float = 40.0) -> tuple[CanFrame, ...]:
    """All frames of a drive along a route, exact but for what the wire can express."""
    drive = Drive(RecedingRoute(make_route(route, RouteConfig(speed_mps=6.0))))
    frames: list[CanFrame] = []
    drain, send = drive.line.drain, drive.line.send

    def drain_too() -> list[CanFrame]:
        received = drain()
        frames.extend(received)
        return received

    def send_too(*sent: CanFrame) -> int:
        frames.extend(frame._replace(stamp_ns=drive.clock.t_ns) for frame in sent)
        return send(*sent)

    drive.line.drain, drive.line.send = drain_too, send_too  # type: ignore[method-assign]
    drive.run_s(seconds)
    return tuple(frames)


@cache
def record_noisily(route: str, seed: int = 0) -> tuple[CanFrame, ...]:
    """The same as sensors see it: white noise, and constant errors."""
    return tuple(rewrite(record(route), disturbance(np.random.default_rng(seed))))


def disturbance(rng: np.random.Generator, *, times: float = 1.0) -> Callable[[dict[str, float]], None]:
    """Adds sensor errors to the fields of a message: white noise, `times` that of good sensors, and constant errors."""
    noise = SensorNoise()
    errors = {
        "x_m": (noise.position_m, 0.0, 1.0),
        "y_m": (noise.position_m, 0.0, 1.0),
        "heading_rad": (noise.heading_rad, noise.heading_offset_rad, 1.0),
        "speed_mps": (noise.speed_mps, 0.0, noise.speed_scale),
        "accel_mps2": (noise.accel_mps2, noise.accel_offset_mps2, 1.0),
        "yaw_rate_radps": (noise.yaw_rate_radps, noise.yaw_rate_offset_radps, 1.0),
        "lateral_speed_mps": (noise.lateral_speed_mps, 0.0, 1.0),
        "front_wheel_angle_rad": (noise.front_wheel_rad, noise.front_wheel_offset_rad, 1.0),
    }

    def disturb(values: dict[str, float]) -> None:
        for field in (name for name in errors if name in values):
            sigma, offset, scale = errors[field]
            values[field] = values[field] * scale + offset + rng.normal(0.0, times * sigma)
        if "heading_rad" in values:
            values["heading_rad"] = wrapped_rad(values["heading_rad"])

    return disturb


def rewrite(frames: Iterable[CanFrame], change: Callable[[dict[str, float]], None]) -> list[CanFrame]:
    """The frames, with the fields of each message of the sample as `change` leaves them."""
    return Rewriter(change).rewrite(frames)


class Rewriter:
    """Changes the fields of each message of the sample; counters go on from call to call."""

    def __init__(self, change: Callable[[dict[str, float]], None]) -> None:
        self._change, sample = change, reference().sample
        self._messages = {message.can_id: message for message in sample}
        self._decoder, self._encoder = Decoder(sample), Encoder(sample)

    def rewrite(self, frames: Iterable[CanFrame]) -> list[CanFrame]:
        """The frames in their order."""
        return [self._rewrite_frame(frame) for frame in frames]

    def _rewrite_frame(self, frame: CanFrame) -> CanFrame:
        decoded = self._decoder.decode(frame) if frame.can_id in self._messages else None
        if decoded is None:
            return frame
        pairs = zip(self._messages[frame.can_id].fields, decoded.values, strict=True)
        values = {field: value for field, value in pairs if value is not None}
        self._change(values)
        again = self._encoder.encode(decoded.name, SimpleNamespace(**values))
        self._encoder.commit((again,))
        return again._replace(stamp_ns=frame.stamp_ns)


def delay(frames: Frames, message: str, delay_ms: float) -> list[CanFrame]:
    """The frames, those of one message later."""
    can_id = next(one.can_id for one in reference().received if one.name == message)
    late = [f._replace(stamp_ns=f.stamp_ns + round(delay_ms * NS_PER_MS)) if f.can_id == can_id else f for f in frames]
    return sorted(late, key=lambda frame: frame.stamp_ns)


def write_log(path: Path, frames: Iterable[CanFrame]) -> Path:
    """As `candump -L` writes it."""
    lines = (f"({f.stamp_ns / 1e9:.6f}) can0 {f.can_id:03X}#{f.data.hex().upper()}\n" for f in frames)
    path.write_text("".join(lines))
    return path


def review(folder: Path, frames: Iterable[CanFrame], more: str = "", **edits: str) -> Review:
    """What a drive says about the reference profile with keys set to other values, and `more` at its end."""
    lines = (DBC_FOLDER / "reference.toml").read_text().splitlines()
    for key, value in edits.items():
        places = [index for index, line in enumerate(lines) if line.startswith(f"{key} = ")]
        assert len(places) == 1, key
        lines[places[0]] = f"{key} = {value}"
    return review_profile(folder, frames, "\n".join([*lines, more, ""]))


def review_profile(folder: Path, frames: Iterable[CanFrame], profile: str) -> Review:
    """What a drive says about a profile of the reference vehicle."""
    (folder / "reference.dbc").write_bytes((DBC_FOLDER / "reference.dbc").read_bytes())
    (folder / "profile.toml").write_text(profile)
    log = write_log(folder / "drive.log", frames)
    return review_drive(read_drive(log, load_profile(folder / "profile.toml")))


def note(signal: str, *lines: str) -> str:
    """A note of a profile on a signal."""
    return "\n".join([f'[signals."{signal}"]', *lines])

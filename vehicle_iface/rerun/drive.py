"""Runs a recorded drive again, through the code of today, and compares each frame that it sends."""

from collections.abc import Iterator
from pathlib import Path

from vehicle_iface import compose, drivable
from vehicle_iface.arming import cap_speed
from vehicle_iface.codec.database import VehicleDatabase, load_database
from vehicle_iface.errors import ConfigError
from vehicle_iface.export.page.render import write_page
from vehicle_iface.frame import FrameKey
from vehicle_iface.logs.frames import EXTENDED
from vehicle_iface.logs.reading import open_log
from vehicle_iface.motion_sources import cap_unconfirmed_speed
from vehicle_iface.profile import Profile, load_profile
from vehicle_iface.recorder import files
from vehicle_iface.recorder.inputs import FrameFields, PassInputs, read_inputs
from vehicle_iface.rerun.compare import Comparison
from vehicle_iface.rerun.plot import SentTrace, render_differences
from vehicle_iface.rerun.replayed import ReplayedInputs, ReplayedSource, sent_frames
from vehicle_iface.rerun.report import RerunReport
from vehicle_iface.runtime.loop import Loop
from vehicle_iface.trajectories.receding import RecedingRoute
from vehicle_iface.trajectories.source import FixedTrajectory, TrajectorySource
from vehicle_iface.units import s_from_ns


def rerun(
    folder: Path, *, profile: str | None = None, controller: str | None = None, plot: Path | None = None
) -> RerunReport:
    """Run the drive in a recording again; `profile` and `controller` replace the recorded ones.

    `plot`: write a page of the signals that differ to this file. Raises `ConfigError` when the folder is no recording
    with inputs, when what it names cannot be loaded, or when the page cannot be written.
    """
    options = load_options(folder)
    passes = read_inputs(folder / files.INPUTS)
    first = next(passes, None)
    if first is None or first.number != 0:
        raise ConfigError(f"{folder / files.INPUTS}: the first inputs are missing, so nothing can be run again")
    replay = ReplayedInputs(first)
    database = load_database(
        cap_unconfirmed_speed(cap_speed(_profile(folder, options, profile), options.speed_cap_mps))
    )
    loop = _build_loop(folder, options, database, replay, controller)
    comparison = Comparison(database)
    trace = SentTrace() if plot is not None else None
    drive = _Drive(folder, loop, replay, comparison, trace)
    drive.run(passes)
    if (folder / files.FRAMES).exists():
        drive.compare_log(folder / files.FRAMES, options.channels)
    if plot is not None and trace is not None:
        write_page(render_differences(drive.report, trace, comparison), plot, "--plot")
    return drive.report


def load_options(folder: Path) -> files.RunOptions:
    """Return the options that the drive was run with. Raises `ConfigError` when they are not recorded."""
    meta = files.load_meta(folder)
    if meta.run is None:
        raise ConfigError(f"{folder}: recorded by a version that kept no inputs, so it cannot be run again")
    return meta.run


class _Drive:
    """A loop that gets the recorded inputs."""

    def __init__(
        self, folder: Path, loop: Loop, replay: ReplayedInputs, comparison: Comparison, trace: SentTrace | None
    ) -> None:
        """`trace` keeps all frames, for a plot."""
        self._loop, self._replay, self._comparison, self._trace = loop, replay, comparison, trace
        self._started_ns = replay.inputs.clock_ns[0] if replay.inputs.clock_ns else 0
        self._ends = 0
        self._sent: list[tuple[int, float, FrameFields]] = []
        self.report = RerunReport(folder=str(folder), passes=1)

    def run(self, passes: Iterator[PassInputs]) -> None:
        """Run all passes up to the first that is missing."""
        for inputs in passes:
            if inputs.number != self.report.passes:
                self.report.gap = (
                    f"passes {self.report.passes} to {inputs.number - 1} are missing in {files.INPUTS}: "
                    "what comes after them cannot be compared"
                )
                return
            self._replay.begin_pass(inputs)
            self._apply_requests(inputs)
            if inputs.number == 1:
                self._loop.begin()
            else:
                self._loop.step()
            self._compare(inputs)
            self.report.passes += 1

    def compare_log(self, path: Path, channels: list[str]) -> None:
        """Compare what was sent today with what was seen on the bus."""
        for difference in self._comparison.compare_log(self._sent, _read_log(path, channels)):
            if difference is None:
                self.report.log_frames += 1
            else:
                self.report.add(difference)

    def _apply_requests(self, inputs: PassInputs) -> None:
        requests, loop = inputs.requests, self._loop
        if requests.scheduled_ns:
            loop.shutdown.schedule(requests.scheduled_ns)
        if requests.is_due:
            loop.shutdown.begin_on_schedule()
        if requests.arm:
            loop.arming.request()
        for _ in range(requests.ends - self._ends):
            loop.shutdown.request()
        self._ends = max(self._ends, requests.ends)

    def _compare(self, inputs: PassInputs) -> None:
        at_s = s_from_ns(inputs.clock_ns[0] - self._started_ns) if inputs.clock_ns else 0.0
        recorded = sent_frames(inputs)
        self.report.frames += len(recorded)
        for difference in self._comparison.compare_pass(inputs.number, at_s, recorded, self._replay.sent):
            self.report.add(difference)
        if self._trace is not None:
            self._trace.add_pass(at_s, recorded, self._replay.sent)
        self._sent += ((inputs.number, at_s, frame) for frame in self._replay.accepted)


def _profile(folder: Path, options: files.RunOptions, replacement: str | None) -> Profile:
    if replacement is not None:
        return load_profile(replacement)
    return load_profile(folder / files.PROFILE / options.profile)


def _build_loop(
    folder: Path,
    options: files.RunOptions,
    database: VehicleDatabase,
    replay: ReplayedInputs,
    controller: str | None,
) -> Loop:
    file, _, name = options.controller.rpartition(":")
    recorded = f"{folder / files.INPUT_FILES / Path(file).name}:{name}" if file.endswith(".py") else options.controller
    return compose.build_loop(
        database=database,
        open_bus=lambda: replay.open_bus(database.profile.all_buses),
        controller=compose.build_controller(controller or recorded, database.profile),
        source=_build_source(folder, options, database, replay),
        telemetry=None,
        armed=options.armed,
        now_ns=replay.now_ns,
        sleep_until=lambda _: None,
    )


def _build_source(
    folder: Path, options: files.RunOptions, database: VehicleDatabase, replay: ReplayedInputs
) -> TrajectorySource:
    if options.trajectory is not None:
        file = folder / files.INPUT_FILES / options.trajectory
        return FixedTrajectory(drivable.load_trajectory(str(file), database.profile))
    if options.route is not None:
        return RecedingRoute(drivable.build_route(options.route, database.profile), frame_id=options.frame_id)
    return ReplayedSource(replay)


def _read_log(path: Path, channels: list[str]) -> dict[FrameKey, list[bytes]]:
    """The payloads of each identifier in `frames.log`, in their order."""
    found: dict[FrameKey, list[tuple[int, bytes]]] = {}
    for chunk in open_log(path).chunks:
        for frames in chunk.frames:
            if frames.channel not in channels:
                continue
            bus, data = channels.index(frames.channel), frames.data.tobytes()
            size = frames.data.shape[1]
            for place, (line, key) in enumerate(zip(frames.lines.tolist(), frames.keys.tolist(), strict=True)):
                identity = FrameKey(key & ~EXTENDED, bool(key & EXTENDED), bus)
                found.setdefault(identity, []).append((line, data[place * size : (place + 1) * size]))
    return {key: [data for _, data in sorted(lines)] for key, lines in found.items()}

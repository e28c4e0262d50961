"""Trajectories from other threads and other processes."""

import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle_iface import Trajectory, VehicleState
from vehicle_iface.errors import TrajectoryFileError
from vehicle_iface.trajectories import mailbox
from vehicle_iface.trajectories.mailbox import MAX_POINTS, Mailbox, MailboxFile, fetch, publish_trajectory

PADDING = range(12, 16)
"""Bytes of a post that say nothing."""
STATE = VehicleState(stamp_ns=0, x_m=0.0, y_m=0.0, heading_rad=0.0, speed_mps=0.0)


def line(stamp_ns: int = 0, n: int = 3) -> Trajectory:
    zeros = np.zeros(n)
    return Trajectory(
        stamp_ns=stamp_ns,
        frame_id="odom",
        time_from_start_ns=np.arange(n),
        x_m=np.arange(n, dtype=float),
        y_m=zeros,
        heading_rad=zeros,
        speed_mps=zeros + 1.0,
    )


def test_only_the_newest_trajectory_is_taken_and_only_once() -> None:
    mailbox = Mailbox()
    mailbox.put(line(1))
    newest = line(2)
    mailbox.put(newest)
    assert mailbox.next(0, STATE) is newest
    assert mailbox.next(0, STATE) is None


def test_nothing_put_by_another_thread_is_taken_twice_or_out_of_order() -> None:
    mailbox = Mailbox()
    put = [line(stamp_ns) for stamp_ns in range(2000)]

    def put_all() -> None:
        for trajectory in put:
            mailbox.put(trajectory)

    thread = threading.Thread(target=put_all)
    thread.start()
    taken = []
    while thread.is_alive() or mailbox._newest:
        trajectory = mailbox.next(0, STATE)
        if trajectory is not None:
            taken.append(trajectory.stamp_ns)
    thread.join()
    assert taken == sorted(set(taken))
    assert taken[-1] == 1999


def test_a_posted_trajectory_is_received_unchanged(tmp_path: Path) -> None:
    publish_trajectory(tmp_path / "t", line(7))
    fetched = fetch(tmp_path / "t")
    assert (fetched.stamp_ns, fetched.frame_id, fetched.x_m.tolist()) == (7, "odom", [0.0, 1.0, 2.0])
    assert [file.name for file in tmp_path.iterdir()] == ["t"]


def test_another_process_posts_and_the_loop_takes_it(tmp_path: Path) -> None:
    source = MailboxFile(tmp_path / "t")
    script = f"""
from vehicle_iface import Trajectory
from vehicle_iface.trajectories.mailbox import publish_trajectory
publish_trajectory({str(tmp_path / "t")!r}, Trajectory(stamp_ns=9, time_from_start_ns=[0], x_m=[1.0], y_m=[2.0],
     heading_rad=[0.0], speed_mps=[0.0]))
"""
    subprocess.run([sys.executable, "-c", script], check=True)
    trajectory = None
    deadline = time.monotonic() + 20
    while trajectory is None and time.monotonic() < deadline:
        trajectory = source.next(0, STATE)
    source.close()
    assert trajectory is not None
    assert trajectory.stamp_ns == 9


def test_an_unreadable_path_is_logged_once_and_ends_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    folder = tmp_path / "folder"
    source = MailboxFile(folder / "t")
    source.close()  # its thread: here the test looks
    folder.write_text("not a folder")
    for _ in range(3):
        source._look()
    assert [record.message for record in caplog.records] == [
        f"trajectory mailbox {folder / 't'}: cannot be read: Not a directory"
    ]
    folder.unlink()
    folder.mkdir()
    source._look()
    publish_trajectory(folder / "t", line(7))
    source._look()
    trajectory = source.next(0, STATE)
    assert trajectory is not None
    assert (trajectory.stamp_ns, source.refused) == (7, 0)


def long_line(points: int) -> Trajectory:
    columns = {name: np.zeros(points) for name in ("x_m", "y_m", "heading_rad", "speed_mps")}
    return Trajectory(stamp_ns=1, frame_id="m" * 64, time_from_start_ns=np.zeros(points, dtype=np.int64), **columns)


def test_a_post_has_no_more_points_than_can_be_read_while_the_vehicle_drives(tmp_path: Path) -> None:
    publish_trajectory(tmp_path / "t", long_line(20_000))
    assert len(fetch(tmp_path / "t")) == MAX_POINTS == 20_000
    with pytest.raises(TrajectoryFileError, match=f"{MAX_POINTS + 1} points: a mailbox takes at most {MAX_POINTS}"):
        publish_trajectory(tmp_path / "t", long_line(MAX_POINTS + 1))
    with (tmp_path / "t").open("ab") as file:
        file.write(b"\0")
    with pytest.raises(TrajectoryFileError, match=f"t: a mailbox takes at most {MAX_POINTS} points"):
        fetch(tmp_path / "t")


def no_memory(_: object) -> Trajectory:
    raise MemoryError


def test_a_post_that_there_is_no_memory_for_is_refused_and_the_next_one_is_read(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = MailboxFile(tmp_path / "t")
    source.close()  # its thread: here the test looks
    publish_trajectory(tmp_path / "t", line(7))
    size = (tmp_path / "t").stat().st_size
    with monkeypatch.context() as little:
        little.setattr(mailbox, "fetch", no_memory)
        source._look()
    assert caplog.messages == [f"mailbox trajectory rejected: {tmp_path / 't'}: no memory for its {size} bytes"]
    assert source.refused == 1
    publish_trajectory(tmp_path / "t", line(8))
    source._look()
    assert source.next(0, STATE) is not None


@given(st.binary(max_size=300))
def test_a_file_that_is_no_trajectory_is_refused_by_name(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("posted") / "t"
    path.write_bytes(content)
    with pytest.raises(TrajectoryFileError, match="t: "):
        fetch(path)


@given(st.data())
def test_a_damaged_post_is_refused_or_whole(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    path = tmp_path_factory.mktemp("posted") / "t"
    publish_trajectory(path, line(7))
    content = bytearray(path.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    if place in PADDING:
        assert fetch(path).x_m.tolist() == [0.0, 1.0, 2.0]
    else:
        with pytest.raises(TrajectoryFileError, match="t: not a mailbox trajectory, or damaged"):
            fetch(path)

"""The device's process: descriptors, memory and children."""

import signal
import sys
import time
from pathlib import Path

from hil_bench.device import Commands, Device

from tests.narrowing import at_present


def test_a_device_starts_with_many_descriptors_and_can_be_denied_memory(tmp_path: Path) -> None:
    grows = "import os, time; print(os.open('/', 0), flush=True); time.sleep(0.5); bytearray(1 << 28)"
    starved, fed = (
        Device(Commands(start=f'{sys.executable} -c "{grows}"'), tmp_path / name, {}, lambda _: None)
        for name in ("starved", "fed")
    )
    for device in (starved, fed):
        device.start(open_files=1100)
    while not (starved.log.read_text() and fed.log.read_text()):
        time.sleep(0.01)
    with starved.without_memory():
        while starved.poll() is None or fed.poll() is None:
            time.sleep(0.01)
    assert (starved.status, fed.status) == (1, 0)
    assert "MemoryError" in starved.log.read_text()
    assert int(fed.log.read_text()) > 1100
    with starved.without_memory():
        pass  # one that has ended is judged for that, and is no mistake of the bench's


def test_the_recording_process_is_found_among_all_children_of_the_device(
    tmp_path: Path,
) -> None:
    place = tmp_path / "disk"
    place.mkdir()
    command = f"sh -c 'sleep 60 & sleep 60 > {place}/drive & wait'"
    device = Device(Commands(start=command), tmp_path / "log", {}, lambda _: None)
    assert device.writers(place) == []
    device.start()
    try:
        while not (found := device.writers(place)):
            assert device.poll() is None
        (writer,) = found
        assert at_present(writer.is_alive)
        writer.send(signal.SIGKILL)
        while writer.is_alive:
            time.sleep(0.01)
        writer.send(signal.SIGKILL)  # to nobody
        writer.close()
        assert device.writers(place) == []
        assert device.poll() is None
    finally:
        device.kill()
    assert device.writers(place) == []

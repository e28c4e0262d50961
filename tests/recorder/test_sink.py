"""A disk that is full, and one that has room again: the kernel's own limit on a file's size stands in for it."""

import resource
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from vehicle_iface.recorder.sink import RETRY_NS, Sink
from vehicle_iface.units import NS_PER_S

LINE = b"123456789\n"


@contextmanager
def room(size: int) -> Iterator[None]:
    """No file of this process may grow beyond `size` bytes."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def sink(tmp_path: Path, said: list[str]) -> Iterator[Sink]:
    made = Sink(tmp_path / "file", said.append, b"header\n")
    yield made
    made.close()


@pytest.fixture
def content(tmp_path: Path) -> Callable[[], bytes]:
    return (tmp_path / "file").read_bytes


def test_lines_are_there_at_once(sink: Sink, content: Callable[[], bytes], said: list[str]) -> None:
    sink.write([LINE, LINE], 0)
    sink.write([], 1)
    assert content() == b"header\n" + 2 * LINE
    assert (sink.written, sink.lost, sink.trouble, said) == (2, 0, "", [])


@pytest.mark.parametrize("size", range(7, 38))
def test_a_line_without_room_is_counted_and_none_is_truncated(
    sink: Sink, content: Callable[[], bytes], said: list[str], size: int
) -> None:
    with room(size):
        sink.write([LINE] * 3, 0)
    fits = (size - 7) // 10
    assert content() == b"header\n" + fits * LINE
    assert (sink.written, sink.lost) == (fits, 3 - fits)
    assert (len(said), bool(sink.trouble)) == ((1, True) if fits < 3 else (0, False))


def test_writing_is_retried_after_a_second_and_both_are_logged_once(
    sink: Sink, content: Callable[[], bytes], said: list[str]
) -> None:
    with room(12):
        for k in range(5):
            sink.write([LINE], k)
    sink.write([LINE], NS_PER_S - 1)
    assert (sink.written, sink.lost, len(said)) == (0, 6, 1)
    sink.write([LINE, LINE], NS_PER_S)
    assert content() == b"header\n" + 2 * LINE
    assert (sink.written, sink.lost, sink.trouble) == (2, 6, "")
    assert said == [
        "file: no room for all of it; new lines are lost and counted, the drive continues",
        "file: writable again; 6 lines lost so far",
    ]


def test_a_full_disk_is_logged_once(sink: Sink, said: list[str]) -> None:
    with room(12):
        for k in range(10):
            sink.write([LINE], k * RETRY_NS)
    assert sink.lost == 10
    assert len(said) == 1


def test_without_room_for_its_header_no_file_is_left(tmp_path: Path, said: list[str]) -> None:
    with room(3), pytest.raises(OSError, match="No space left"):
        Sink(tmp_path / "other", said.append, b"header\n")


def test_nothing_is_overwritten(tmp_path: Path, sink: Sink, said: list[str]) -> None:
    sink.write([LINE], 0)
    with pytest.raises(FileExistsError):
        Sink(tmp_path / "file", said.append)

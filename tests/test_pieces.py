"""Long work in pieces."""

import errno
import mmap
from collections.abc import Generator

import numpy as np
import pytest

from vehicle_iface.pieces import PIECE, Scratch, finish, slices


def adding_up(count: int) -> Generator[None, None, int]:
    total = 0
    for number in range(count):
        total += number
        yield
    return total


@pytest.mark.parametrize("count", [0, 1, 5])
def test_work_done_at_once_has_its_result(count: int) -> None:
    assert finish(adding_up(count)) == sum(range(count))


@pytest.mark.parametrize("count", [0, 1, 2, 3, 7])
def test_slices_cover_each_point_once(count: int) -> None:
    points = np.arange(count)
    covered = [point for part in slices(count, 3) for point in points[part].tolist()]
    assert covered == points.tolist()
    assert all(part.stop - part.start <= 3 for part in slices(count, 3))


@pytest.mark.parametrize("count", [1, PIECE, PIECE + 1, 20 * PIECE])
def test_scratch_keeps_its_numbers_until_it_is_released_in_pieces(count: int) -> None:
    scratch = Scratch(count)
    scratch.numbers[:] = np.arange(count)
    assert scratch.numbers.tolist() == list(range(count))
    pieces = sum(1 for _ in scratch.release())
    assert pieces == (-(-8 * count // 2**18) if count > PIECE else 0)


def test_released_scratch_takes_no_memory() -> None:
    count = 2**20
    scratch = Scratch(count)
    scratch.numbers[:] = 1.0
    for _ in scratch.release():
        pass
    assert not scratch.numbers.any()  # the system gives zeros for pages that it took back


def test_scratch_memory_that_is_refused_is_a_memory_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    monkeypatch.setattr(mmap, "mmap", refuse)
    with pytest.raises(MemoryError, match="no memory for 100000 numbers"):
        Scratch(100_000)

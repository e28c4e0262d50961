"""The monotonic clock, and sleeping until a moment."""

from vehicle_iface import clock


def test_the_monotonic_clock_is_integer_and_never_goes_back() -> None:
    stamps = [clock.monotonic_ns() for _ in range(1000)]
    assert stamps == sorted(stamps)
    assert all(type(stamp) is int for stamp in stamps)


def test_sleeping_until_a_moment_gone_by_returns_and_until_a_coming_one_waits_for_it() -> None:
    clock.sleep_until(clock.monotonic_ns() - 10**12)
    deadline_ns = clock.monotonic_ns() + 2_000_000
    clock.sleep_until(deadline_ns)
    assert clock.monotonic_ns() >= deadline_ns

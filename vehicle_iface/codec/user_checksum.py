"""Computes a checksum with a user's Python function."""

import importlib.util
import logging
import sys
import traceback
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType

from vehicle_iface.codec.checksums import BitPlace
from vehicle_iface.errors import ConfigError, SignalError
from vehicle_iface.profile.protection import locate_function

log = logging.getLogger("vehicle_iface")

UserFunction = Callable[[int, bytes], object]
"""`checksum(can_id, data)` returns the checksum; the checksum's own bits in `data` are 0."""


def load_function(place: str, folder: Path) -> UserFunction:
    """Load the function of `FILE.py:NAME`, relative to `folder`.

    Any exception that the file raises becomes a `ConfigError` with file and line.
    """
    located = locate_function(place, folder)
    path, name = located.file, located.name
    if path.suffix != ".py" or not name:
        raise ConfigError(f"{place!r}: must be FILE.py:FUNCTION")
    if not path.is_file():
        raise ConfigError(f"{place!r}: no such file {path}")
    try:
        function: UserFunction | None = getattr(_load_module(path, path.stat().st_mtime_ns), name, None)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise ConfigError(f"{place!r}: {describe_error(error)}") from error
    if not callable(function):
        raise ConfigError(f"{place!r}: there is no function {name} in {path}")
    return function


def check_function(function: UserFunction, can_id: int, length: int, place: BitPlace) -> str:
    """Try the function with payloads of all zeros and all ones; describe what is wrong, or return ""."""
    for data in (bytes(length), place.clear(b"\xff" * length)):
        try:
            results = [function(can_id, data) for _ in range(2)]
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # noqa: BLE001 - a user's code; reported with file and line
            return describe_error(error)
        for result in results:
            if not _fits(result, place.width):
                return f"returned {result!r} for {data.hex()}; must be an int in [0, {place.mask}]"
        if results[0] != results[1]:
            return f"returned {results[0]!r} and {results[1]!r} for the same {data.hex()}"
    return ""


class UserChecksum:
    """The user's function for one message. It is guarded: no payload makes `matches` raise."""

    def __init__(self, function: UserFunction, message_name: str, can_id: int, width: int) -> None:
        self._function = function
        self._message_name = message_name
        self._can_id = can_id
        self._width = width
        self._has_failed = False

    def compute(self, data: bytes) -> int:
        """Return the checksum of a payload to be sent; raises `SignalError` if the function fails."""
        try:
            number = self._function(self._can_id, data)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise SignalError(f"{self._message_name}: checksum: {describe_error(error)}") from error
        if not isinstance(number, int) or not _fits(number, self._width):
            raise SignalError(f"{self._message_name}: checksum = {number!r}: must be an int of {self._width} bits")
        return number

    def matches(self, data: bytes, number: int) -> bool:
        """Whether the checksum of a received payload is `number`; False if the function fails."""
        try:
            return self.compute(data) == number
        except SignalError as error:
            if not self._has_failed:
                log.error("%s; frames on which it fails are dropped as damaged", error)
            self._has_failed = True
            return False


def describe_error(error: BaseException) -> str:
    """Describe an exception of the user's code, with file and line."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    line = error.lineno if isinstance(error, SyntaxError) else where.lineno
    file = error.filename if isinstance(error, SyntaxError) else where.filename
    return f"{type(error).__name__}: {error} ({file}:{line})"


def _fits(number: object, width: int) -> bool:
    return isinstance(number, int) and 0 <= number < 1 << width


@cache
def _load_module(path: Path, _changed_ns: int) -> ModuleType:
    """Load the module in a file once for all messages, under a name that no other module has."""
    name = f"vehicle_iface_checksum_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"{path}: cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module

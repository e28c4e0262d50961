"""The classes of cantools that describe messages and signals, without its readers of files and its bench tools.

`import cantools` also imports its tester and python-can, and `import cantools.database` readers of five file formats,
which this package does not use: together 10 MB and a third of a second of the control process. So cantools' packages
are put in place here without running their `__init__`, which runs when somebody needs another name of them.
"""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import PathFinder
from types import ModuleType
from typing import Any

_PACKAGES = (
    "cantools",
    "cantools.database",
    "cantools.database.can",
    "cantools.database.can.formats",
    "cantools.database.can.formats.dbc",
)


class _LatePackage(ModuleType):
    """A package whose `__init__` runs when it is asked for a name that it does not have; so do those above it."""

    def __getattr__(self, name: str) -> Any:
        for package in map(sys.modules.get, _PACKAGES[: _PACKAGES.index(self.__name__) + 1]):
            if isinstance(package, _LatePackage) and package.__spec__ is not None:
                package.__class__ = ModuleType  # type: ignore[assignment]
                package.__path__ = package.__spec__.submodule_search_locations or []
                assert package.__spec__.loader is not None
                package.__spec__.loader.exec_module(package)
        return getattr(self, name)


@contextmanager
def _late_packages() -> Iterator[None]:
    """Let modules of cantools be imported without the packages around them; does nothing if these are imported."""
    search, placed = None, list[ModuleType]()
    for name in _PACKAGES:
        if name not in sys.modules:
            spec = PathFinder.find_spec(name, search)
            if spec is None:
                raise ModuleNotFoundError(f"No module named {name!r}", name=name)
            sys.modules[name] = importlib.util.module_from_spec(spec)
            sys.modules[name].__class__ = _LatePackage
            if placed:
                setattr(placed[-1], name.rpartition(".")[2], sys.modules[name])
            placed.append(sys.modules[name])
        search = sys.modules[name].__path__
    yield
    for package in placed:
        del package.__path__  # from now on, the import of another module asks for it


with _late_packages():
    from cantools.database.can.formats.dbc.dbc_specifics import DbcSpecifics
    from cantools.database.can.message import Message
    from cantools.database.can.signal import Signal
    from cantools.database.conversion import (
        BaseConversion,
        IdentityConversion,
        LinearConversion,
        LinearIntegerConversion,
    )
    from cantools.database.errors import Error
    from cantools.database.namedsignalvalue import NamedSignalValue

__all__ = [
    "BaseConversion",
    "DbcSpecifics",
    "Error",
    "IdentityConversion",
    "LinearConversion",
    "LinearIntegerConversion",
    "Message",
    "NamedSignalValue",
    "Signal",
]

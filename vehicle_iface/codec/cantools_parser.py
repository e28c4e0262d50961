"""Loads cantools' DBC parser without the bench tools of the same package.

`import cantools` also imports its tester and python-can, which costs the control process 10 MB and a third of a second.
The parser needs neither. It is therefore loaded below a placeholder package that only tells Python where the modules
are. A later `import cantools` loads the rest and keeps this parser.
"""

import importlib
import importlib.machinery
import importlib.util
import sys


def load() -> None:
    """Import `cantools.database`. Does nothing if cantools has already been imported."""
    if "cantools" in sys.modules or "cantools.database" in sys.modules:
        return
    found = importlib.machinery.PathFinder.find_spec("cantools")
    if found is None:
        raise ModuleNotFoundError("No module named 'cantools'", name="cantools")
    place = importlib.machinery.ModuleSpec("cantools", None, is_package=True)
    place.submodule_search_locations = found.submodule_search_locations
    sys.modules["cantools"] = importlib.util.module_from_spec(place)
    try:
        importlib.import_module("cantools.database")
    finally:
        del sys.modules["cantools"]


load()

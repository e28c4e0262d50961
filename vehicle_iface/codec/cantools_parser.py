"""Loads cantools' parser, and not the bench tools that its package brings along.

`import cantools` also imports its tester, and with that python-can: 10 MB and a third of a second in the control
process for nothing. The parser imports neither, so it is loaded under a package that is only a place to look for
modules. A later `import cantools` loads all of it, with this same parser.
"""

import importlib
import importlib.machinery
import importlib.util
import sys


def load() -> None:
    """Import `cantools.database`; where cantools is there already, it is what there is."""
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

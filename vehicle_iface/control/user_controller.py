"""A user's controller class, loaded from a file or a module."""

import importlib
import importlib.util
import inspect
import sys
import traceback
from pathlib import Path
from types import ModuleType
from typing import Any

from vehicle_iface.control.base import BehaviorConfig, ControllerBase
from vehicle_iface.errors import ConfigError
from vehicle_iface.profile import Profile


def load_controller(name: str, profile: Profile, behavior: BehaviorConfig) -> ControllerBase:
    """The controller of `FILE.py:CLASS` or `MODULE:CLASS`, loaded and made.

    The class is called with the `BehaviorConfig`; one with a class method `from_profile(profile, behavior)` is made by
    that. Whatever its code raises becomes a `ConfigError` with file and line.
    """
    place, _, class_name = name.rpartition(":")
    if not place:
        raise ConfigError(f"--controller {name}: must be pure_pursuit, FILE.py:CLASS or MODULE:CLASS")
    if place.endswith(".py") and not Path(place).is_file():
        raise ConfigError(f"--controller {name}: no such file {place}")
    try:
        module = _load_module(Path(place)) if place.endswith(".py") else importlib.import_module(place)
        kind: Any = getattr(module, class_name, None)
        if not inspect.isclass(kind):
            raise ConfigError(f"--controller {name}: there is no class {class_name} in {place}")
        make: Any = kind
        controller = make.from_profile(profile, behavior) if hasattr(kind, "from_profile") else make(behavior)
    except (ConfigError, KeyboardInterrupt):
        raise
    except BaseException as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        line = error.lineno if isinstance(error, SyntaxError) else where.lineno
        file = error.filename if isinstance(error, SyntaxError) else where.filename
        raise ConfigError(f"--controller {name}: {type(error).__name__}: {error} ({file}:{line})") from error
    if not isinstance(controller, ControllerBase):
        raise ConfigError(f"--controller {name}: {class_name} is not a subclass of ControllerBase")
    return controller


def _load_module(path: Path) -> ModuleType:
    """The module in a file, under a name that no other module has; its folder's modules can be imported from it."""
    name = f"vehicle_iface_own_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ConfigError(f"--controller {path}: cannot be loaded")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.append(str(path.resolve().parent))
    spec.loader.exec_module(module)
    return module

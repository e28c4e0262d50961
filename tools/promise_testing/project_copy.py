"""A copy of the project in which one change of the code after the other is made and undone."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

MADE = {".git", ".venv", "__pycache__", ".mypy_cache", ".ruff_cache", ".pytest_cache", ".hypothesis"}


class PlanError(Exception):
    """The plan does not fit the page or the code; one line for each fault."""


class Change(Protocol):
    """A change of one file."""

    @property
    def label(self) -> str:
        """What errors name it by."""
        ...

    @property
    def file(self) -> str:
        """Below the root of the project."""
        ...

    @property
    def was(self) -> str:
        """Occurs exactly once in the file."""
        ...

    @property
    def becomes(self) -> str: ...


def changed_source(change: Change, source: str) -> str:
    """The source with the change. Raises `PlanError` where it cannot be made."""
    place = f"{change.label}: {change.file}"
    if (count := source.count(change.was)) != 1:
        raise PlanError(f"{place}: occurs {count} times instead of once: {change.was!r}")
    changed = source.replace(change.was, change.becomes)
    if changed == source:
        raise PlanError(f"{place}: changes nothing: {change.was!r}")
    if change.file.endswith(".py"):
        try:
            compile(changed, change.file, "exec", dont_inherit=True)
        except SyntaxError as error:
            raise PlanError(f"{place}: does not compile: {error}") from None
    return changed


class ProjectCopy:
    """The project's files in another folder, with its `.venv`."""

    def __init__(self, project: Path, folder: Path) -> None:
        self.root = folder
        for name in _names_of_files(project):
            target = folder / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(project / name, target)
        (folder / ".venv").symlink_to(project / ".venv")

    @contextmanager
    def with_change(self, change: Change) -> Iterator[None]:
        """Until the end of the block the copy has the change."""
        path = self.root / change.file
        source = path.read_text(encoding="utf-8")
        path.write_text(changed_source(change, source), encoding="utf-8")
        try:
            yield
        finally:
            path.write_text(source, encoding="utf-8")


def _names_of_files(project: Path) -> list[str]:
    """The project's files, as git knows them; where there is no git, all but what is made by running things."""
    command = ["git", "-C", str(project), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listing = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        paths = (path.relative_to(project) for path in project.rglob("*"))
        names = [str(path) for path in paths if not MADE.intersection(path.parts)]
    else:
        names = listing.split("\0")
    return [name for name in names if name and (project / name).is_file()]

"""The programs of tools/: each is in the table of its README, and a few lines that start a module."""

import os
import re

from .running import TOOLS

OWN = {"test", "vcan", "hil_bench.py"}
"""More than a few lines: the first runs checks of all kinds, the others run without any set-up."""


def programs() -> set[str]:
    return {path.name for path in TOOLS.iterdir() if path.is_file() and os.access(path, os.X_OK)}


def test_the_readme_names_every_program_and_its_package() -> None:
    rows = re.findall(
        r"^\| `([\w.]+)`[^|]* \| ([^|]+) \|", (TOOLS / "README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert {name for name, _ in rows} == programs()
    for _, package in rows:
        assert package == "–" or (TOOLS / package.strip("`") / "__init__.py").is_file()


def test_every_launcher_only_starts_a_module() -> None:
    for name in programs() - OWN:
        shebang, comment, source, *rest = (TOOLS / name).read_text(encoding="utf-8").splitlines()
        assert shebang == "#!/usr/bin/env bash"
        assert comment.startswith("# ")
        assert source == 'source "$(dirname "${BASH_SOURCE[0]}")/_setup.sh"'
        *needs, start = rest
        assert all(line.startswith("need_programs ") for line in needs)
        assert re.fullmatch(r'run_module [\w. ]+ "\$@"', start)

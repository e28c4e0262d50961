"""The entry of `tools/docs`."""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

from docs_site.pages import copy_pages

ROOT = Path(__file__).resolve().parents[2]
CONFIG = ROOT / "docs" / "zensical.toml"


def main() -> int:
    """The status of the generator: 0 when the site was built without a warning."""
    parser = argparse.ArgumentParser(
        prog="tools/docs",
        description="Build the documentation. It needs no network: open OUT/site/index.html in a browser.",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "docs", help="folder for the result")
    out = parser.parse_args().out.resolve()
    copy_pages(ROOT, out / "pages")
    shutil.rmtree(out / "site", ignore_errors=True)
    shutil.copyfile(CONFIG, out / "zensical.toml")  # pages and site must lie below the folder of the configuration
    command = [sys.executable, "-m", "zensical", "build", "--clean", "--strict", "--config-file"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    return subprocess.run([*command, str(out / "zensical.toml")], cwd=out, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())

"""The command `hil-bench`, also `python -m hil_bench`."""

import sys
from importlib.util import find_spec

NEEDS = ("cantools", "jinja2", "msgspec", "rich")


def main() -> int:
    """Run the bench, or name the packages that are missing. Returns the exit status."""
    missing = [name for name in NEEDS if find_spec(name) is None]
    if missing:
        print(f"hil-bench: needs {', '.join(missing)}; run: pip install 'vehicle-iface[bench]'", file=sys.stderr)
        return 2
    from hil_bench import cli

    return cli.main()


if __name__ == "__main__":
    sys.exit(main())

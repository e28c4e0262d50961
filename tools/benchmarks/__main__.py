"""The entry of `tools/benchmark`."""

import argparse
import ast
import importlib
import sys
from pathlib import Path

from benchmarks.parts.report import BenchmarkError, as_json, as_text


def main() -> int:
    """0 when it has measured, 1 when it could not, 2 for bad usage."""
    modules = {path.stem: path for path in sorted(Path(__file__).parent.glob("[a-z]*.py"))}
    texts = {
        name: ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "" for name, path in modules.items()
    }
    given = sys.argv[1:]
    name = next((word for word in given if not word.startswith("-")), "")
    if name not in texts:
        _overall(texts).parse_args()
        return 2
    given.remove(name)
    benchmark = importlib.import_module(f"benchmarks.{name}")
    parser = argparse.ArgumentParser(
        prog=f"tools/benchmark {name}", description=texts[name], formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="the same as JSON, with the machine")
    parser.add_argument("--quick", action="store_true", help="fewer rounds: right in form, rough in numbers")
    if hasattr(benchmark, "add_options"):
        benchmark.add_options(parser)
    options = parser.parse_args(given)
    try:
        report = benchmark.run(options)
    except BenchmarkError as error:
        print(f"tools/benchmark {name}: {error}", file=sys.stderr)
        return 1
    print(as_json(name, report) if options.json else as_text(name, report))
    return 0


def _overall(texts: dict[str, str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tools/benchmark",
        description="Measure how this program compares; prints a table of ratios with the machine above it.",
        epilog="\n\n".join(_in_short(name, text) for name, text in texts.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("name", metavar="NAME", choices=texts, help="one of the benchmarks below")
    parser.add_argument("--json", action="store_true", help="the same as JSON, with the machine")
    parser.add_argument("--quick", action="store_true", help="fewer rounds: right in form, rough in numbers")
    return parser


def _in_short(name: str, text: str) -> str:
    """What it compares, its time and its target."""
    paragraphs = text.split("\n\n")
    lines = "\n".join([paragraphs[0], *paragraphs[-2:]]).split("\n")
    return "\n".join([name, *(f"    {line}" for line in lines)])


if __name__ == "__main__":
    sys.exit(main())

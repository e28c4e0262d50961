"""The entry of `tools/fuzz`."""

import argparse
import ast
import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from fuzzing.engine import judge

_PROGRESS = re.compile(r"#(\d+)\s.*?cov: (\d+)")


def main() -> int:
    """0 when nothing was found, 1 when something was, 2 for bad usage or when no hunt could be begun."""
    options = _options()
    try:
        import atheris  # noqa: F401
    except ModuleNotFoundError:
        print("tools/fuzz: there is no atheris for this machine (Linux on x86-64 only)", file=sys.stderr)
        return 2
    findings = 0
    for name in options.target or judge.target_names():
        findings += _hunted(name, options)
    return 1 if findings else 0


def _options() -> argparse.Namespace:
    names = judge.target_names()
    parser = argparse.ArgumentParser(
        prog="tools/fuzz",
        description="Hunt for inputs that crash, hang or deceive what reads foreign bytes; new ones are kept in "
        "tests/corpus. `python -m fuzzing.engine.judge TARGET FILE` shows the traceback of one.",
        epilog="\n".join(["targets:", *(f"  {name:12} {_in_short(name)}" for name in names)]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("target", metavar="TARGET", nargs="*", help="default: all of them, one after the other")
    parser.add_argument("--seconds", type=int, default=60, help="for each target (default: %(default)s)")
    parser.add_argument("--runs", type=int, default=-1, help="inputs for each target at most")
    parser.add_argument("--seed", type=int, default=0, help="of the mutations; 0: another one each time")
    parser.add_argument("--grow", type=Path, help="folder that keeps what was reached, for the next time")
    options = parser.parse_args()
    for name in options.target:
        if name not in names:
            parser.error(f"TARGET {name!r}: must be one of {', '.join(names)}")
    return options


def _in_short(name: str) -> str:
    text = (Path(__file__).parent / f"{name}.py").read_text(encoding="utf-8")
    return (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]


def _hunted(name: str, options: argparse.Namespace) -> int:
    """How many faults a hunt has found; they are in the corpus then."""
    limits = [f"-max_total_time={options.seconds}", f"-runs={options.runs}", f"-seed={options.seed}"]
    count = inputs = coverage = 0
    last: list[str] = []
    with tempfile.TemporaryDirectory() as own:
        folder = options.grow / name if options.grow is not None else Path(own)
        folder.mkdir(parents=True, exist_ok=True)
        child = _started(name, folder, limits)
        for line in _lines(child):
            last = [*last[-20:], line]
            if line.startswith("FINDING "):
                count += 1
                _keep(name, json.loads(line.removeprefix("FINDING ")))
            elif match := _PROGRESS.match(line):
                inputs, coverage = int(match[1]), int(match[2])
                _say(f"{name:12} {inputs:9} inputs, {coverage:6} branches, {count} findings", end="\r")
        status = child.wait()
    _say(f"{name:12} {inputs:9} inputs, {coverage:6} branches, {count} findings")
    if status:
        print("\n".join([f"{name}: the hunt died ({status}); its last words:", *last]), file=sys.stderr)
    return count + bool(status)


def _started(name: str, folder: Path, limits: list[str]) -> "subprocess.Popen[str]":
    # A hang or a greed that Python cannot interrupt is libFuzzer's to end: then the input is in its last words.
    backstop = ["-timeout=60", "-rss_limit_mb=4096", "-print_pcs=0", f"-artifact_prefix={folder.parent}/died-"]
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "fuzzing.engine.hunt", name, str(folder), *limits, *backstop],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )


def _lines(child: "subprocess.Popen[str]") -> Iterator[str]:
    assert child.stdout is not None
    return (line.rstrip("\n") for line in child.stdout)


def _keep(name: str, finding: dict[str, str]) -> None:
    data = bytes.fromhex(finding["input"])
    path = judge.CORPUS / name / f"open-{hashlib.sha256(data).hexdigest()[:12]}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    _say(f"{name}: {finding['fault']}, {len(data)} bytes in {path.relative_to(judge.ROOT)}")


def _say(text: str, end: str = "\n") -> None:
    """Progress is for people only; what stays is for everybody."""
    if end == "\n" or sys.stderr.isatty():
        print(text.ljust(78), end=end, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())

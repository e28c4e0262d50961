"""One input to one target: what is wrong with it, if anything, in one line that is the same for the same fault."""

import importlib
import logging
import resource
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).resolve().parents[3]
CORPUS = ROOT / "tests" / "corpus"
LIMIT_S = 5.0
"""Of processor time for one input."""
MEMORY_BYTES = 3 << 30

Run = Callable[[bytes], None]


class TooSlow(BaseException):
    """An input takes too long; no `except Exception` may swallow this."""


def target_names() -> tuple[str, ...]:
    return tuple(sorted(path.stem for path in (ROOT / "tools" / "fuzzing").glob("[a-z]*.py")))


def seed_inputs(name: str) -> Iterator[bytes]:
    """What a hunt begins with: the target's own, and those of the corpus whose faults are mended."""
    yield from importlib.import_module(f"fuzzing.{name}").seeds()
    for path in corpus_files(name):
        if not is_open(path):
            yield path.read_bytes()


def corpus_files(name: str) -> list[Path]:
    return sorted(path for path in (CORPUS / name).glob("*") if path.is_file())


def is_open(path: Path) -> bool:
    """Whether this file of the corpus is a fault that nobody has mended yet."""
    return path.name.startswith("open-")


def prepare() -> None:
    """What holds for the whole process: little memory, warnings are faults, nothing is logged."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, most))
    warnings.simplefilter("error")
    logging.disable()
    signal.signal(signal.SIGVTALRM, _too_slow)


def fault_of(run: Run, data: bytes) -> str | None:
    """What is raised and where, without what differs from input to input; None when all is well."""
    try:
        with _limited(LIMIT_S):
            run(data)
    except TooSlow as error:
        return f"hang: more than {LIMIT_S:g} s at {_place(error, deepest=False)}"
    except (Exception, SystemExit) as error:  # noqa: BLE001  # that is what is looked for
        return f"{type(error).__name__} at {_place(error)}"
    return None


def explained(run: Run, data: bytes) -> str:
    """The traceback of a fault; empty when there is none."""
    try:
        with _limited(LIMIT_S):
            run(data)
    except (Exception, SystemExit, TooSlow):  # noqa: BLE001
        return traceback.format_exc()
    return ""


def shrunk(run: Run, data: bytes, fault: str, *, tries: int = 100) -> bytes:
    """A shorter input with the same fault: pieces are left out as long as it stays."""
    size = len(data) // 2
    while size and tries > 0:
        at = 0
        while at < len(data) and tries > 0:
            shorter = data[:at] + data[at + size :]
            tries -= 1
            if fault_of(run, shorter) == fault:
                data = shorter
            else:
                at += size
        size //= 2
    return data


def _place(error: BaseException, *, deepest: bool = True) -> str:
    """The line of this project that a fault came out of; for a hang, that of the program that never came back."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename != __file__]
    folders = (ROOT,) if deepest else (ROOT / "vehicle_iface", ROOT / "viewer")
    ours = [frame for frame in frames if any(Path(frame.filename).is_relative_to(folder) for folder in folders)]
    if not ours:
        return f"{frames[-1].filename}:{frames[-1].lineno}" if frames else "?"
    frame = ours[-1 if deepest else 0]
    return f"{Path(frame.filename).relative_to(ROOT)}:{frame.lineno} {frame.name}"


@contextmanager
def _limited(limit_s: float) -> Iterator[None]:
    signal.setitimer(signal.ITIMER_VIRTUAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)


def _too_slow(_: int, __: FrameType | None) -> None:
    raise TooSlow


def main() -> int:
    """`python -m fuzzing.engine.judge TARGET FILE…`: the traceback of each file, the target's seeds first."""
    name, *files = sys.argv[1:]
    target = importlib.import_module(f"fuzzing.{name}")
    inputs = {f"seed {number}": seed for number, seed in enumerate(target.seeds())}
    inputs |= {file: Path(file).read_bytes() for file in files}
    prepare()
    bad = 0
    for place, data in inputs.items():
        text = explained(target.run, data)
        if text:
            bad += 1
            print(f"{place}:\n{text}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

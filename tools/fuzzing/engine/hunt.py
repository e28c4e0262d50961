"""One target under libFuzzer in its own process: `python -m fuzzing.engine.hunt TARGET FOLDER [LIBFUZZER-OPTION…]`.

A finding does not end the hunt: the first input of each fault is shrunk and told in a line of JSON, `FINDING {…}`.
FOLDER is where the inputs grow that reach something new.
"""

import hashlib
import importlib
import json
import sys
from pathlib import Path
from types import ModuleType

import atheris

from fuzzing.engine import judge

INSTRUMENTED = ["vehicle_iface", "vehicle_iface_viewer", "cantools", "textparser", "tomllib"]


def main(arguments: list[str]) -> None:
    """Ends the process."""
    name, folder, *options = arguments
    target = loaded(name)
    _seed(Path(folder), name)
    judge.prepare()
    # What nobody has mended yet is not found again.
    still = [path.read_bytes() for path in judge.corpus_files(name) if judge.is_open(path)]
    found = {judge.fault_of(target.run, data) for data in still}

    def one_input(data: bytes) -> None:
        fault = judge.fault_of(target.run, data)
        if fault is None or fault in found:
            return
        found.add(fault)
        small = data if fault.startswith("hang") else judge.shrunk(target.run, data, fault)
        print("FINDING " + json.dumps({"fault": fault, "input": small.hex()}), flush=True)

    atheris.Setup(["fuzzing", *options, f"-max_len={target.LENGTH}", folder], one_input)
    atheris.Fuzz()


def loaded(name: str) -> ModuleType:
    """The target's module; what it imports tells libFuzzer which branches were taken."""
    with atheris.instrument_imports(include=INSTRUMENTED):
        return importlib.import_module(f"fuzzing.{name}")


def _seed(folder: Path, name: str) -> None:
    for data in judge.seed_inputs(name):
        (folder / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)


if __name__ == "__main__":
    main(sys.argv[1:])

"""Makes a small case of a recording: only what a rerun needs, up to a time."""

import shutil
from collections.abc import Iterator
from pathlib import Path

from vehicle_iface.errors import ConfigError
from vehicle_iface.recorder import files
from vehicle_iface.recorder.inputs import encode_pass, format_block, read_inputs
from vehicle_iface.rerun.drive import load_options
from vehicle_iface.units import s_from_ns

BLOCK_PASSES = 10_000


def save_case(recording: Path, case: Path, *, until_s: float | None) -> Path:
    """Copy options, profile, inputs and files of a recording into the new folder `case`, and return it.

    `until_s`: only the first seconds. Raises `ConfigError` when there are no inputs or `case` is not empty.
    """
    load_options(recording)
    if case.exists() and (not case.is_dir() or any(case.iterdir())):
        raise ConfigError(f"--save {case}: is not an empty folder; nothing is overwritten: choose another name")
    try:
        case.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(recording / files.META, case / files.META)
        for name in (files.PROFILE, files.INPUT_FILES):
            if (recording / name).is_dir():
                shutil.copytree(recording / name, case / name)
        with (case / files.INPUTS).open("xb") as file:
            passes: list[bytes] = []
            for one in _encoded_passes(recording / files.INPUTS, until_s):
                passes.append(one)
                if len(passes) == BLOCK_PASSES:
                    file.write(format_block(passes))
                    passes = []
            if passes:
                file.write(format_block(passes))
    except OSError as error:
        raise ConfigError(f"--save {case}: cannot be written: {error.strerror}") from None
    return case


def _encoded_passes(path: Path, until_s: float | None) -> Iterator[bytes]:
    started_ns: int | None = None
    for inputs in read_inputs(path):
        if inputs.clock_ns:
            started_ns = inputs.clock_ns[0] if started_ns is None else started_ns
            if until_s is not None and s_from_ns(inputs.clock_ns[0] - started_ns) > until_s:
                return
        yield encode_pass(inputs)

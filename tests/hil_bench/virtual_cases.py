"""Runs cases of the bench with the program in virtual time: virtual_cases.py RESULTS.json CASE…

What needs a bus, a process or another program beside the loop is NOT EXECUTED.
"""

import logging
import sys
import tempfile
from pathlib import Path

import msgspec
from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case
from hil_bench.cases import catalogue_for
from hil_bench.device import Commands
from hil_bench.judge_case import unjudged_result
from hil_bench.peer.build import open_wire
from hil_bench.result import CaseResult, Verdict
from virtual_rig import run_virtual

PROFILE = "reference"


def run(case: Case, folder: Path) -> CaseResult:
    """The result of a case; NOT EXECUTED where virtual time has nothing for it."""
    try:
        beside = (case.on_vxcan, case.breaks, case.profile, case.recorded_mib, case.viewed, case.open_files)
        if case.armed and not any((*beside, case.channel, case.link_is_down)):
            return run_virtual(case, PROFILE, folder)
        why = "needs more than the loop and its bus"
    except Exception as error:  # noqa: BLE001  # whatever the rig of virtual time does not have
        why = f"not in virtual time: {error!r}"
    config = BenchConfig(wire=open_wire(PROFILE), channel="vcan9", commands=Commands(), folder=folder, profile=PROFILE)
    return unjudged_result(config, case, 1, why, Verdict.NOT_EXECUTED)


def main() -> None:
    """See the module; ends after the first case that fails."""
    logging.disable(logging.CRITICAL)
    results, names = Path(sys.argv[1]), sys.argv[2:]
    cases = {case.name: case for case in catalogue_for(open_wire(PROFILE))}
    done: list[CaseResult] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            done.append(run(cases[name], Path(folder)))
            if done[-1].verdict is Verdict.FAIL:
                break
    results.write_bytes(msgspec.json.encode(done))


if __name__ == "__main__":
    main()

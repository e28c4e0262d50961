"""Runs cases of the bench in virtual time, with the program's loop or with the minimal controller.

What needs a bus, a process or another program beside the loop is NOT EXECUTED.
"""

import argparse
import logging
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


def run(case: Case, folder: Path, *, is_minimal: bool = False, defect: str = "") -> CaseResult:
    """The result of a case; NOT EXECUTED where virtual time has nothing for it."""
    try:
        beside = (case.on_vxcan, case.profile, case.recorded_mib, case.viewed, case.open_files, case.channel)
        if not any(beside):
            return run_virtual(case, PROFILE, folder, is_minimal=is_minimal, defect=defect)
        why = "needs more than the loop and its bus"
    except Exception as error:  # noqa: BLE001  # whatever the rig of virtual time does not have
        why = f"not in virtual time: {error!r}"
    config = BenchConfig(wire=open_wire(PROFILE), channel="vcan9", commands=Commands(), folder=folder, profile=PROFILE)
    return unjudged_result(config, case, 1, why, Verdict.NOT_EXECUTED)


def main() -> None:
    """See the module."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path, help="JSON file that is written")
    parser.add_argument("cases", nargs="+")
    parser.add_argument("--minimal", action="store_true", help="the minimal controller instead of the program")
    parser.add_argument("--defect", default="", help="which the minimal controller has")
    parser.add_argument("--until-failure", action="store_true", help="end after the first case that fails")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    cases = {case.name: case for case in catalogue_for(open_wire(PROFILE))}
    done: list[CaseResult] = []
    with tempfile.TemporaryDirectory() as folder:
        for name in given.cases:
            done.append(run(cases[name], Path(folder), is_minimal=given.minimal, defect=given.defect))
            if given.until_failure and done[-1].verdict is Verdict.FAIL:
                break
    given.results.write_bytes(msgspec.json.encode(done))


if __name__ == "__main__":
    main()

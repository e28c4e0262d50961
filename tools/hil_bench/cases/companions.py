"""Cases of recorder and viewer beside the device: their faults must cost no command."""

import signal
from typing import Any

from hil_bench import routes
from hil_bench.case import Case, Need
from hil_bench.expect import DrivesOn
from hil_bench.faults import base, process, viewer


def _beside(name: str, fault: str, what: str, injected: str, inject: base.Injection, for_s: float, **more: Any) -> Case:
    """A fault of a program beside the loop."""
    kind = name.partition("-")[0]
    return Case(
        name=name,
        fault=fault,
        tags=("companions", kind),
        proves=f"{what} costs no command, and delays none.",
        injected=injected,
        inject=inject,
        for_s=for_s,
        is_measured=True,
        see=(DrivesOn(),),
        **more,
    )


COMPANIONS = (
    *(
        _beside(name, "P6", what, injected, inject, for_s, recorded_mib=2, needs=(Need.OWN_PROCESS, Need.ROOT))
        for name, for_s, what, injected, inject in (
            (
                "recorder-disk-full",
                4.0,  # long enough that the recorder must write, and finds no room
                "A full disk",
                "the disk that the drive is recorded on is full",
                process.fill_disk,
            ),
            (
                "recorder-stopped",
                2.0,
                "A stopped recorder",
                "SIGSTOP to the process that records the drive, SIGCONT 2 s later",
                process.send_to_recorder(signal.SIGSTOP),
            ),
            (
                "recorder-killed",
                2.0,
                "A killed recorder",
                "SIGKILL to the process that records the drive",
                process.send_to_recorder(signal.SIGKILL),
            ),
        )
    ),
    *(
        _beside(
            name,
            "W1",
            what,
            injected,
            viewer.with_viewer(change),
            3.0,
            viewed=True,
            route=lambda: routes.straight(600.0, 4.0),
            needs=(Need.OWN_PROCESS,),
        )
        for name, what, injected, change in (
            (
                "viewer-stopped",
                "A stopped viewer",
                "SIGSTOP to the viewer, SIGCONT 3 s later",
                viewer.pause_viewer,
            ),
            (
                "viewer-killed",
                "A viewer that is killed and started again",
                "SIGKILL to the viewer, then a new viewer",
                viewer.kill_viewer,
            ),
            (
                "viewer-flooded",
                "A flooded viewer",
                "twenty browsers that request everything, read nothing and send garbage",
                viewer.flood_viewer,
            ),
        )
    ),
)

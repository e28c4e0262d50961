"""The `vehicle-iface` command.

A command's module is imported only when the command is called, so that the control process loads nothing else.
"""

import argparse
import gc
import os
import sys
from collections.abc import Sequence

from vehicle_iface.cli.exit_status import BAD_USAGE, NO_BUS
from vehicle_iface.cli.logging import log_to_terminal
from vehicle_iface.cli.parser import build_parser
from vehicle_iface.cli.renamed_options import replace_renamed
from vehicle_iface.command_line import make_output_safe
from vehicle_iface.errors import BusError, ConfigError, TrajectoryFileError, VehicleIfaceError
from vehicle_iface.process import module_command


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status, which is one of `exit_status`."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given[:1] == ["view"]:  # the viewer is another process and knows its own options
        command_line, environment = module_command("vehicle_iface_viewer")
        os.execve(sys.executable, [*command_line, *given[1:]], environment)
    make_output_safe()
    use_one_blas_thread()
    given = replace_renamed(given)
    options = build_parser(given[0] if given else "").parse_args(given)
    try:
        with log_to_terminal(options.verbose):
            return _run_command(options)
    except BusError as error:
        print(f"vehicle-iface: {error}", file=sys.stderr)
        return NO_BUS
    except (ConfigError, TrajectoryFileError) as error:
        print(f"vehicle-iface: {error}", file=sys.stderr)
        return BAD_USAGE
    except VehicleIfaceError as error:
        print(f"vehicle-iface: {type(error).__name__}: {error}", file=sys.stderr)
        return BAD_USAGE


def use_one_blas_thread() -> None:
    """Let NumPy, which is not imported yet, start without threads: nothing here needs them, and they cost a start."""
    for name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS"):
        os.environ.setdefault(name, "1")


def _run_command(options: argparse.Namespace) -> int:
    if options.command == "run":
        gc.disable()  # a start makes little garbage and many objects; the loop collects between its passes
        from vehicle_iface.cli.run import run

        return run(options)
    if options.command == "sim":
        from vehicle_iface.cli.sim import run_simulator

        return run_simulator(options)
    if options.command == "driver":
        from vehicle_iface.cli.sim import send_driver_command

        return send_driver_command(options)
    if options.command == "demo":
        from vehicle_iface.cli.demo import run_demo

        return run_demo(options)
    if options.command == "doctor":
        from vehicle_iface.cli.doctor import examine_machine

        return examine_machine(options)
    if options.command == "check-dbc":
        from vehicle_iface.cli.check_dbc import check_dbc

        return check_dbc(options)
    if options.command == "new-profile":
        from vehicle_iface.cli.new_profile import new_profile

        return new_profile(options)
    if options.command == "review":
        from vehicle_iface.cli.review import review

        return review(options)
    if options.command == "commission":
        from vehicle_iface.cli.commission import commission

        return commission(options)
    if options.command == "export":
        from vehicle_iface.cli.export import export

        return export(options)
    if options.command == "compare":
        from vehicle_iface.cli.compare import compare

        return compare(options)
    if options.command == "replay":
        from vehicle_iface.cli.replay import replay

        return replay(options)
    if options.command == "rerun":
        from vehicle_iface.cli.rerun import run_again

        return run_again(options)
    from vehicle_iface.cli.decode import decode

    return decode(options)

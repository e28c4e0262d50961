"""A run of the bench: what it can execute, errors, interruption and unexpected nodes."""

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from hil_bench import bench, bus, run_case
from hil_bench.bench_config import BenchConfig
from hil_bench.case import Case, Need
from hil_bench.cases import CATALOGUE
from hil_bench.cases.companions import COMPANIONS
from hil_bench.cases.files import FILES
from hil_bench.device import Commands
from hil_bench.errors import UnexpectedNodeError
from hil_bench.judge_case import unjudged_result
from hil_bench.peer.build import open_wire
from hil_bench.plant import Plant
from hil_bench.result import CaseResult, Verdict
from hil_bench.rig import Rig
from hil_bench.vehicle import Vehicle
from scenes import WIRE

from vehicle_iface.codec.database import load_database
from vehicle_iface.profile import load_profile

NEWS = ("on_run_start", "on_case_start", "on_case_end", "on_run_end")


def test_a_case_that_cannot_be_executed_names_what_is_missing() -> None:
    everywhere = Commands(start="")
    own = Commands()
    for case in CATALOGUE:
        why = bench.missing_needs(case, everywhere, "no-such-interface", case.route().name)
        of_device = {Need.OWN_PROCESS, Need.START, Need.REARM} & set(case.needs)
        assert not (of_device or case.breaks or case.profile or case.setup) or why, case.name
        assert not why or case.needs or case.setup, case.name
    assert "drives the route straight-400-m-at-5" in bench.missing_needs(
        next(case for case in CATALOGUE if case.name == "half-the-rate"), everywhere, "no-such-interface", "u-turn"
    )
    door = Commands(start="ssh bench2 run", is_here=False, rearm="ssh bench2 rearm")
    killed = next(case for case in CATALOGUE if case.name == "killed")
    assert "on this computer" in bench.missing_needs(killed, door, "no-such-interface")
    assert not bench.missing_needs(killed, own, "no-such-interface")
    stubborn = Commands(start="my-loop --channel {channel}")
    spoilt = {case.name: bench.missing_needs(case, stubborn, "no-such-interface") for case in FILES}
    assert all("started with {profile}" in why for name, why in spoilt.items() if name.startswith("profile-"))
    assert "started with {trajectory}" in spoilt["trajectory-with-nan"]
    plain = Commands(start="my-loop --channel {channel}", record="", view="")
    beside = {case.name: bench.missing_needs(case, plain, "no-such-interface") for case in COMPANIONS}
    assert sum("--recording-device" in why for name, why in beside.items() if name.startswith("recorder-")) == 3
    assert sum("--viewer" in why for name, why in beside.items() if name.startswith("viewer-")) == 3
    absent = next(case for case in CATALOGUE if case.name == "link-absent-at-start")
    assert "started with {channel}" in bench.missing_needs(absent, Commands(start="my-loop"), "no-such-interface")


@pytest.mark.parametrize("name", ["BODY_COMMAND", "CONTROLLER_STATUS", "DRIVE_COMMAND", "POSE"])
def test_a_running_device_may_send_reports_but_no_commands(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    rx = bus.RxFrame(WIRE.pack(name, 3), False, 0)
    opened = SimpleNamespace(drain=lambda: [rx], close=lambda: None)
    monkeypatch.setattr(bench, "open_bus", lambda *_, **__: opened)
    monkeypatch.setattr(bench, "LISTEN_S", 0.02)
    assert bench.observe_traffic(("vcan9",), WIRE)
    reports = name in ("BODY_COMMAND", "CONTROLLER_STATUS")
    assert bool(bench.observe_traffic(("vcan9",), WIRE, is_device_running=True)) is not reports


def test_bench_stops_sending_when_another_vehicle_appears(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    rig = Rig.__new__(Rig)
    rig.wire, rig.vehicle_transmits, rig.every_tick, rig.received = WIRE, True, [lambda: None], []
    rig._of_device = frozenset({"DRIVE_COMMAND"})
    pose, told = WIRE.pack("POSE", 3), WIRE.pack("DRIVE_COMMAND", 3)
    rig.vehicle = Vehicle(WIRE, Plant(wheelbase_m=2.7))
    rx = [bus.RxFrame(pose, True, 0), bus.RxFrame(told, False, 0), bus.RxFrame(replace(pose, data=bytes(8)), False, 0)]
    rig.bus = SimpleNamespace(drain=lambda: rx)  # type: ignore[assignment]
    rig._drain(0)
    rx = [bus.RxFrame(pose, False, 0)]
    with pytest.raises(UnexpectedNodeError, match="POSE"):
        rig._drain(0)
    assert not rig.vehicle_transmits
    assert not rig.every_tick
    rig._drain(0)  # so that the device can still be ended

    def run(*_: object) -> None:
        raise UnexpectedNodeError("another node sends POSE")

    monkeypatch.setattr(run_case, "run", run)
    what = BenchConfig(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    plan = bench.Plan(config=what, cases=FILES[:3])
    found = bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [Verdict.FAIL, Verdict.NOT_EXECUTED, Verdict.NOT_EXECUTED]
    assert all("stopped sending" in case.why for case in found.cases)


def test_a_run_leaves_its_process_the_priority_that_it_had(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def run(which: BenchConfig, case: Case, repetition: int) -> CaseResult:
        return unjudged_result(which, case, repetition, "", Verdict.PASS)

    monkeypatch.setattr(run_case, "run", run)
    what = BenchConfig(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    before = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    bench.run(bench.Plan(config=what, cases=FILES[:1]), SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == before


def test_an_internal_error_of_the_bench_costs_one_case(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def run(which: BenchConfig, case: Case, repetition: int) -> CaseResult:
        if case is FILES[1]:
            raise ZeroDivisionError("in the bench")
        return unjudged_result(which, case, repetition, "", Verdict.PASS)

    monkeypatch.setattr(run_case, "run", run)
    what = BenchConfig(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    found = bench.run(bench.Plan(config=what, cases=FILES[:3]), SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [Verdict.PASS, Verdict.NOT_EXECUTED, Verdict.PASS]
    assert "ZeroDivisionError('in the bench')" in found.cases[1].why


@pytest.mark.parametrize(("first", "verdict"), [(Verdict.PASS, Verdict.NOT_EXECUTED), (Verdict.FAIL, Verdict.FAIL)])
def test_an_interrupted_run_keeps_what_it_found_lists_the_rest_and_never_passes(
    first: Verdict, verdict: Verdict, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def run(which: BenchConfig, case: Case, repetition: int) -> CaseResult:
        if repetition == 2:
            raise KeyboardInterrupt
        return unjudged_result(which, case, repetition, "", first)

    monkeypatch.setattr(run_case, "run", run)
    what = BenchConfig(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    plan = bench.Plan(config=what, cases=FILES[:3], repeat=4)
    found = bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [first, *[Verdict.NOT_EXECUTED] * 11]
    assert {case.why for case in found.cases[1:]} == {"interrupted in case 2 of 12"}
    assert found.interrupted == "interrupted in case 2 of 12"
    assert found.verdict is verdict


def test_a_run_until_the_first_failure_executes_nothing_after_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def run(which: BenchConfig, case: Case, repetition: int) -> CaseResult:
        return unjudged_result(which, case, repetition, "", Verdict.FAIL if case is FILES[1] else Verdict.PASS)

    monkeypatch.setattr(run_case, "run", run)
    what = BenchConfig(wire=WIRE, channel="vcan9", commands=Commands(), folder=tmp_path, profile="reference")
    plan = bench.Plan(config=what, cases=FILES[:3], until_failure=True)
    found = bench.run(plan, SimpleNamespace(**dict.fromkeys(NEWS, lambda *_: None)))
    assert [case.verdict for case in found.cases] == [Verdict.PASS, Verdict.FAIL]
    assert found.verdict is Verdict.FAIL


@pytest.mark.parametrize("profile", ["j1939_truck", "agilex_hunter_ins"])
def test_the_changed_copy_of_a_profile_has_beside_it_what_it_names(profile: str, tmp_path: Path) -> None:
    case = replace(FILES[0], profile=lambda toml, dbc: (toml + "\n# changed\n", dbc))
    what = BenchConfig(wire=open_wire(profile), channel="vcan9", commands=Commands(), folder=tmp_path, profile=profile)
    copy = Path(run_case._profile(what, case, "copy"))
    assert copy.parent == tmp_path.resolve()
    assert copy.read_text().endswith("# changed\n")
    assert load_database(load_profile(copy)).profile.name == what.wire.name

"""The reports on a run, as those read them who get them: page, CI, terminal, and what has changed since."""

import io
import math
import os
import subprocess
import sys
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import example_run
import msgspec
import pytest
from hil_bench import result
from hil_bench.report import compare, drawing, formatting, html, junit, terminal
from hil_bench.result import CaseResult, Check, Distribution, Evidence, Measured, Path2D, Plot, Run, Series, Verdict
from rich.console import Console

ROOT = Path(__file__).resolve().parents[2]

VOID = {"meta", "link", "input", "br", "img", "hr"}
SVG_LEAVES = {"path", "rect", "circle"}
HOSTILE = (
    "<script>document.title = 'owned'</script>",
    "\"><img src=x onerror=alert(1)>' onload='alert(1)",
    "{{ 7 * 7 }}{% raw %}",
    "</style></script><!--",
    "\x1b[2J\x1b[31mPASS\x00\r\n64/64 PASS",
    "gnp\u202ekcart\u200b\u2028PASS",
    "[bold red]markup[/bold red]",
    "javascript:alert(1)",
    "]]> &amp; &#60;",
)


class Page(HTMLParser):
    """What a browser would find: its words, its elements, and that every element is closed."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.words: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] not in {"script", "style"}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.words).split())

    def count(self, tag: str, **wanted: str) -> int:
        return sum(name == tag and wanted.items() <= found.items() for name, found in self.elements)


@pytest.fixture(scope="module")
def run() -> Run:
    return example_run.run()


def page_of(run: Run, folder: Path, compared_with: Run | None = None) -> Page:
    return Page(html.write(run, folder, compared_with).read_text(encoding="utf-8"))


def case(name: str = "silence", verdict: Verdict = Verdict.PASS, **more: object) -> CaseResult:
    return msgspec.structs.replace(
        CaseResult(name=name, proves="It stops.", verdict=verdict, evidence=Evidence.VIRTUAL_BUS), **more
    )


def stop(measured: float | None, limit: float | None = 0.15, text: str = "stop", unit: str = "s") -> Check:
    is_within = measured is None or limit is None or measured <= limit
    verdict = Verdict.PASS if is_within else Verdict.FAIL
    return Check(text=text, verdict=verdict, measured=measured, limit=limit, unit=unit)


def hostile_run(text: str) -> Run:
    """The text wherever a run has one."""
    one = case(
        name=text,
        verdict=Verdict.FAIL,
        proves=text,
        fault=text,
        tags=[text],
        why=text,
        injected=text,
        checks=[Check(text=text, verdict=Verdict.FAIL, measured=2.0, limit=1.0, unit=text, found=[text])],
        events=[result.Event(at_s=1.0, kind=result.EventKind.INJECTION, text=text)],
        measured=[
            Measured(name=text, unit=text, acts_at=3.1, profile=3.0, lowest=2.9, highest=3.2, place=text, key=text)
        ],
        plots=[Plot(title=text, unit=text, series=[Series(name=text, at_s=[0.0, 1.0], values=[0.0, 1.0])], highest=1)],
        distributions=[
            Distribution(name=text, unit=text, count=1, p50=1, p95=1, p99=1, max=1, edges=[0, 1], counts=[1])
        ],
        counts={text: 1},
        candump=text,
        device_log=text,
    )
    run = example_run.run_of([one, msgspec.structs.replace(one, repetition=2)])
    texts = dict.fromkeys(("began", "command", "channel", "profile", "profile_hash", "device"), text)
    return msgspec.structs.replace(run, **texts, environment={text: text})


def test_the_page_begins_with_verdict_and_class_of_evidence(run: Run, tmp_path: Path) -> None:
    text = page_of(run, tmp_path).text
    assert text.index("FAIL") < text.index("Class of evidence") < text.index("Cases")
    assert "virtual bus, simulated vehicle" in text
    assert "a run on a virtual bus is never evidence about hardware" in text
    assert "1 FAIL" in text
    assert "2 NOT EXECUTED" in text
    assert "What was not executed is not proven" in text


def threshold(acts_at: float | None, name: str = "lateral deviation") -> Measured:
    return Measured(name=name, unit="m", acts_at=acts_at, profile=3.0, lowest=2.9, highest=3.2, place="to the left")


@pytest.mark.parametrize(
    ("acts_at", "shown", "verdict"),
    [
        (3.04, "3.04 m", Verdict.PASS),
        (5.0, "5 m", Verdict.FAIL),
        (2.0, "2 m", Verdict.FAIL),
        (None, "did not act", Verdict.FAIL),
    ],
)
def test_a_measured_threshold_is_shown_beside_that_of_the_profile(
    acts_at: float | None, shown: str, verdict: Verdict, tmp_path: Path
) -> None:
    one = threshold(acts_at)
    assert one.verdict is verdict
    page = page_of(example_run.run_of([case("drifting", measured=[one])]), tmp_path)
    assert f"lateral deviation to the left {shown} 3 m 2.9 m to 3.2 m drifting" in page.text
    assert formatting.describe_threshold(one) == f"lateral deviation, to the left: acts at {shown}, profile 3 m"


def test_missed_thresholds_come_first_and_one_that_may_be_lower_has_no_lower_end(tmp_path: Path) -> None:
    kept = msgspec.structs.replace(threshold(0.1, "wheel angle"), lowest=None)
    page = page_of(example_run.run_of([case("a", measured=[kept]), case("b", measured=[threshold(5.0)])]), tmp_path)
    assert page.text.index("5 m 3 m") < page.text.index("0.1 m 3 m at most 3.2 m")
    assert "Measured thresholds" not in page_of(example_run.run_of([case()]), tmp_path).text


def test_measured_thresholds_are_kept_in_the_results(tmp_path: Path) -> None:
    run = example_run.run_of([case(measured=[threshold(3.04)])])
    result.write(run, tmp_path / "results.json")
    assert result.read(tmp_path / "results.json").cases[0].measured == [threshold(3.04)]


@pytest.mark.parametrize("evidence", list(Evidence))
def test_each_class_of_evidence_states_its_limits(evidence: Evidence, tmp_path: Path) -> None:
    text = page_of(msgspec.structs.replace(example_run.run_of([case()]), evidence=evidence), tmp_path).text
    assert evidence in text
    assert "hows nothing about" in text
    assert ("is never evidence about hardware" in text) is (evidence is Evidence.VIRTUAL_BUS)


def test_every_case_and_each_of_its_checks_is_on_the_page(run: Run, tmp_path: Path) -> None:
    page = page_of(run, tmp_path)
    groups = formatting.groups(run)
    assert len(groups) == 65
    assert [found["data-verdict"] for tag, found in page.elements if tag == "tr" and "data-verdict" in found] == [
        group.verdict for group in groups
    ]
    assert page.count("details", **{"class": "case fail"}) == 1
    for group in groups:
        assert group.worst.proves in page.text
        for one in group.cases:
            closest = formatting.closest(one)
            figure = formatting.measured_of_limit(closest) if closest else one.why
            assert figure in page.text
        for check in group.worst.checks:
            assert check.text in page.text
            assert formatting.measured_of_limit(check) in page.text
            for found in check.found:
                assert found in page.text


def test_failed_cases_come_first_and_are_open(run: Run, tmp_path: Path) -> None:
    page = page_of(run, tmp_path)
    cases = [found for tag, found in page.elements if tag == "details" and "data-verdict" in found]
    assert [found["data-verdict"] for found in cases[:3]] == ["FAIL", "NOT EXECUTED", "NOT EXECUTED"]
    assert ["open" in found for found in cases] == [found["data-verdict"] == "FAIL" for found in cases]


def test_repetitions_are_one_row_and_the_worst_is_shown(tmp_path: Path) -> None:
    times_s = (0.03, 0.11, 0.02)
    cases = [case(repetition=n, checks=[stop(s)]) for n, s in enumerate(times_s, start=1)]
    text = page_of(example_run.run_of(cases), tmp_path).text
    assert "3/3 PASS" in text
    assert "Repetition 2 ✓ PASS" in text
    assert "Repetition 1" not in text
    failed = case(verdict=Verdict.FAIL, why="late", repetition=4, checks=[stop(0.2)])
    text = page_of(example_run.run_of([*cases, failed]), tmp_path).text
    assert "3/4 PASS" in text
    assert "Repetition 4 ✕ FAIL" in text


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_stays_text(text: str, tmp_path: Path) -> None:
    plain = page_of(hostile_run("plain"), tmp_path)
    page = page_of(hostile_run(text), tmp_path)
    assert Counter(tag for tag, _ in page.elements) == Counter(tag for tag, _ in plain.elements)
    assert {name for _, found in page.elements for name in found} == {n for _, f in plain.elements for n in f}
    assert not [found for _, found in page.elements if "javascript:" in (found.get("href") or "")]
    assert " ".join(formatting.clean(text).split()) in page.text
    assert not set(" ".join(page.words)) & set("\x00\x1b\r\u202e\u200b\u2028")


def test_a_very_long_text_is_truncated_with_a_note(tmp_path: Path) -> None:
    written = html.write(hostile_run("x" * 1_000_000), tmp_path)
    assert written.stat().st_size < 500_000
    assert "(998000 more characters)" in written.read_text(encoding="utf-8")


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300, -1e300])
def test_nan_and_infinity_are_never_shown_as_numbers(value: float, tmp_path: Path) -> None:
    values = [0.0, value, 1.0, 2.0]
    one = case(
        began_s=value,
        duration_s=value,
        checks=[stop(value), stop(0.1, value)],
        events=[result.Event(at_s=value, kind=result.EventKind.REACTION, text="a stop")],
        plots=[
            Plot(title="speed", unit="m/s", series=[Series(name="v", at_s=[0, 1, 2, 3], values=values)], highest=value),
            Plot(title="angle", unit="rad", series=[Series(name="a", at_s=values, values=[0, 1, 2, None])]),
        ],
        distributions=[
            Distribution(
                name="latency", unit="s", count=2, p50=value, p95=1.0, p99=value, max=value, edges=values, counts=[1, 2]
            )
        ],
        path=Path2D(wanted_x_m=values, wanted_y_m=values, driven_x_m=values[::-1], driven_y_m=values),
    )  # fmt: skip
    run = msgspec.structs.replace(example_run.run_of([one]), duration_s=value)
    page = page_of(run, tmp_path)
    shown = f"{page.text} {[found for _, found in page.elements]}".lower().split()
    assert not [word for word in shown if word.strip("[]{}'\",;:%−-") in {"nan", "inf", "infinity"}]
    assert "not finite or too large to draw" in page.text
    drawn = " ".join(str(found) for tag, found in page.elements if tag in SVG_LEAVES)
    assert "nan" not in drawn
    assert "e+" not in drawn
    junit.write(run, tmp_path / "junit.xml")
    assert not {"nan", "inf", "-inf"} & set((tmp_path / "junit.xml").read_text().replace('"', " ").split())
    words_of(run)


def test_an_empty_run_has_a_page(tmp_path: Path) -> None:
    for cases in ([], [case()], [case(verdict=Verdict.NOT_EXECUTED, why="no adapter")]):
        page_of(example_run.run_of(cases), tmp_path)
        words_of(example_run.run_of(cases))


def test_a_case_that_does_not_apply_shows_its_reason_and_does_not_count_as_passed(tmp_path: Path) -> None:
    absent = case("gear", Verdict.NOT_APPLICABLE, why="needs a gear on its bus, which this vehicle does not have")
    for cases, verdict in (
        ([absent], Verdict.NOT_APPLICABLE),
        ([absent, case()], Verdict.PASS),
        ([absent, case(verdict=Verdict.NOT_EXECUTED)], Verdict.NOT_EXECUTED),
        ([absent, case(verdict=Verdict.FAIL)], Verdict.FAIL),
    ):
        assert result.verdict_of(cases) is verdict
    run = example_run.run_of([absent, case("other")])
    assert "1 passed, 0 failed, 0 not executed, 1 not applicable" in words_of(run)
    page = page_of(run, tmp_path)
    assert "1 NOT APPLICABLE" in page.text
    assert absent.why in page.text
    junit.write(run, tmp_path / "junit.xml")
    suite = ElementTree.parse(tmp_path / "junit.xml").getroot().find("testsuite")
    assert suite is not None
    assert suite.get("skipped") == "1"
    assert [one.get("message") for one in suite.iterfind("testcase/skipped")] == [f"NOT APPLICABLE: {absent.why}"]


def test_only_files_in_the_folder_are_linked(tmp_path: Path) -> None:
    folder = tmp_path / "report"
    (folder / "a b").mkdir(parents=True)
    (folder / "a b" / "1#.log").write_text("frames")
    (tmp_path / "secret").write_text("not of this report")
    assert html.link(folder, "a b/1#.log") == "./a%20b/1%23.log"
    for name in ("", "missing.log", "../secret", str(tmp_path / "secret"), "javascript:alert(1)", "a b", "\0"):
        assert html.link(folder, name) == ""


def test_the_page_is_self_contained(run: Run, tmp_path: Path) -> None:
    text = html.write(run, tmp_path).read_text(encoding="utf-8")
    page = Page(text)
    addresses = [found[name] for _, found in page.elements for name in ("src", "href") if found.get(name)]
    assert {address for address in addresses if address and not address.startswith("#")} == {"data:,"}
    assert "url(" not in text
    assert "@import" not in text
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]


def test_the_page_stays_small_however_long_the_recordings_are(tmp_path: Path) -> None:
    times = [index / 1000 for index in range(60_000)]
    series = Series(name="noise", at_s=times, values=[math.sin(index * index) for index in range(60_000)])
    plots = [Plot(title="angle", unit="rad", series=[series, series])] * 3
    written = html.write(example_run.run_of([case(name="one", plots=plots)]), tmp_path)
    assert written.stat().st_size < 6e6 / 60


def test_a_path_is_shown_around_its_driven_part() -> None:
    far = [float(x) for x in range(400)]
    found = Path2D(wanted_x_m=far, wanted_y_m=[0.0] * 400, driven_x_m=far[:20], driven_y_m=[0.1] * 20)
    drawn = drawing.path(found)
    assert drawn.bar_text == "5 m"
    assert sum(int(step) for step in drawn.driven.split("l")[1].split()[::2]) == pytest.approx(
        0.92 * drawing.WIDTH, abs=2
    )
    whole = Path2D(wanted_x_m=far, wanted_y_m=[0.0] * 400, driven_x_m=far[:250], driven_y_m=[0.1] * 250)
    assert drawing.path(whole).bar_text == "100 m"


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.034, "s", "34 ms"),
        (1.5, "s", "1.5 s"),
        (0.0, "s", "0 s"),
        (-0.0002, "rad", "−0.0002 rad"),
        (12345.0, "", "12 345"),
        (0.99996, "m", "1 m"),
        (123.456, "m", "123 m"),
        (2.5e-7, "s", "0.00025 ms"),
        (1e-7, "m", "1e−07 m"),
        (math.nan, "m", "—"),
        (None, "m", "—"),
    ],
)
def test_numbers_are_short_and_have_their_unit(value: float | None, unit: str, text: str) -> None:
    assert formatting.quantity(value, unit) == text


def test_a_margin_is_read_in_the_unit_of_its_limit() -> None:
    assert formatting.measured_of_limit(stop(0.0344, 0.15)) == "34.4 of 150 ms"
    assert formatting.measured_of_limit(stop(1.2, 0.15)) == "1200 of 150 ms"
    assert formatting.used(stop(3, 0, unit="")) == math.inf
    assert formatting.used(stop(0, 0, unit="")) == 0.0
    assert formatting.used(stop(None)) is None


def test_the_junit_file_has_each_result_with_its_checks(run: Run, tmp_path: Path) -> None:
    junit.write(run, tmp_path / "junit.xml")
    root = ElementTree.parse(tmp_path / "junit.xml").getroot()
    (suite,) = root
    cases = suite.findall("testcase")
    expected = {"tests": "84", "failures": "1", "errors": "0", "skipped": "2"}
    assert {name: suite.get(name) for name in expected} == expected
    assert len(cases) == 84
    assert len({(found.get("classname"), found.get("name")) for found in cases}) == 84
    (failure,) = suite.iterfind("testcase/failure")
    assert failure.get("message") == "a stop command is on the bus within 150 ms of the fault: 212 ms"
    assert "FAIL: a stop command is on the bus within 150 ms of the fault: 212 of 150 ms" in (failure.text or "")
    assert "REASON stays NOMINAL until 4.212 s" in (failure.text or "")
    assert [found.get("message") for found in suite.iterfind("testcase/skipped")] == [
        "NOT EXECUTED: needs an adapter that reports error frames; vcan0 has none"
    ] * 2
    properties = {found.get("name"): found.get("value") for found in suite.iterfind("properties/property")}
    assert properties["evidence"] == "virtual bus, simulated vehicle"
    assert properties["profile_hash"] == run.profile_hash
    assert properties["seed"] == "1"


@pytest.mark.parametrize("text", HOSTILE)
def test_the_junit_file_is_valid_xml_for_any_text(text: str, tmp_path: Path) -> None:
    junit.write(hostile_run(text), tmp_path / "junit.xml")
    found = ElementTree.parse(tmp_path / "junit.xml").getroot().find("testsuite/testcase/failure")
    assert found is not None
    assert found.get("message") == formatting.clean(text)


def test_a_run_compared_with_itself_has_no_differences(run: Run) -> None:
    found = compare.differences(run, run)
    assert [found.loud, found.verdicts, found.new_cases, found.gone_cases, found.moved, found.environment] == [[]] * 6
    assert "no verdict has changed" in compare.text(found)


def test_changed_verdicts_come_first_worse_before_better(tmp_path: Path) -> None:
    old = example_run.run_of([case("a", Verdict.FAIL, why="late"), case("b"), case("gone"), case("c")])
    new = example_run.run_of([case("a"), case("b", Verdict.NOT_EXECUTED, why="no adapter"), case("new"), case("c")])
    found = compare.differences(old, new)
    assert [(change.name, change.is_worse) for change in found.verdicts] == [("b", True), ("a", False)]
    assert (found.new_cases, found.gone_cases) == (["new"], ["gone"])
    text = compare.text(found)
    assert "worse  b: PASS → NOT EXECUTED (no adapter)" in text
    assert "better a: FAIL → PASS" in text
    page = page_of(new, tmp_path, compared_with=old)
    assert page.text.index("Since the run of") < page.text.index("Cases")
    assert "New cases new" in page.text
    assert "Removed cases gone" in page.text


@pytest.mark.parametrize(
    ("old_s", "new_s", "is_notable"),
    [
        (0.040, 0.050, True),
        (0.040, 0.049, False),
        (0.050, 0.040, True),
        (0.0010, 0.0019, False),
        (0.0010, 0.0031, True),
        (0.0, 0.003, True),
    ],
)
def test_a_time_has_changed_if_it_grew_by_a_quarter_and_by_more_than_a_period(
    old_s: float, new_s: float, is_notable: bool, tmp_path: Path
) -> None:
    old, new = (example_run.run_of([case(checks=[stop(measured)])]) for measured in (old_s, new_s))
    found = compare.differences(old, new)
    assert [(moved.old, moved.new) for moved in found.moved] == ([(old_s, new_s)] if is_notable else [])
    assert ("measurements changed notably" in page_of(new, tmp_path, old).text) is is_notable


def test_the_worst_of_all_repetitions_is_compared(run: Run) -> None:
    old = example_run.run_of([case(checks=[stop(0.02)], repetition=n) for n in (1, 2)])
    new = example_run.run_of([case(checks=[stop(0.02 * n)], repetition=n) for n in (1, 2)])
    assert [moved.new for moved in compare.differences(old, new).moved] == [0.04]
    slower = compare.differences(run, example_run.run(slower=1.5))
    assert {"state to command p99", "state to command max"} <= {moved.what for moved in slower.moved}
    assert all(moved.is_worse and moved.ratio == pytest.approx(1.5) for moved in slower.moved)


def test_another_profile_or_class_of_evidence_is_prominent(run: Run, tmp_path: Path) -> None:
    other = msgspec.structs.replace(
        run, profile_hash="0" * 64, evidence=Evidence.REAL_BUS, environment={**run.environment, "python": "3.13"}
    )
    found = compare.differences(other, run)
    assert [text.split(":")[0] for text in found.loud] == ["ANOTHER CLASS OF EVIDENCE", "ANOTHER PROFILE"]
    assert found.environment == [("python", "3.13", "CPython 3.11.7")]
    for text in (compare.text(found), page_of(run, tmp_path, compared_with=other).text):
        assert "ANOTHER CLASS OF EVIDENCE: real bus, simulated vehicle then" in text
        assert "ANOTHER PROFILE" in text


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_of_an_older_run_stays_text(text: str, tmp_path: Path) -> None:
    old, new = hostile_run(text), hostile_run(text)
    old = msgspec.structs.replace(old, profile_hash="0", cases=[case("gone" + text), *old.cases])
    assert "\x1b" not in compare.text(compare.differences(old, new))
    assert page_of(new, tmp_path, old).count("script") == 1


def words_of(run: Run, *, is_terminal: bool = False) -> str:
    """What the bench's user reads."""
    told = io.StringIO()
    console = Console(file=told, force_terminal=is_terminal, width=100, highlight=False, soft_wrap=True)
    progress = terminal.Progress(console=console)
    progress.on_run_start(len(run.cases))
    for one in run.cases:
        progress.on_case_start(one.name, one.proves)
        progress.on_case_end(one)
    progress.on_run_end(run)
    return told.getvalue()


def test_without_a_terminal_each_case_is_a_plain_line(run: Run) -> None:
    lines = words_of(run).splitlines()
    assert not [line for line in lines if "\x1b" in line]
    assert lines[0].startswith(" 1/84 PASS            link_down ")
    assert "10/84 FAIL            flood_of_foreign_ids" in lines[9]
    assert sum("/84 " in line for line in lines) == 84
    assert lines[-2].startswith("FAIL  81 passed, 1 failed, 2 not executed in ")
    assert lines[-1] == "Evidence: virtual bus, simulated vehicle"


def test_failed_cases_are_listed_next_to_the_verdict(run: Run) -> None:
    end = words_of(run).split("Not passed")[1]
    assert (
        end.index("transmit_queue_full") < end.index("flood_of_foreign_ids") < end.index("Passed, closest to a limit")
    )


def test_a_terminal_shows_the_current_case_and_gets_its_cursor_back(run: Run) -> None:
    told = words_of(run, is_terminal=True)
    assert "\x1b[?25l" in told
    assert told.rindex("\x1b[?25h") > told.rindex("\x1b[?25l")
    assert "81 passed" in told


def test_the_cursor_is_restored_when_the_run_is_aborted() -> None:
    program = """
from rich.console import Console
from hil_bench.report.terminal import Progress
Progress(console=Console(force_terminal=True)).on_run_start(1)
raise KeyboardInterrupt
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT / "tools")}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment)
    assert done.returncode != 0
    assert done.stdout.rindex("\x1b[?25h") > done.stdout.rindex("\x1b[?25l")


def test_progress_goes_to_the_error_output_with_json(run: Run, capfd: pytest.CaptureFixture[str]) -> None:
    for to_error in (False, True):
        terminal.Progress(to_error=to_error).on_case_end(run.cases[0])
        told = capfd.readouterr()
        assert ("link_down" in told.out, "link_down" in told.err) == (not to_error, to_error)


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_text_neither_moves_the_cursor_nor_forges_a_line(text: str) -> None:
    plain = words_of(hostile_run("plain")).splitlines()
    told = words_of(hostile_run(text))
    assert "\x1b" not in told
    assert sum("/2 " in line for line in told.splitlines()) == sum("/2 " in line for line in plain)
    assert formatting.clean(text)[:40] in told


def test_a_run_goes_to_json_and_back(run: Run, tmp_path: Path) -> None:
    result.write(run, tmp_path / "run.json")
    assert result.read(tmp_path / "run.json") == run


def test_a_gap_in_a_curve_goes_to_json_and_back(tmp_path: Path) -> None:
    series = Series(name="angle", at_s=[0.0, 1.0], values=[math.nan, 1.0])
    run = example_run.run_of([case(plots=[Plot(title="", unit="", series=[series])])])
    result.write(run, tmp_path / "run.json")
    assert result.read(tmp_path / "run.json").cases[0].plots[0].series[0].values == [None, 1.0]


def test_a_result_that_could_not_be_read_back_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(msgspec.ValidationError, match="duration_s"):
        result.write(example_run.run_of([case(duration_s=math.nan)]), tmp_path / "run.json")
    assert not (tmp_path / "run.json").exists()


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"format": 2}, r"2.*\$\.format"),
        ({"format": 0}, r"0.*\$\.format"),
        ({"cases": 1}, r"\$\.cases"),
        ({"verdict": "MAYBE"}, r"MAYBE.*\$\.verdict"),
    ],
)
def test_another_format_is_rejected_with_the_field(change: dict[str, object], complaint: str, tmp_path: Path) -> None:
    written = {**msgspec.to_builtins(example_run.run_of([case()])), **change}
    (tmp_path / "run.json").write_bytes(msgspec.json.encode(written))
    with pytest.raises(msgspec.ValidationError, match=complaint):
        result.read(tmp_path / "run.json")


def test_the_terminal_does_not_list_what_an_interruption_left_out() -> None:
    why = "interrupted in case 2 of 3"
    names = {"silence": "no adapter", "jitter": why, "killed": why}
    run = example_run.run_of([case(name, Verdict.NOT_EXECUTED, why=text) for name, text in names.items()])
    words = words_of(msgspec.structs.replace(run, interrupted=why))
    assert "no adapter" in words
    assert words.partition("Not passed")[2].count(why) == 1
    assert "3 not executed" in words


def test_the_page_begins_with_the_version_of_the_device_and_the_hash_of_its_files(tmp_path: Path) -> None:
    known = {"device_version": "loop <1.2>", "device_hash": "0123456789abcdef" * 4}
    old = example_run.run_of([case()])
    new = msgspec.structs.replace(old, **known)
    text = page_of(new, tmp_path, compared_with=old).text
    assert text.index("loop <1.2>") < text.index("Class of evidence")
    assert text.index("0123456789ab") < text.index("Class of evidence")
    assert f"{known['device_hash']}" in text[text.index("Environment of this run") :]
    names = [name for name, _, _ in compare.differences(old, new).environment]
    assert names == ["version of the device", "files of the device (SHA-256)"]

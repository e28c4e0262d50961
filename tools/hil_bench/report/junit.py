"""JUnit XML, as CI servers read it: a test case for each repetition of each case."""

from pathlib import Path
from xml.etree import ElementTree

from hil_bench.report.formatting import clean, count, is_finite, measured_of_limit
from hil_bench.result import CaseResult, Run, Verdict


def write(run: Run, path: Path) -> None:
    """NOT EXECUTED and NOT APPLICABLE are `skipped` with their reason; what a failure found is in its text."""
    counts = {
        "tests": str(len(run.cases)),
        "failures": str(count(run, Verdict.FAIL)),
        "errors": "0",
        "skipped": str(count(run, Verdict.NOT_EXECUTED) + count(run, Verdict.NOT_APPLICABLE)),
        "time": _seconds(run.duration_s),
    }
    root = ElementTree.Element("testsuites", {"name": "hil", **counts})
    suite = ElementTree.SubElement(root, "testsuite", {"name": clean(f"hil.{run.profile}"), **counts})
    suite.set("timestamp", clean(run.began))
    suite.set("hostname", clean(run.environment.get("host", "")))
    _properties(
        suite,
        {
            "verdict": run.verdict,
            "evidence": run.evidence,
            "profile": run.profile,
            "profile_hash": run.profile_hash,
            "seed": str(run.seed),
            "channel": run.channel,
            "device": run.device,
            "command": run.command,
            **{f"environment.{name}": value for name, value in run.environment.items()},
        },
    )
    repeated = {case.name for case in run.cases if case.repetition > 1}
    for case in run.cases:
        _case(suite, case, f"{case.name} [{case.repetition}]" if case.name in repeated else case.name, run.profile)
    tree = ElementTree.ElementTree(root)
    ElementTree.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)


def _case(suite: ElementTree.Element, case: CaseResult, name: str, profile: str) -> None:
    element = ElementTree.SubElement(suite, "testcase", {"classname": clean(f"hil.{profile}"), "name": clean(name)})
    element.set("time", _seconds(case.duration_s))
    _properties(
        element,
        {"proves": case.proves, "fault": case.fault, "tags": " ".join(case.tags), "seed": str(case.seed)}
        | {"evidence": case.evidence},
    )
    if case.verdict is Verdict.FAIL:
        failure = ElementTree.SubElement(element, "failure", {"message": clean(case.why), "type": "check"})
        failure.text = _checks(case)
    elif case.verdict is Verdict.NOT_EXECUTED:
        ElementTree.SubElement(element, "skipped", {"message": clean(case.why)})
    elif case.verdict is Verdict.NOT_APPLICABLE:
        ElementTree.SubElement(element, "skipped", {"message": clean(f"{case.verdict}: {case.why}")})
    if case.verdict is not Verdict.FAIL and case.checks:
        ElementTree.SubElement(element, "system-out").text = _checks(case)


def _properties(parent: ElementTree.Element, values: dict[str, str]) -> None:
    inside = ElementTree.SubElement(parent, "properties")
    for name, value in values.items():
        ElementTree.SubElement(inside, "property", {"name": clean(name), "value": clean(value)})


def _seconds(value: float) -> str:
    return f"{value:.3f}" if is_finite(value) else "0"


def _checks(case: CaseResult) -> str:
    lines = []
    for check in case.checks:
        measured = measured_of_limit(check)
        lines.append(clean(f"{check.verdict}: {check.text}" + (f": {measured}" if measured else "")))
        lines += [f"    {clean(found)}" for found in check.found]
    return "\n".join(lines)

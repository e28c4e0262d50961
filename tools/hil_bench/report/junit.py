"""JUnit XML, as CI servers read it: a test case for each repetition of each case.

The structure is what the schemas of Ant and of Jenkins' xUnit plug-in have in common: counts and time stand on the
suite, a test case has at most one child, and a time stamp has no offset (it is UTC).
"""

from datetime import UTC, datetime
from pathlib import Path
from xml.etree import ElementTree

from hil_bench.report.formatting import attempt, clean, count, is_finite, measured_of_limit
from hil_bench.result import CaseResult, Run, Verdict

NO_TIME = "1970-01-01T00:00:00"


def write(run: Run, path: Path) -> None:
    """NOT EXECUTED and NOT APPLICABLE are `skipped` with their reason; what a failure found is in its text."""
    root = ElementTree.Element("testsuites")
    suite = ElementTree.SubElement(root, "testsuite")
    suite.attrib |= {
        "name": clean(f"hil.{run.profile}"),
        "package": "hil",
        "id": "0",
        "tests": str(len(run.cases)),
        "failures": str(count(run, Verdict.FAIL)),
        "errors": "0",
        "skipped": str(count(run, Verdict.NOT_EXECUTED) + count(run, Verdict.NOT_APPLICABLE)),
        "time": _seconds(run.duration_s),
        "timestamp": _timestamp(run.began),
        "hostname": clean(run.environment.get("host", "")) or "localhost",
    }
    _properties(suite, run)
    repeated = {case.name for case in run.cases if case.repetition > 1}
    names = [f"{case.name} [{case.repetition}]" if case.name in repeated else case.name for case in run.cases]
    for name, case in zip(names, run.cases, strict=True):
        _case(suite, case, name, run.profile)
    judged = [_text(name, case) for name, case in zip(names, run.cases, strict=True) if case.checks]
    ElementTree.SubElement(suite, "system-out").text = "\n\n".join(judged)
    ElementTree.SubElement(suite, "system-err")
    tree = ElementTree.ElementTree(root)
    ElementTree.indent(tree)
    tree.write(path, encoding="utf-8", xml_declaration=True)


def _case(suite: ElementTree.Element, case: CaseResult, name: str, profile: str) -> None:
    element = ElementTree.SubElement(suite, "testcase", {"classname": clean(f"hil.{profile}"), "name": clean(name)})
    element.set("time", _seconds(case.duration_s))
    if case.verdict is Verdict.FAIL:
        failure = ElementTree.SubElement(element, "failure", {"message": clean(case.why), "type": "check"})
        failure.text = _checks(case)
    elif case.verdict is not Verdict.PASS:
        ElementTree.SubElement(element, "skipped", {"message": clean(f"{case.verdict}: {case.why}")})
    if case.void:
        ElementTree.SubElement(element, "system-out").text = clean(f"{case.verdict}, {attempt(case)}")


def _properties(suite: ElementTree.Element, run: Run) -> None:
    values = {
        "verdict": run.verdict,
        "evidence": run.evidence,
        "profile": run.profile,
        "profile_hash": run.profile_hash,
        "seed": str(run.seed),
        "channel": run.channel,
        "device": run.device,
        "device_version": run.device_version,
        "device_hash": run.device_hash,
        "command": run.command,
        **{f"environment.{name}": value for name, value in run.environment.items()},
    }
    inside = ElementTree.SubElement(suite, "properties")
    for name, value in values.items():
        ElementTree.SubElement(inside, "property", {"name": clean(name), "value": clean(value)})


def _timestamp(began: str) -> str:
    try:
        return datetime.fromisoformat(began).astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")
    except (ValueError, OverflowError):
        return NO_TIME


def _seconds(value: float) -> str:
    return f"{value:.3f}" if is_finite(value) else "0"


def _text(name: str, case: CaseResult) -> str:
    """What a case proves, and each of its checks."""
    about = [
        ("fault", case.fault),
        ("tags", " ".join(case.tags)),
        ("seed", str(case.seed)),
        ("evidence", case.evidence),
    ]
    facts = "; ".join(f"{what} {value}" for what, value in about if value)
    return "\n".join([clean(f"{name}: {case.proves}"), clean(facts), _checks(case)])


def _checks(case: CaseResult) -> str:
    lines = []
    for check in case.checks:
        measured = measured_of_limit(check)
        lines.append(clean(f"{check.verdict}: {check.text}" + (f": {measured}" if measured else "")))
        lines += [f"    {clean(found)}" for found in check.found]
    return "\n".join(lines)

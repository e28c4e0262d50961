"""The files for programs: the JSON schema of the results, and JUnit that strict readers accept."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import example_run
import msgspec
import pytest
from hil_bench import cli, result
from hil_bench.report import junit
from hil_bench.result import Run

CHILDREN = {
    "testsuites": r"(testsuite )*",
    "testsuite": r"properties (testcase )*system-out system-err ",
    "properties": r"(property )*",
    "property": "",
    "testcase": r"((skipped|error|failure) )?",
    "skipped": "",
    "failure": "",
    "system-out": "",
    "system-err": "",
}
"""The children of each element, in the order that the schemas of Ant and of Jenkins' xUnit plug-in allow."""
NUMBER, SECONDS, WORDS = r"\d+", r"\d+(\.\d+)?", r"(?s).+"
ATTRIBUTES: dict[str, dict[str, str]] = {
    "testsuite": {
        **dict.fromkeys(("tests", "failures", "errors", "skipped", "id"), NUMBER),
        **dict.fromkeys(("name", "hostname", "package"), WORDS),
        "time": SECONDS,
        "timestamp": r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d",
    },
    "property": {"name": WORDS, "value": r"(?s).*"},
    "testcase": {"name": WORDS, "classname": WORDS, "time": SECONDS},
    "skipped": {"message": WORDS},
    "failure": {"message": WORDS, "type": WORDS},
}
"""The attributes of each element, all required, no others allowed."""


def structure_faults(element: ElementTree.Element) -> Iterator[str]:
    """Everything that a strict reader rejects."""
    children = "".join(f"{child.tag} " for child in element)
    if not re.fullmatch(CHILDREN.get(element.tag, "(?!)"), children):
        yield f"{element.tag}: children {children}"
    wanted = ATTRIBUTES.get(element.tag, {})
    if set(wanted) != set(element.attrib):
        yield f"{element.tag}: attributes {sorted(element.attrib)}"
    for name, pattern in wanted.items():
        if not re.fullmatch(pattern, element.get(name, "")):
            yield f"{element.tag}: {name}={element.get(name)!r}"
    for child in element:
        yield from structure_faults(child)


@pytest.mark.parametrize("began", ["2026-11-22T07:12:09+05:00", "no date"])
@pytest.mark.parametrize("host", ["bench", ""])
def test_the_junit_file_has_the_structure_that_strict_readers_accept(began: str, host: str, tmp_path: Path) -> None:
    run = msgspec.structs.replace(example_run.run(), began=began, environment={"host": host})
    junit.write(run, tmp_path / "junit.xml")
    root = ElementTree.parse(tmp_path / "junit.xml").getroot()
    assert list(structure_faults(root)) == []
    suite = root[0]
    assert suite.get("timestamp") == ("2026-11-22T02:12:09" if "+" in began else junit.NO_TIME)
    assert int(suite.get("tests", "")) == len(suite.findall("testcase")) == len(run.cases)
    assert int(suite.get("skipped", "")) == len(suite.findall("testcase/skipped"))
    assert int(suite.get("failures", "")) == len(suite.findall("testcase/failure"))


def test_a_file_that_strict_readers_reject_is_found() -> None:
    bad = '<testsuites><testsuite name=""><testcase name="a"><properties/></testcase></testsuite></testsuites>'
    assert len(list(structure_faults(ElementTree.fromstring(bad)))) >= 4


def test_the_published_schema_is_that_of_the_results() -> None:
    assert result.SCHEMA.read_text(encoding="utf-8") == result.schema() + "\n", (
        "a result has changed: tools/hil_bench.py --schema > tools/hil_bench/results.schema.json"
    )


def test_the_schema_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["--schema"]) == cli.PASSED
    assert json.loads(capsys.readouterr().out) == msgspec.json.schema(Run)


def schema_faults(value: object, schema: dict[str, object], parts: dict[str, dict[str, object]], at: str) -> list[str]:
    """Where a value differs from the part of JSON schema that describes results."""
    while "$ref" in schema:
        schema = parts[str(schema["$ref"]).rsplit("/", 1)[-1]]
    if "anyOf" in schema:
        found = [schema_faults(value, one, parts, at) for one in schema["anyOf"]]  # type: ignore[attr-defined]
        return min(found, key=len)
    if "enum" in schema:
        return [] if value in schema["enum"] else [f"{at}: {value!r}"]  # type: ignore[operator]
    kind = schema.get("type")
    kinds = {"object": dict, "array": list, "string": str, "number": (int, float), "integer": int}
    kinds |= {"boolean": bool, "null": type(None)}
    if not isinstance(value, kinds[str(kind)]):  # type: ignore[arg-type]
        return [f"{at}: {value!r} is no {kind}"]
    if isinstance(value, list):
        items: dict[str, object] = schema.get("items", {})  # type: ignore[assignment]
        return [fault for one in value[:50] for fault in schema_faults(one, items, parts, f"{at}[]")] if items else []
    if isinstance(value, dict):
        fields: dict[str, dict[str, object]] = schema.get("properties", {})  # type: ignore[assignment]
        missing = [f"{at}.{name}: missing" for name in schema.get("required", []) if name not in value]  # type: ignore[attr-defined]
        other = [f"{at}.{name}: not in the schema" for name in value if fields and name not in fields]
        inside = [f for name in fields if name in value for f in schema_faults(value[name], fields[name], parts, name)]
        return missing + other + inside
    return []


def test_a_file_of_results_has_the_published_schema(tmp_path: Path) -> None:
    result.write(example_run.run(), tmp_path / "results.json")
    schema = json.loads(result.SCHEMA.read_text(encoding="utf-8"))
    written = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert schema_faults(written, schema, schema["$defs"], "run") == []
    written["cases"][0]["verdict"] = "GOOD"
    del written["seed"]
    assert len(schema_faults(written, schema, schema["$defs"], "run")) == 2

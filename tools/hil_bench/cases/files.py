"""Cases of trajectories and profiles that the device must reject at the start."""

import re
from collections.abc import Callable
from dataclasses import replace

from hil_bench import routes
from hil_bench.case import Case, Need, Then
from hil_bench.expect import Refuses


def _change_line(number: int, change: Callable[[list[str]], str]) -> Callable[[str], str]:
    """Change one line of a trajectory, given as its cells."""

    def change_text(text: str) -> str:
        lines = text.splitlines()
        lines[number] = change(lines[number].split(","))
        return "\n".join(lines) + "\n"

    return change_text


def _replace_cell(line: int, column: int, text: str) -> Callable[[str], str]:
    return _change_line(line, lambda cells: ",".join([*cells[:column], text, *cells[column + 1 :]]))


def _rejected_trajectory(name: str, what: str, breaks: Callable[[str], str], fault: str = "T5") -> Case:
    return Case(
        name=f"trajectory-{name}",
        fault=fault,
        tags=("trajectory", "refusal"),
        proves=f"A trajectory {what} is rejected before the first frame.",
        injected=f"the device loads a trajectory {what}",
        breaks=breaks,
        at_mps=-1.0,
        for_s=0.1,
        see=(Refuses(2),),
        then=Then.ENDED,
        exit_status=(2,),
        needs=(Need.OWN_PROCESS,),
        answers_in_time=False,
    )


def _rejected_profile(name: str, what: str, fault: str, profile: Callable[[str, str], tuple[str, str]]) -> Case:
    return Case(
        name=f"profile-{name}",
        fault=fault,
        tags=("profile", "refusal"),
        proves=f"A profile {what} is rejected before the first frame.",
        injected=f"the device loads a profile {what}",
        profile=profile,
        at_mps=-1.0,
        for_s=0.1,
        see=(Refuses(2),),
        then=Then.ENDED,
        exit_status=(2,),
        needs=(Need.OWN_PROCESS,),
        answers_in_time=False,
    )


def _remove_line(text: str, start: str) -> str:
    return "\n".join(line for line in text.splitlines() if not line.startswith(start)) + "\n"


def _set_key(toml: str, key: str, value: str) -> str:
    return re.sub(rf"^({key} = )[^ #\n]+", rf"\g<1>{value}", toml, count=1, flags=re.MULTILINE)


def _speed_signal(toml: str) -> str:
    """The name of the first signal that carries the measured speed."""
    found = re.search(r"^speed_mps = [^\"\n]*\"\w+\.(\w+)\"", toml.partition("[state.signals]")[2], re.MULTILINE)
    return found[1] if found else ""


def _misspell_speed(toml: str) -> str:
    name = _speed_signal(toml)
    return re.sub(rf"\.{name}\b", f".{name}_X", toml) if name else toml


def _remove_factors(toml: str, dbc: str) -> str:
    """Give every signal with the name of the speed's a factor of 0."""
    name = _speed_signal(toml)
    return re.sub(rf"(SG_ {name} [^(]*\()[^,]+,", r"\g<1>0,", dbc) if name else dbc


def _overlap_signals(toml: str, dbc: str) -> str:
    """Give two signals of the state that are in one message the same start bit."""
    bound = re.findall(r"\"(\w+)\.(\w+)\"", toml.partition("[state.signals]")[2].partition("\n[status")[0])
    for message, first in bound:
        second = next((name for owner, name in bound if owner == message and name != first), None)
        block = re.search(rf"^BO_ \d+ {message}:.*?(?=^BO_ |^\s*$)", dbc, re.MULTILINE | re.DOTALL)
        if second is None or block is None:
            continue
        start = re.search(rf"SG_ {first} [^:]*: (\d+)\|", block[0])
        if start is not None:
            spoilt = re.sub(rf"(SG_ {second} [^:]*: )\d+\|", rf"\g<1>{start[1]}|", block[0])
            return dbc.replace(block[0], spoilt)
    return dbc


def _duplicate_first_identifier(dbc: str) -> str:
    """Give the second message the identifier of the first."""
    first, second = re.findall(r"^BO_ (\d+) ", dbc, re.MULTILINE)[:2]
    return dbc.replace(f"BO_ {second} ", f"BO_ {first} ", 1)


FILES = (
    _rejected_trajectory("with-text-in-a-cell", "with text in a cell", _replace_cell(20, 1, "abc")),
    _rejected_trajectory("with-a-decimal-comma", "with a decimal comma", _replace_cell(20, 1, "1,5")),
    _rejected_trajectory("without-a-column", "without a column", lambda text: text.replace(",heading_rad", "", 1)),
    _rejected_trajectory("empty-file", "in an empty file", lambda text: ""),  # noqa: ARG005
    _rejected_trajectory("with-another-delimiter", "with semicolons", lambda text: text.replace(",", ";")),
    _rejected_trajectory("with-nan", "with NaN", _replace_cell(20, 3, "nan"), "T2"),
    _rejected_trajectory("with-decreasing-time", "whose time decreases", _replace_cell(20, 0, "0.001"), "T2"),
    _rejected_trajectory("with-a-step-back", "that steps back to its first point", _replace_cell(20, 1, "0.0"), "T6"),
    _rejected_trajectory("too-fast", "faster than the vehicle's limit", _replace_cell(20, 4, "35.0"), "T2"),
    replace(
        _rejected_trajectory("too-sharp", "with a curve sharper than the steering limit", lambda text: text, "T2"),
        tags=("trajectory", "refusal", "quick"),
        route=lambda: routes.route("sharp", [(20.0, 0.0), (5.0, 0.6), (20.0, 0.0)], 3.0),
    ),
    _rejected_profile(
        "without-a-limit", "that lacks a limit", "F8", lambda toml, dbc: (_remove_line(toml, "accel_rate_mps3"), dbc)
    ),
    _rejected_profile("with-nan", "with a limit of NaN", "F8", lambda t, d: (_set_key(t, "accel_min_mps2", "nan"), d)),
    _rejected_profile(
        "with-a-misspelt-key", "with a misspelt key", "F8", lambda t, d: (t.replace("wheelbase_m", "wheelbas_m"), d)
    ),
    _rejected_profile(
        "with-a-key-twice", "with a duplicate key", "F8", lambda t, d: (t.replace("[bus]\n", "[bus]\nbitrate = 1\n"), d)
    ),
    _rejected_profile(
        "with-text-for-a-number",
        "with text for a number",
        "F8",
        lambda t, d: (_set_key(t, "accel_rate_mps3", '"much"'), d),
    ),
    _rejected_profile(
        "with-an-absent-signal",
        "with a signal that does not exist",
        "F8",
        lambda t, d: (_misspell_speed(t), d),
    ),
    _rejected_profile("with-a-truncated-dbc", "with a truncated DBC", "F7", lambda t, d: (t, d[: len(d) // 2])),
    _rejected_profile("with-a-dbc-of-garbage", "whose DBC is garbage", "F7", lambda t, d: (t, d[::-1])),
    _rejected_profile(
        "with-overlapping-signals",
        "whose DBC has overlapping signals",
        "F7",
        lambda t, d: (t, _overlap_signals(t, d)),
    ),
    _rejected_profile(
        "with-a-factor-of-0", "whose DBC has a factor of 0", "F7", lambda t, d: (t, _remove_factors(t, d))
    ),
    _rejected_profile(
        "with-an-identifier-twice",
        "whose DBC has one identifier twice",
        "F7",
        lambda t, d: (t, _duplicate_first_identifier(d)),
    ),
)

"""DBC files: read, inspected, checked and compiled.

Law: `read_dbc` gives a database or `ConfigError`; checking gives findings and raises nothing. Whatever was read
compiles, and what its codec decodes with checks is finite and encodes to what it was decoded from.
"""

import math
from collections.abc import Iterator
from itertools import islice

from cantools.database import Message

from fuzzing.engine.input_bytes import written
from vehicle_iface.codec import MessageCodec
from vehicle_iface.codec.dbc_file import read_dbc
from vehicle_iface.codec.dbc_findings import ERROR
from vehicle_iface.codec.lint import check_file
from vehicle_iface.errors import ConfigError, SignalError

LENGTH = 6000
_HEAD = 'VERSION ""\nNS_ :\nBS_:\nBU_: A B\n'
_MOST_MESSAGES = 20


def run(data: bytes) -> None:
    path = written("fuzzed.dbc", data)
    findings = check_file(path)
    assert not any("\n" in str(finding) for finding in findings)
    try:
        file = read_dbc(path)
    except ConfigError:
        assert any(finding.severity == ERROR for finding in findings), "refused, but the check found no error"
        return
    for message in islice(file.messages.values(), _MOST_MESSAGES):
        _compile(message)


def _compile(message: Message) -> None:
    codec = MessageCodec(message)
    for payload in (bytes(codec.length), b"\xff" * codec.length, bytes(range(256))[: codec.length]):
        try:
            values = codec.decode(payload)
        except SignalError:
            continue
        assert all(value is None or math.isfinite(value) for value in values)
        assert codec.decode(codec.encode(values)) == values


def seeds() -> Iterator[bytes]:
    yield f'{_HEAD}BO_ 256 M: 8 A\n SG_ S : 0|8@1+ (1,0) [0|255] "" B\n'.encode()
    yield f'{_HEAD}BO_ 2147484000 M: 8 A\n SG_ S : 7|16@0- (0.1,-5) [-10|10] "m/s" B\n'.encode()
    multiplexed = ' SG_ X M : 0|4@1+ (1,0) [0|0] "" B\n SG_ A m0 : 8|8@1+ (1,0) [0|0] "" B\n'
    multiplexed += ' SG_ B m1M : 8|8@1+ (1,0) [0|0] "" B\n SG_ C m2 : 16|8@1+ (1,0) [0|0] "" B\n'
    yield f"{_HEAD}BO_ 1 M: 8 A\n{multiplexed}SG_MUL_VAL_ 1 C B 2-3, 5-5;\n".encode()
    floats = f'{_HEAD}BO_ 1 M: 12 A\n SG_ F : 0|32@1- (1,0) [0|0] "" B\n SG_ D : 32|64@1- (1,0) [0|0] "" B\n'
    yield f"{floats}SIG_VALTYPE_ 1 F : 1;\nSIG_VALTYPE_ 1 D : 2;\n".encode()
    tail = 'VAL_TABLE_ T 0 "a" 1 "b" ;\nVAL_ 1 S 0 "OFF" 1 "ON" ;\nCM_ SG_ 1 S "so";\n'
    tail += 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 1000;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
    tail += 'BA_ "GenMsgCycleTime" BO_ 1 10;\n'
    yield f'{_HEAD}BO_ 1 M: 1 A\n SG_ S : 0|8@1+ (1,0) [0|1] "" B\n{tail}'.encode()

"""What no device may do in any case, and what is measured in every case: one module for each judge.

The protocol is judged by the bus contract, the values by the profile's limits, the case by its expectations.
"""

from hil_bench.judges.answers import check_answers
from hil_bench.judges.excuses import CONTENT, Failed, decide, select_content, select_unexplained
from hil_bench.judges.health import check_alive, check_health, check_preparation
from hil_bench.judges.memory import check_memory
from hil_bench.judges.path import check_path
from hil_bench.judges.protocol import KINDS, check_protocol

__all__ = [
    "CONTENT",
    "KINDS",
    "Failed",
    "check_alive",
    "check_answers",
    "check_health",
    "check_memory",
    "check_path",
    "check_preparation",
    "check_protocol",
    "decide",
    "select_content",
    "select_unexplained",
]

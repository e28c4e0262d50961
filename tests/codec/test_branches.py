"""Branches of multiplexed messages that together show every signal."""

from cantools.database.can import Database

from vehicle_iface.codec.branches import find_branches

DBC = """
BO_ 1 TREE: 8 CAR
 SG_ PAGE M : 0|4@1+ (1,0) [0|15] "" PC
 SG_ ALWAYS : 4|4@1+ (1,0) [0|15] "" PC
 SG_ ONE m1 : 8|8@1+ (1,0) [0|255] "" PC
 SG_ TWO m2 : 32|8@1+ (1,0) [0|255] "" PC
 SG_ SUB m3M : 24|4@1+ (1,0) [0|15] "" PC
 SG_ DEEP m5 : 16|8@1+ (1,0) [0|255] "" PC
 SG_ DEEPER m6 : 40|8@1+ (1,0) [0|255] "" PC

SG_MUL_VAL_ 1 ONE PAGE 1-1;
SG_MUL_VAL_ 1 TWO PAGE 2-2;
SG_MUL_VAL_ 1 SUB PAGE 3-4;
SG_MUL_VAL_ 1 DEEP SUB 5-5;
SG_MUL_VAL_ 1 DEEPER SUB 6-7;
"""
_DATABASE = Database()
_DATABASE.add_dbc_string(f"BU_: PC CAR\n\n{DBC}")
SIGNALS = _DATABASE.messages[0].signals


def test_each_branch_of_nested_multiplexers_comes_once() -> None:
    branches = list(map(dict, find_branches(SIGNALS)))
    assert len(branches) == 4
    for branch in ({"PAGE": 1}, {"PAGE": 2}, {"PAGE": 3, "SUB": 5}, {"PAGE": 3, "SUB": 6}):
        assert branch in branches


def test_a_message_without_multiplexers_is_one_branch() -> None:
    assert find_branches([signal for signal in SIGNALS if signal.name == "ALWAYS"]) == ({},)

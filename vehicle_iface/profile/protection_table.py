"""The table `[protection]`, which has rules of any name beside `messages`."""


def gather_rules(document: dict[str, object]) -> None:
    """Put the rules of `[protection]` into a table `rules`, in place: the form that `MessageProtection` has."""
    table = document.get("protection")
    if isinstance(table, dict):
        rules = {name: rule for name, rule in table.items() if name != "messages"}
        document["protection"] = {"rules": rules} | {name: table[name] for name in ("messages",) if name in table}


def place_rule_in_file(fault: str) -> str:
    """Return the fault with its place as in the file."""
    return fault.replace("$.protection.rules", "$.protection", 1) if fault.startswith("$.protection.rules") else fault

"""`vehicle-iface new-profile`: drafts a profile from a DBC."""

import argparse
from pathlib import Path

from vehicle_iface.cli.exit_status import DONE
from vehicle_iface.cli.terminal import print_safely
from vehicle_iface.drafting import draft_profile, write_draft
from vehicle_iface.errors import ConfigError


def new_profile(options: argparse.Namespace) -> int:
    """Print the draft, or write it to a new file."""
    out = Path(options.out) if options.out is not None else None
    if out is not None and out.exists() and not options.force:
        raise ConfigError(f"--out {out}: exists already; --force overwrites it")
    draft = draft_profile(Path(options.dbc))
    text = write_draft(draft, out)
    if out is None:
        print_safely(text, end="")
        return DONE
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"--out {out}: cannot be written: {error.strerror}") from None
    print_safely(
        f"{out}: {draft.bound_count} fields bound, {draft.open_count} to choose, numbers to fill in; "
        f"next: complete each TODO, then vehicle-iface check-dbc {out}"
    )
    return DONE

"""Shared by all command lines: errors of one line, defaults in the help, output on any terminal."""

import argparse
import io
import sys
from collections.abc import Iterable
from typing import NoReturn


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the default of each option that has one."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        has_default = action.default or type(action.default) in (int, float)  # 0 is one, False and [] are none
        return super()._get_help_string(action) if has_default else action.help


class ArgumentParser(argparse.ArgumentParser):
    """Reports an error in one line, with the option or word that was probably meant, and exits with status 2."""

    def parse_known_args(self, args=None, namespace=None):  # type: ignore[no-untyped-def]
        """Like the base class, but unknown arguments are reported by the command that they were given to."""
        options, unknown = super().parse_known_args(args, namespace)
        if unknown:
            self.error(f"unknown argument {unknown[0]!r}{self._suggestion(unknown[0], self._option_string_actions)}")
        return options, unknown

    def error(self, message: str) -> NoReturn:
        """Print `message` and where the help is. Exits with status 2."""
        self.exit(2, f"{self.prog}: {message} ({self.prog} --help)\n")

    def _check_value(self, action: argparse.Action, value: object) -> None:
        if action.choices is not None and value not in action.choices:
            choices = [str(choice) for choice in action.choices]
            suggestion = self._suggestion(str(value), choices)
            raise argparse.ArgumentError(action, f"{str(value)!r}: must be one of {', '.join(choices)}{suggestion}")

    @staticmethod
    def _suggestion(given: str, known: Iterable[str]) -> str:
        import difflib  # only where there is an error: it takes a while

        nearest = difflib.get_close_matches(given.partition("=")[0], known, n=1)
        return f"; did you mean {nearest[0]!r}?" if nearest else ""


def make_output_safe() -> None:
    """Replace what standard output and error output cannot encode, instead of failing with `UnicodeEncodeError`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")

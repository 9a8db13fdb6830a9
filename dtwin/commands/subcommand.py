"""What a subcommand of `dtwin` is: where it is read from, and its line of help."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from dtwin.options import parse_options

_ELSEWHERE: Final = ("iec61499.", "evidence.")


@dataclass(frozen=True)
class Subcommand:
    """A subcommand.

    Attributes:
        module: module that holds its options, under dtwin.commands unless its name begins with another package's.
        options: class of the options there.
        summary: line of help.
        read: function that reads the options from the command line.
    """

    module: str
    options: str
    summary: str
    read: Callable[[type[Any], str, Sequence[str]], Any] = parse_options

    @property
    def kind(self) -> type[Any]:
        """The class of the options, whose module is loaded."""
        found: type[Any] = getattr(importlib.import_module(self.path), self.options)
        return found

    @property
    def path(self) -> str:
        """The whole name of the module."""
        return self.module if self.module.startswith(_ELSEWHERE) else f"dtwin.commands.{self.module}"

"""Reads command-line options into a dataclass; what cannot be read is one line that says why."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable, Sequence
from typing import Any

from dtwin.errors import DtwinError, choices


def parse_options(options: Callable[..., Any], prog: str, arguments: Sequence[str]) -> Any:
    """An instance of the dataclass `options` from command-line arguments.

    Raises:
        DtwinError: the arguments cannot be read. SystemExit: help was asked for and printed.
    """
    import tyro

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                options,
                prog=prog,
                args=list(arguments),
                config=(tyro.conf.UseAppendAction, tyro.conf.FlagCreatePairsOff),
            )
    except SystemExit as exit_:
        if exit_.code == 0:
            raise
        raise DtwinError(_one_line(complaint.getvalue(), prog)) from None


def _one_line(box: str, prog: str) -> str:
    """The parser's boxed complaint as one line: what is wrong, the nearest options, where to read more."""
    sections = re.split(r"[─-]{3,}", " ".join(line.strip("│|╭╮╰╯+ ") for line in box.splitlines()[1:]))
    complaint, *rest = [section.strip() for section in sections if section.strip()]
    suggestion = next((section for section in rest if "Perhaps you meant" in section), "")
    nearest = dict.fromkeys(re.findall(r"--[a-z][a-z-]*", suggestion))
    hint = f"; perhaps you meant {choices(nearest)}" if nearest else ""
    return f"{complaint}{hint} (see {prog} --help)"

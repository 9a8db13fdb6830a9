"""The `dtwin` command: finds the subcommand's module, reads its options, prints errors as one line.

Only the chosen subcommand's module is imported, so that `dtwin --help` and short commands start fast.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any, Final

from dtwin import __version__
from dtwin.commands.table import COMMANDS, EVIDENCE, GROUPS
from dtwin.errors import DtwinError, choices
from dtwin.files import NO_SPACE, reason_of
from dtwin.terminal import printable

DESCRIPTION: Final = "A digital twin of a box-sorting arm controlled by IEC 61499 function blocks."


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command line; returns the exit status (0 done, 1 a check failed, 2 bad input, 130 interrupted)."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    _open_standard_streams()
    try:
        status = _dispatch(arguments)
        sys.stdout.flush()
        return status
    except DtwinError as error:
        print(f"dtwin: {printable(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("dtwin: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        _discard_output()  # Its reader has gone.
        return 141
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        _discard_output()
        print(f"dtwin: {error.filename or 'standard output'}: cannot be written: {reason_of(error)}", file=sys.stderr)
        return 2


def _open_standard_streams() -> None:
    """Opens what the caller has closed (`dtwin run >&-`), or the next file would become the standard output."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115 - it stays open, with the lowest free number


def _discard_output() -> None:
    """Keeps the interpreter's own flush at exit from complaining about what could not be written."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _dispatch(arguments: list[str]) -> int:
    if arguments[:1] == ["help"]:
        arguments = [*arguments[1:], "--help"]
    name = arguments[0] if arguments else "--help"
    if name in ("-h", "--help"):
        print(_overview())
        return 0
    if name == "--version":
        print(f"dtwin {__version__}")
        return 0
    words = 2 if " ".join(arguments[:2]) in COMMANDS else 1
    name = " ".join(arguments[:words])
    under = [key for key in COMMANDS if key.startswith(f"{name} ")]
    if under and arguments[1:] in (["-h"], ["--help"]):
        print(_group(name, under))
        if name not in COMMANDS:
            return 0
    elif name not in COMMANDS:
        raise DtwinError(_unknown(arguments, name, under))
    entry = COMMANDS[name]
    command = entry.read(entry.kind, f"dtwin {name}", arguments[words:])
    if not hasattr(command, "runtime"):
        return _executed(command)
    from dtwin.controller.runtime import chosen  # loads the function blocks, which most commands do without

    with chosen(command.runtime):
        return _executed(command)


def _unknown(arguments: Sequence[str], name: str, under: Sequence[str]) -> str:
    """What is said of words that are no command: the commands that begin with them, or the nearest ones."""
    said = " ".join(arguments[:2]) if under else name
    if not under and arguments[0] in EVIDENCE:
        return f"{name} measures what the project claims: only scripts/dtwin in a checkout has that command"
    if under:
        what = f"{name} needs one word more" if said == name else f"unknown command {said!r}"
        return f"{what}: expected {choices(under)}"
    near = get_close_matches(" ".join(arguments[:2]), COMMANDS, n=2, cutoff=0.75)
    near = near or get_close_matches(name, [*COMMANDS, *{command.split()[0] for command in COMMANDS}], n=3)
    hint = f"perhaps you meant {choices(dict.fromkeys(near))}" if near else "dtwin --help lists them all"
    return f"unknown command {said!r}; {hint}"


def _executed(command: Any) -> int:
    status: int = command.execute()
    return status


def _group(name: str, under: Sequence[str]) -> str:
    width = max(map(len, under))
    lines = [f"usage: dtwin {name} COMMAND [OPTIONS]\n"]
    lines += [f"  {command:<{width}}  {COMMANDS[command].summary}" for command in under]
    return "\n".join([*lines, f"\ndtwin {under[0]} --help shows the options of that command.\n"])


def _overview() -> str:
    width = max(len(name) for name in COMMANDS)
    lines = [f"usage: dtwin COMMAND [OPTIONS]\n\n{DESCRIPTION}"]
    for title, group in GROUPS.items():
        lines += [f"\n{title}:", *(f"  {name:<{width}}  {entry.summary}" for name, entry in group.items())]
    lines.append("\ndtwin COMMAND --help shows the options of one command; dtwin --version the version.")
    return "\n".join(lines)

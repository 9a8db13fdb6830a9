"""The `dtwin` command: finds the subcommand's module, reads its options, prints errors as one line.

Only the chosen subcommand's module is imported, so that `dtwin --help` and short commands start fast.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from typing import Any, Final

from dtwin import __version__
from dtwin.commands.table import COMMANDS, EVIDENCE, GROUPS
from dtwin.errors import DtwinError, choices
from dtwin.files import NO_SPACE, reason_of
from dtwin.terminal import printable

INTERRUPTED: Final = 128 + signal.SIGINT
TERMINATED: Final = 128 + signal.SIGTERM
DESCRIPTION: Final = "A digital twin of a box-sorting arm controlled by IEC 61499 function blocks."


class _Terminated(KeyboardInterrupt):
    """A polite kill."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command line; returns the exit status.

    That is 0 when done, 1 when a check failed, 2 for bad input, 130 when interrupted, 143 when asked to end.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    _open_standard_streams()
    try:
        with _ended_cleanly():
            status = _dispatch(arguments)
        sys.stdout.flush()
        return status
    except DtwinError as error:
        print(f"dtwin: {printable(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as error:
        return _interrupted(error)
    except ImportError as error:
        if (interruption := _interruption(error)) is None:
            raise
        return _interrupted(interruption)
    except BrokenPipeError:
        _discard_output()  # Its reader has gone.
        return 141
    except OSError as error:
        if error.errno not in NO_SPACE:
            raise
        _discard_output()
        print(f"dtwin: {error.filename or 'standard output'}: cannot be written: {reason_of(error)}", file=sys.stderr)
        return 2


@contextmanager
def _ended_cleanly() -> Iterator[None]:
    """Lets Ctrl-C and a polite kill end what is inside, with its workers, so that no process is left.

    A second one ends it at once. Whoever has set another handler, such as for services, keeps it.
    """
    usual: dict[int, Any] = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}
    main_thread = threading.current_thread() is threading.main_thread()
    ours = [number for number, handler in usual.items() if main_thread and signal.getsignal(number) == handler]

    def end(number: int, frame: object) -> None:
        signal.signal(number, usual[number])
        if "multiprocessing" in sys.modules:  # Only a terminal tells workers, too.
            for worker in sys.modules["multiprocessing"].active_children():
                worker.terminate()
        raise _Terminated if number == signal.SIGTERM else KeyboardInterrupt

    for number in ours:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, usual[number])


def _interruption(error: BaseException | None) -> KeyboardInterrupt | None:
    """The interruption that led to an error: a C library while it is loaded makes another one of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error


def _interrupted(error: KeyboardInterrupt) -> int:
    terminated = isinstance(error, _Terminated)
    print("dtwin: asked to end" if terminated else "dtwin: interrupted", file=sys.stderr)
    return TERMINATED if terminated else INTERRUPTED


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

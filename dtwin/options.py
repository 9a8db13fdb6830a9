"""Reads command-line options into a dataclass, and writes them; what cannot be read is one line that says why."""

from __future__ import annotations

import contextlib
import io
import os
import re
import warnings
from collections.abc import Callable, Container, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, Final, TypeVar, get_origin, get_type_hints

import msgspec

from dtwin.errors import DtwinError, ParameterError, choices

T = TypeVar("T")


def refuse_others(options: Any, known: Container[str], unsaid: Container[str] = ()) -> None:
    """Refuses options that have no meaning for another arm than the thesis's.

    Args:
        options: an instance of the dataclass of the options.
        known: names of the fields that mean something for any arm.
        unsaid: those of them that the message leaves out.

    Raises:
        ParameterError: an option was given that is not known.
    """
    said = [field.name for field in fields(options) if field.name in known and field.name not in unsaid]
    for field in fields(options):
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in known and getattr(options, field.name) != default:
            expected = choices(f"--{name.replace('_', '-')}" for name in said)
            name = field.name.replace("_", "-")
            raise ParameterError(f"--{name}: has no meaning for another arm than the thesis's: expected {expected}")


def parse_options(options: Callable[..., Any], prog: str, arguments: Sequence[str]) -> Any:
    """An instance of the dataclass `options` from command-line arguments.

    Raises:
        DtwinError: the arguments cannot be read. SystemExit: help was asked for and printed.
    """
    import tyro

    from dtwin.optional import registry  # needs the parser

    complaint = io.StringIO()
    try:
        with contextlib.redirect_stderr(complaint):
            return tyro.cli(
                options,
                prog=prog,
                args=list(arguments),
                config=_config(),
                registry=registry,
            )
    except SystemExit as exit_:
        if exit_.code == 0:
            raise
        raise DtwinError(_one_line(complaint.getvalue(), prog)) from None


def parser_of(options: Callable[..., Any], prog: str) -> Any:
    """The parser that `parse_options` reads arguments with, an `argparse.ArgumentParser`, for texts about it."""
    import tyro

    from dtwin.optional import registry

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # said of the only way to it
        return tyro.extras.get_parser(options, prog=prog, config=_config(), registry=registry)


def _config() -> tuple[Any, ...]:
    """How the parser reads options."""
    import tyro

    return (tyro.conf.UseAppendAction, tyro.conf.FlagCreatePairsOff)


def parse_apart(options: type[T], prog: str, arguments: Sequence[str]) -> T:
    """The same as `parse_options` for a process that stays, and that shall start fast.

    What is plain is read at once. For the rest, and to say what is wrong, the parser is loaded in a child, with which
    its memory is gone.

    Raises:
        DtwinError: the arguments cannot be read. SystemExit: help was asked for and printed.
    """
    if {"-h", "--help"} & set(arguments):
        return parse_options(options, prog, arguments)
    with contextlib.suppress(msgspec.ValidationError, DtwinError):
        if (values := _plain_values(options, arguments)) is not None:
            return msgspec.convert(values, options, strict=False, dec_hook=_made)
    receiver, sender = os.pipe()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            with open(sender, "wb") as pipe:
                pipe.write(_outcome(options, prog, arguments))
            status = 0
        finally:
            os._exit(status)
    os.close(sender)
    with open(receiver, "rb") as pipe:
        sent = pipe.read()
    _, status = os.waitpid(child, 0)
    if status:
        raise DtwinError(f"{prog}: the options cannot be read")
    outcome = msgspec.json.decode(sent)
    if isinstance(outcome, str):
        raise DtwinError(outcome)
    return msgspec.convert(outcome, options, dec_hook=_made)


def _made(kind: Callable[[Any], Any], value: Any) -> Any:
    """A value of a type that JSON does not have, such as a path."""
    return kind(value)


def _plain_values(options: type[Any], arguments: Sequence[str]) -> dict[str, Any] | None:
    """Texts and flags by the names of the fields, one word each; None when the arguments are anything else."""
    kinds = get_type_hints(options)
    values: dict[str, Any] = {}
    words = iter(arguments)
    for word in words:
        name, _, inner = word.removeprefix("--").replace("-", "_").partition(".")
        kind = kinds.get(name)
        if kind is None or not word.startswith("--"):
            return None
        value = True if kind is bool else next(words, "--")
        if isinstance(value, str) and value.startswith("--"):
            return None
        if inner:
            values.setdefault(name, {})[inner] = value
        elif get_origin(kind) is tuple:
            values.setdefault(name, []).append(value)
        elif name in values:
            return None
        else:
            values[name] = value
    return values


def _outcome(options: type[T], prog: str, arguments: Sequence[str]) -> bytes:
    """The options as a JSON object, or what is wrong with the arguments as a text."""
    try:
        outcome: T | str = parse_options(options, prog, arguments)
    except DtwinError as error:
        outcome = str(error)
    return msgspec.json.encode(outcome, enc_hook=str)


def arguments(options: Any, declared: type) -> list[str]:
    """Command-line arguments for the options that the dataclass `declared`, a base of theirs, declares.

    `parse_options` reads the same values from them, in any folder: paths are made absolute. What has its default is
    left out.
    """
    words = []
    for field in fields(declared):
        value = getattr(options, field.name)
        if value == field.default:
            continue
        flag = f"--{field.name.replace('_', '-')}"
        if isinstance(value, bool):
            words += [flag]
        elif isinstance(value, tuple) and not any(isinstance(item, str) for item in value):
            words += [flag, *map(str, value)]
        else:
            for item in value if isinstance(value, tuple) else (value,):
                words += [flag, str(item.resolve() if isinstance(item, Path) else item)]
    return words


def _choice(found: re.Match[str]) -> str:
    """What is said of a word that is none of some choices, which the parser names in any order."""
    words = sorted(re.findall(r"'(.*?)'", found[3]))
    return f"{found[2]}: expected {choices(words)}, got {found[1]}"


_WORDS: Final[Sequence[tuple[str, str | Callable[[re.Match[str]], str]]]] = (
    (r"\[/?bold\]", ""),
    (r"^Error parsing (\S+): ", r"\1: "),
    (r"could not convert string to float: ('.*')", r"expected a number, got \1"),
    (r"invalid literal for int\(\) with base 10: ('.*')", r"expected a whole number, got \1"),
    (
        r"invalid choice ('.*?') for argument '(\S+)'\. Expected one of \((.*)\)\.",
        _choice,
    ),
    (r"Missing value for argument '(\S+)'\. Expected 1 values\.", r"\1: expected a value"),
    (r"Missing value for argument '(\S+)'\. Expected (\d+) values\.", r"\1: expected \2 values"),
    (r"^Missing from \S.*?: (--\S+|[A-Z]+)( [A-Z]+)? (.*?) ?\(required\)$", r"expected \1: \3"),
    (r"Could not parse arguments \[(.*)\] into tuple type .*", r"expected numbers, got \1"),
    (r"^expected (STR|PATH|INT|FLOAT): ", "expected one word more: "),
    (r"^(STR|PATH|INT|FLOAT): ", ""),
    (
        r"^Unrecognized options: (--arm\b.*)$",
        r"\1: this knows the arm of the thesis alone: expected `dtwin run`, `up`, `arm`, `film`, `fb make`, `fmu`, "
        "`identify`, `commission`, `monitor`, `simulate`, `margins`, `optimise`, or an experiment with arms",
    ),
    (r"^Unrecognized options: ", "unknown option or too many words: "),
)
"""What the parser says, and how it is said here."""


def _one_line(box: str, prog: str) -> str:
    """The parser's boxed complaint as one line: what is wrong, the nearest options, where to read more."""
    sections = re.split(r"[─-]{3,}", " ".join(line.strip("│|╭╮╰╯+ ") for line in box.splitlines()[1:]))
    complaint, *rest = [section.strip() for section in sections if section.strip()]
    for said, ours in _WORDS:
        complaint = re.sub(said, ours, complaint)
    suggestion = next((section for section in rest if "Perhaps you meant" in section), "")
    nearest = dict.fromkeys(re.findall(r"--[a-z][a-z-]*", suggestion))
    hint = f"; perhaps you meant {choices(nearest)}" if nearest else ""
    return f"{complaint}{hint} (see {prog} --help)"

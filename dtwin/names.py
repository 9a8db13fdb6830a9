"""What cells, arms, models and people may be called: names become keys of the bus, files and folders."""

from __future__ import annotations

import re
from typing import Annotated, Final

import msgspec

from dtwin.errors import DtwinError, ParameterError

PATTERN: Final = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,31}\Z"
"""No part of a key expression or of a path has a meaning of its own among these names."""
Name = Annotated[str, msgspec.Meta(pattern=PATTERN)]
"""A name in a message or a file."""
_SHOWN: Final = 40
"""Number of characters of a wrong name that are shown."""


def counted(number: int, one: str, many: str = "") -> str:
    """A number with what it counts, such as 1 joint or 2 joints; `many` is `one` with an s if it is not given."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def check_name(name: str, what: str, failure: type[DtwinError] = ParameterError) -> str:
    """A name, if it is one.

    Args:
        name: the name.
        what: what it is the name of, for the message.
        failure: type of the error.

    Raises:
        DtwinError: it cannot be a name; of type `failure`.
    """
    if re.match(PATTERN, name):
        return name
    shown = name if len(name) <= _SHOWN else f"{name[:_SHOWN]}..."
    raise failure(
        f"{what} {shown!r}: expected letters, digits, '_', '-' and '.', first a letter or digit, 1 to 32 in all"
    )

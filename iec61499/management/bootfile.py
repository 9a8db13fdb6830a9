"""Boot files (.fboot): the management requests that build an application, `resource;<Request .../>` each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from iec61499.errors import FunctionBlockError
from iec61499.files.xml import MAXIMUM_SIZE
from iec61499.management.protocol import ManagementError, Request, parse_request

_ENDS: Final = ("</Request>", "/>")


@dataclass(frozen=True, slots=True)
class Command:
    """A request, the resource that gets it ("": the device), and the line it begins on (0: it comes from no file)."""

    resource: str
    request: Request
    line: int = 0


def parse_boot_file(text: str, file: str = "") -> list[Command]:
    """Reads the commands; one that holds a block type's text may take several lines.

    Raises:
        FunctionBlockError: a line is no command; names file and line.
    """
    commands = []
    for line, entry in _entries(text):
        resource, semicolon, xml = entry.partition(";")
        if not semicolon or "<" in resource:
            raise FunctionBlockError(
                "expected RESOURCE;<Request ...>, with nothing before ; for the device", file, line
            )
        try:
            commands.append(Command(resource.strip(), parse_request(xml.strip()), line))
        except ManagementError as error:
            raise FunctionBlockError(str(error), file, line) from None
    return commands


def load_boot_file(path: Path) -> list[Command]:
    """Reads the commands of a file.

    Raises:
        FunctionBlockError: the file cannot be read, or a line is no command; names file and line.
    """
    try:
        with path.open("rb") as stream:
            data = stream.read(MAXIMUM_SIZE + 1)
        if len(data) > MAXIMUM_SIZE:
            raise FunctionBlockError(f"is larger than {MAXIMUM_SIZE} bytes", str(path))
        return parse_boot_file(data.decode(), str(path))
    except OSError as error:
        raise FunctionBlockError(f"cannot be read: {error.strerror}", str(path)) from None
    except UnicodeDecodeError as error:
        raise FunctionBlockError(f"is not UTF-8 at byte {error.start}", str(path)) from None


def print_boot_file(commands: Iterable[Command]) -> str:
    """The text that `parse_boot_file` reads."""
    return "".join(f"{command.resource};{command.request.xml()}\n" for command in commands)


def _entries(text: str) -> Iterator[tuple[int, str]]:
    """The first line and the text of every command: it ends with a line that ends a request, as FORTE reads it."""
    lines: list[str] = []
    first = 0
    for number, line in enumerate(text.split("\n"), 1):
        if not lines:
            if not line.strip():
                continue
            first = number
        lines.append(line)
        if line.rstrip().endswith(_ENDS):
            yield first, "\n".join(lines)
            lines.clear()
    if lines:
        yield first, "\n".join(lines)

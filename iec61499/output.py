"""What goes out to people: text of others in one line, and files that appear complete or not at all."""

from __future__ import annotations

import contextlib
import json
import os
from pathlib import Path

from iec61499.errors import ToolError


def printable(text: str) -> str:
    """A text in one line, with every character that cannot be seen in its place written as JSON escapes it.

    A JSON text in one line stays the same JSON. What counts as visible is `str.isprintable`: letters, marks, digits,
    punctuation, symbols and the space, but no control or format characters, separators or lone surrogates.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text)


def write_whole(file: Path, data: bytes) -> None:
    """Writes a file anew; when that fails it is as it was before. Raises ToolError."""
    target = file.resolve()
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        temporary.write_bytes(data)
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
        os.replace(temporary, target)
    except OSError as error:
        raise ToolError(f"{file}: cannot be written: {error.strerror}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()

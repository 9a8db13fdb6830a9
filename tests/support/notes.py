"""A file of lines for tests, which loads nothing else."""

from pathlib import Path
from typing import Any

import msgspec

from dtwin.line_file import LineFile


class Note(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """An entry of the tests."""

    number: int
    text: str = ""


def notes(path: Path, **options: Any) -> LineFile[Note]:
    return LineFile(path, Note, "a note", **options)

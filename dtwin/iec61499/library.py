"""Finds block types by name: in folders of .fbt and .sub files, then among the standard blocks."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

from dtwin.errors import FunctionBlockError, choices
from dtwin.iec61499 import model
from dtwin.iec61499.files.block_types import read_type
from dtwin.iec61499.files.systems import read_system
from dtwin.iec61499.standard.catalogue import find_standard, standard_names


class Library:
    """Block types of some folders (searched with their subfolders) and the standard blocks.

    Files are named after the type they hold, as 4diac IDE does. A folder's type hides a standard block of the same
    name; a type without a body (an interface known to editors) does not.

    Raises:
        FunctionBlockError: a path is no folder, or two files hold a type of one name.
    """

    def __init__(self, paths: Sequence[Path] = ()) -> None:
        self._paths = tuple(paths)
        self._files: dict[str, Path] = {}
        self._types: dict[str, model.LibraryElement] = {}
        for folder in self._paths:
            if not folder.is_dir():
                raise FunctionBlockError("is not a folder of block types", str(folder))
            for file in sorted(file for file in folder.rglob("*") if file.suffix in (".fbt", ".sub")):
                other = self._files.setdefault(file.stem, file)
                if other != file:
                    raise FunctionBlockError(f"type {file.stem} is also in {other}: expected one file", str(file))

    def names(self) -> tuple[str, ...]:
        """The names of the types in the folders."""
        return tuple(sorted(self._files))

    def files(self, suffix: str) -> tuple[str, ...]:
        """The names of the files in the folders that end in a suffix, such as `.adp` for adapter types."""
        return tuple(sorted({file.stem for folder in self._paths for file in folder.rglob(f"*{suffix}")}))

    def find(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        """The type called name; a package in front (`events::E_SWITCH`) is ignored.

        Args:
            name: the type's name.
            file: the file that uses it, for errors.
            line: the line that uses it, for errors.

        Raises:
            FunctionBlockError: there is no such type, or its file is wrong.
        """
        name = name.rpartition("::")[2]
        if name not in self._types:
            self._types[name] = self._load(name, file, line)
        return self._types[name]

    def add(self, block: model.LibraryElement) -> None:
        """Makes a block type known that no file holds; it hides others of its name."""
        self._types[block.header.name] = block

    def _load(self, name: str, file: str, line: int) -> model.LibraryElement:
        standard = find_standard(name)
        path = self._files.get(name)
        if path is not None:
            found = read_type(path)
            if found.header.name != name:
                raise FunctionBlockError(
                    f"holds the type {found.header.name}: expected {name}, as the file's name says",
                    found.header.file,
                    found.header.line,
                )
            if standard is None or not isinstance(found, model.ServiceInterfaceFBType):
                return found
        if standard is None:
            raise FunctionBlockError(f"unknown block type {name}: {self._hint(name)}", file, line)
        return standard

    def _hint(self, name: str) -> str:
        known = sorted({*self._files, *standard_names()})
        close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
        expected = f"expected {choices(close)}" if close else f"expected one of {choices(known[:20])}, ..."
        folders = choices([str(path) for path in self._paths]) if self._paths else "no folder"
        return f"{expected}; searched {folders} and the standard blocks"

    def load_system(self, path: Path) -> model.System:
        """Reads a system configuration (.sys).

        Raises:
            FunctionBlockError: the file is unreadable or wrong; names file and line.
        """
        return read_system(path)

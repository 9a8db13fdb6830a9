"""Finds types and constants by name: in folders of files, then among the standard blocks."""

from __future__ import annotations

import difflib
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal

from iec61499 import model
from iec61499.distribution import distributed
from iec61499.errors import FunctionBlockError, choices
from iec61499.files.block_types import ForeignLanguageError, read_adapter, read_type
from iec61499.files.data_types import package_of, read_constants, read_data_type
from iec61499.files.project import linked_folders
from iec61499.files.systems import read_system
from iec61499.mapping import left_out
from iec61499.opening import opened
from iec61499.standard.catalogue import find_adapter, find_standard, find_structure, standard_names
from iec61499.standard.utilities import STRUCTURE, structure_block
from iec61499.types import ELEMENTARY, DataType, StructType, elementary

Kind = Literal["block", "adapter", "data type", "constants"]
KINDS: Final[dict[str, Kind]] = {
    ".fbt": "block",
    ".sub": "block",
    ".fct": "block",
    ".adp": "adapter",
    ".dtp": "data type",
    ".gcf": "constants",
}
"""What a file holds, by its suffix, which may be written in any case."""


class Library:
    """Block types of some folders (searched with their subfolders) and the standard blocks.

    Files are named after the type they hold, as 4diac IDE does. A folder that is a project of 4diac IDE is followed
    by those that it links to. Of two types of one name that of the earlier folder counts. A folder's type hides a
    standard block of the same name; a type without a body (an interface known to editors), or with one in another
    language than Structured Text, does not. Types may be found by several threads.

    Raises:
        FunctionBlockError: a path is no folder, or the links of a project cannot be read.
    """

    def __init__(self, paths: Sequence[Path] = ()) -> None:
        for folder in paths:
            if not folder.is_dir():
                raise FunctionBlockError("is not a folder of block types", str(folder))
        self._paths = tuple(dict.fromkeys(one for path in paths for one in (path, *linked_folders(path))))
        self._files: dict[Kind, dict[str, tuple[Path, ...]]] = {kind: {} for kind in KINDS.values()}
        self._types: dict[str, model.LibraryElement] = {}
        self._adapters: dict[str, model.AdapterType] = {}
        self._data_types: dict[str, DataType] = {}
        self._constants: dict[str, dict[str, model.Variable]] = {}
        self._packages: dict[str, list[str]] | None = None
        self._reading: list[str] = []
        self._lock = threading.RLock()
        for folder in self._paths:
            here: dict[tuple[Kind, str], list[Path]] = {}
            for file in sorted(folder.rglob("*")):
                kind = KINDS.get(file.suffix.lower())
                if kind is not None:
                    here.setdefault((kind, file.stem), []).append(file)
            for (kind, name), files in here.items():
                self._files[kind].setdefault(name, tuple(files))

    def stamp(self) -> tuple[tuple[str, int, int], ...]:
        """Name, time of change (ns) and size of every file in the folders; as long as it is the same, so are they."""
        found = []
        for file in (file for folder in self._paths for file in sorted(folder.rglob("*"))):
            with suppress(OSError):  # gone meanwhile, or a link to nowhere
                status = file.stat()
                found.append((str(file), status.st_mtime_ns, status.st_size))
        return tuple(found)

    def names(self) -> tuple[str, ...]:
        """The names of the types in the folders."""
        return tuple(sorted(self._files["block"]))

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
            with self._lock:
                if name not in self._types:
                    self._types[name] = self._load(name, file, line)
        return self._types[name]

    def fresh(self, name: str) -> model.LibraryElement:
        """The type called name as its file is now; what uses the type that was read before goes on with that.

        Raises:
            FunctionBlockError: as `find`.
        """
        with self._lock:
            return self._load(name.rpartition("::")[2], "", 0)

    def offers(self, name: str) -> bool:
        """Whether there is a type of that name, which may be wrong."""
        plain = name.rpartition("::")[2]
        return plain in self._types or plain in self._files["block"] or find_standard(plain) is not None

    def add(self, block: model.LibraryElement) -> None:
        """Makes a block type known that no file holds; it hides others of its name."""
        self._types[block.header.name] = block

    def _file(self, kind: Kind, name: str) -> Path | None:
        """The file of a type, of several that say the same the first; None when there is none.

        Raises:
            FunctionBlockError: two files say something else.
        """
        first, *others = self._files[kind].get(name, (None,))
        for other in others:
            if first is not None and other.read_bytes() != first.read_bytes():
                raise FunctionBlockError(f"type {name} is something else in {first}: expected one file", str(other))
        return first

    def _load(self, name: str, file: str, line: int) -> model.LibraryElement:
        structure = STRUCTURE.fullmatch(name)
        if structure is not None and structure[2] in self._files["data type"]:
            found_type = self.data_type(structure[2])
            if isinstance(found_type, StructType):
                return structure_block(name, found_type)
        standard = find_standard(name)
        path = self._file("block", name)
        if structure is not None and path is None and standard is None:
            raise FunctionBlockError(
                f"unknown structure {structure[2]} of {name}: expected a file {structure[2]}.dtp; {self._searched()}",
                file,
                line,
            )
        found = self._read(path, standard is not None) if path is not None else None
        if found is not None:
            if found.header.name != name:
                raise FunctionBlockError(
                    f"holds the type {found.header.name}: expected {name}, as the file's name says",
                    found.header.file,
                    found.header.line,
                )
            if standard is None or not isinstance(found, model.ServiceInterfaceFBType):
                return found
            if isinstance(standard, model.ServiceInterfaceFBType) and _same_ports(found, standard):
                # types of ports differ between versions of 4diac, such as ID, which was a WSTRING
                return found
        if standard is None:
            raise FunctionBlockError(f"unknown block type {name}: {self._hint(name)}", file, line)
        return standard

    def _read(self, path: Path, is_standard: bool) -> model.LibraryElement | None:
        """The type in a file; None for a standard block whose file has algorithms in another language."""
        try:
            return read_type(path, self)
        except ForeignLanguageError:
            if is_standard:
                return None
            raise

    def data_type(self, name: str) -> DataType:
        """The elementary type, structure or enumeration of that name. Raises FunctionBlockError for another one."""
        plain = name.rpartition("::")[2]
        path = self._file("data type", plain)
        if path is None or plain.upper() in ELEMENTARY:
            return find_structure(plain) or elementary(plain)
        if plain not in self._data_types:
            with self._no_circle(plain):
                self._data_types[plain] = read_data_type(path, self)
        return self._data_types[plain]

    def adapter(self, name: str, file: str = "", line: int = 0) -> model.AdapterType:
        """The adapter type of that name; file and line use it. Raises FunctionBlockError when there is none."""
        plain = name.rpartition("::")[2]
        path = self._file("adapter", plain)
        if path is None:
            found = find_adapter(plain)
            if found is None:
                expected = choices(self._files["adapter"]) if self._files["adapter"] else f"a file {plain}.adp"
                raise FunctionBlockError(f"unknown adapter type {plain}: expected {expected}", file, line)
            return found
        if plain not in self._adapters:
            with self._no_circle(plain):
                self._adapters[plain] = read_adapter(path, self)
        return self._adapters[plain]

    def constant(self, name: str) -> model.Variable | None:
        """The constant `NAMESPACE::NAME` of a file NAMESPACE.gcf; None when there is none."""
        before, _, plain = name.rpartition("::")
        namespace = before.rpartition("::")[2]
        path = self._file("constants", namespace)
        if path is not None and namespace not in self._constants:
            with self._no_circle(namespace):
                self._constants[namespace] = {found.name.upper(): found for found in read_constants(path, self)}
        return self._constants.get(namespace, {}).get(plain.upper())

    def package_constant(self, package: str, name: str) -> model.Variable | None:
        """The constant NAME of the files of a package, "" for those of none; None when there is none."""
        if self._packages is None:
            self._packages = self._constants_by_package()
        for namespace in self._packages.get(package, ()):
            with suppress(FunctionBlockError):
                found = self.constant(f"{namespace}::{name}")
                if found is not None:
                    return found
        return None

    def absence(self, name: str) -> str:
        """Why there is no constant of that name, or no function that Structured Text may call.

        It is "" for a name without a namespace that no file here declares.
        """
        before, _, plain = name.rpartition("::")
        namespace = before.rpartition("::")[2]
        function = next(iter(self._files["block"].get(plain, ())), None)
        if function is not None and function.suffix.lower() == ".fct":
            return f"calls of function types are not supported in Structured Text: {function}"
        if namespace in self._files["constants"]:
            return f"{self._files['constants'][namespace][0]} declares no {plain}"
        if namespace:
            folders = choices([str(path) for path in self._paths]) if self._paths else "no folder"
            return f"there is no file {namespace}.gcf: searched {folders}"
        for other, paths in self._files["constants"].items():
            with suppress(FunctionBlockError):
                if self.constant(f"{other}::{name}") is not None:
                    return f"{paths[0]} declares it, which is not imported: expected {other}::{name} or an import"
        return ""

    def _constants_by_package(self) -> dict[str, list[str]]:
        packages: dict[str, list[str]] = {}
        for namespace, paths in self._files["constants"].items():
            # what is wrong with a file is told where one of its constants is named in full
            with suppress(FunctionBlockError):
                packages.setdefault(package_of(paths[0]), []).append(namespace)
        return packages

    def block(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        """The type of a block inside another one, as `find`; it must not contain that one."""
        with self._no_circle(name.rpartition("::")[2]):
            return self.find(name, file, line)

    @contextmanager
    def _no_circle(self, name: str) -> Iterator[None]:
        if name in self._reading:
            raise FunctionBlockError(f"{name} contains itself: {' -> '.join((*self._reading, name))}")
        self._reading.append(name)
        try:
            yield
        finally:
            self._reading.pop()

    def _hint(self, name: str) -> str:
        known = sorted({*self._files["block"], *standard_names()})
        close = difflib.get_close_matches(name, known, n=3, cutoff=0.6)
        expected = f"expected {choices(close)}" if close else f"expected one of {choices(known[:20])}, ..."
        return f"{expected}; {self._searched()} and the standard blocks"

    def _searched(self) -> str:
        return f"searched {choices([str(path) for path in self._paths]) if self._paths else 'no folder'}"

    def load_system(self, path: Path, acknowledged: bool = False) -> model.System:
        """Reads a system configuration (.sys); connections between resources get communication blocks.

        What was done to it, its attributes `inserted` and `left_out` say.

        Args:
            path: the file.
            acknowledged: whether events between resources wait until those before them are acknowledged.

        Raises:
            FunctionBlockError: the file is unreadable or wrong; names file and line.
        """
        return self.complete(read_system(path, self), acknowledged)

    def complete(self, system: model.System, acknowledged: bool = False) -> model.System:
        """A system as its file says, made to run as `load_system` does."""
        system = opened(system)
        return replace(distributed(system, self.find, self.add if acknowledged else None), left_out=left_out(system))


def _same_ports(first: model.FBType, second: model.FBType) -> bool:
    return sorted(first.interface.names()) == sorted(second.interface.names())

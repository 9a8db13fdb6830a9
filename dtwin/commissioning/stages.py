"""Stages of a long procedure, each kept in a file as soon as it is done, so that an interrupted one can go on.

A file tells in its first line what came before its stage: a SHA-256 of the inputs of the procedure and of the results
of all earlier stages. A stage is done anew when that has changed, or when its file is missing or cannot be read.
"""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec

from dtwin.errors import RecordingError
from dtwin.files import reason_of, replacing

T = TypeVar("T")


class Stages:
    """The stages of one procedure.

    Args:
        folder: where the results are kept; None keeps nothing.
        inputs: description of all that the results depend on.
        tell: is told in words which stage is done.

    Raises:
        RecordingError: the folder cannot be made.
    """

    def __init__(self, folder: Path | None, inputs: str, tell: Callable[[str], None]) -> None:
        self._folder = folder
        self._before = hashlib.sha256(inputs.encode()).hexdigest()
        self._tell = tell
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise RecordingError(f"{folder}: cannot be made: {reason_of(error)}") from None

    def result(self, name: str, kind: type[T], make: Callable[[], T]) -> T:
        """The result of a stage: what an interrupted procedure has kept, or what is made now.

        Args:
            name: name of the stage and of its file.
            kind: type of the result, which JSON can hold.
            make: function that makes it.

        Raises:
            RecordingError: the result cannot be kept.
        """
        kept = self._kept(name, kind)
        if kept is None:
            data = msgspec.json.encode(make())
            if self._folder is not None:
                with replacing(self._folder / f"{name}.json") as temporary:
                    temporary.write_bytes(self._before.encode() + b"\n" + data)
            found = msgspec.json.decode(data, type=kind)
        else:
            found, data = kept
        self._done(name, hashlib.sha256(data).hexdigest(), kept is not None)
        return found

    def file(self, name: str, make: Callable[[Path], None]) -> Path:
        """The file of a stage, which is there whole or not at all.

        Args:
            name: name of the stage's file, with its suffix.
            make: function that writes the file to a path.

        Raises:
            RecordingError: the results are kept nowhere, or the file cannot be written.
        """
        if self._folder is None:
            raise RecordingError(f"{name}: expected a folder to keep it in")
        path, mark = self._folder / name, self._folder / f"{name}.after"
        kept = path.is_file() and mark.is_file() and mark.read_text() == self._before
        if not kept:
            with replacing(mark) as temporary:
                temporary.write_text(self._before)
            path.unlink(missing_ok=True)
            make(path)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        self._done(path.stem, digest, kept)
        return path

    def finish(self, data: Path | None = None) -> None:
        """Ends the procedure, of which nothing is kept but its files, if it has any.

        Args:
            data: folder in which the files are from now on; what is in it is replaced.

        Raises:
            RecordingError: the folder cannot be made.
        """
        if self._folder is None:
            return
        if data is None:
            shutil.rmtree(self._folder, ignore_errors=True)
            return
        try:
            shutil.rmtree(data, ignore_errors=True)
            self._folder.rename(data)
        except OSError as error:
            raise RecordingError(f"{data}: cannot be made: {reason_of(error)}") from None
        for path in (*data.glob("*.json"), *data.glob("*.after")):
            path.unlink()

    def _kept(self, name: str, kind: type[T]) -> tuple[T, bytes] | None:
        if self._folder is None:
            return None
        try:
            before, _, data = (self._folder / f"{name}.json").read_bytes().partition(b"\n")
            return (msgspec.json.decode(data, type=kind), data) if before.decode() == self._before else None
        except (OSError, UnicodeDecodeError, msgspec.MsgspecError):
            return None

    def _done(self, name: str, digest: str, kept: bool) -> None:
        self._before = hashlib.sha256((self._before + digest).encode()).hexdigest()
        self._tell(f"{name}: {'was done before' if kept else 'done'}")

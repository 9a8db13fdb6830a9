"""A folder of identified models by name; every save makes a new revision: NAME/0001.json, NAME/0002.json, ..."""

from __future__ import annotations

import contextlib
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.errors import ModelError, choices
from dtwin.identification.model import IdentifiedModel, encode, read_model
from dtwin.names import PATTERN, check_name

STORE: Final = Path("identified")
"""Default folder of the models, in the working directory."""


@dataclass(frozen=True, slots=True)
class StoredModel:
    """A stored model: its name, its revision (from 1 on) and its file."""

    name: str
    revision: int
    path: Path

    def __str__(self) -> str:
        return f"{self.name}@{self.revision}"


class ModelStore:
    """Stores models under names with all their revisions; a stored model never changes.

    Args:
        folder: folder of the models, which is made when the first model is saved.
    """

    def __init__(self, folder: Path = STORE) -> None:
        self.folder = folder

    def save(self, model: IdentifiedModel, name: str) -> StoredModel:
        """Stores a model as the next revision of a name; concurrent calls get different revisions.

        Raises:
            ModelError: the name cannot be the name of a file, or the folder cannot be written.
        """
        check_name(name, "model name", ModelError)
        folder = self.folder / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile(dir=folder, prefix=".", suffix=".part") as temporary:
                temporary.write(encode(model))
                temporary.flush()
                os.chmod(temporary.name, 0o644)
                while True:
                    history = self.history(name)
                    entry = self._entry(name, history[-1].revision + 1 if history else 1)
                    with contextlib.suppress(FileExistsError):
                        os.link(temporary.name, entry.path)
                        return entry
        except OSError as error:
            raise ModelError(f"{folder}: cannot be written: {error.strerror}") from None

    def names(self) -> list[str]:
        """Names of all stored models in alphabetical order."""
        if not self.folder.is_dir():
            return []
        return sorted(path.name for path in self.folder.iterdir() if self.history(path.name))

    def history(self, name: str) -> list[StoredModel]:
        """All revisions of a name, oldest first; empty for an unknown name."""
        files = (self.folder / name).glob("[0-9]*.json")
        return sorted(
            (StoredModel(name, int(f.stem), f) for f in files if f.stem.isdigit()), key=lambda e: e.revision
        )

    def find(self, reference: str) -> StoredModel:
        """Finds the model NAME (its newest revision) or NAME@REVISION.

        Raises:
            ModelError: there is no such model; the message lists those there are.
        """
        name, at, revision = reference.partition("@")
        history = self.history(name) if re.match(PATTERN, name) else []
        if not history:
            names = self.names()
            known = f"expected {choices(names)}" if names else "it is empty; dtwin identify --save NAME stores one"
            raise ModelError(f"no model {name!r} in {self.folder}: {known}")
        if not at:
            return history[-1]
        for entry in history:
            if revision == str(entry.revision):
                return entry
        known = choices(str(entry.revision) for entry in history)
        raise ModelError(f"no revision {revision!r} of model {name}: expected {known}")

    def load(self, reference: str) -> IdentifiedModel:
        """Reads the model NAME (its newest revision) or NAME@REVISION.

        Raises:
            ModelError: there is no such model, or its file is damaged.
        """
        return read_model(self.find(reference).path)

    def _entry(self, name: str, revision: int) -> StoredModel:
        return StoredModel(name, revision, self.folder / name / f"{revision:04d}.json")


def open_model(reference: str, store: ModelStore) -> IdentifiedModel:
    """Reads a model by the path of its file, which ends in .json, or by NAME or NAME@REVISION in a store.

    Raises:
        ModelError: there is no such model, or its file is damaged.
    """
    return read_model(model_path(reference, store))


def model_path(reference: str, store: ModelStore) -> Path:
    """The file of a model that a path ending in .json, or NAME or NAME@REVISION in a store, stands for.

    Raises:
        ModelError: there is no such name in the store.
    """
    return Path(reference) if reference.endswith(".json") else store.find(reference).path

"""The identified models that a cell keeps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec

from dtwin.api.arguments import AnyPath, checked
from dtwin.errors import ParameterError
from dtwin.files import replacing
from dtwin.identification.mjcf import export_mjcf
from dtwin.identification.model import IdentifiedModel, read_model
from dtwin.identification.store import STORE, ModelStore, StoredModel, open_model
from dtwin.parameters import PARAMETER_NAMES
from dtwin.services.runfile import kept


@dataclass(frozen=True, slots=True)
class KeptModel:
    """A revision of an identified model in a store.

    Attributes:
        entry: its name, revision and file.
        model: the model.
    """

    entry: StoredModel
    model: IdentifiedModel


@dataclass(frozen=True, slots=True)
class Difference:
    """A parameter in which two identified models differ, SI units.

    Attributes:
        first: its value in the first one.
        second: its value in the second one.
        standard_errors_apart: the difference over its standard error; None where one model does not know that.
    """

    first: float
    second: float
    standard_errors_apart: float | None


def model_store(store: AnyPath | None = None, cell: str = "cell") -> ModelStore:
    """The store of identified models in a folder; None for that of a cell that is up, else `identified`."""
    return ModelStore(Path(store or kept(cell, "store", STORE)))


@checked
def models(*, store: AnyPath | None = None, cell: str = "cell") -> list[KeptModel]:
    """The identified models of a store, all revisions, as `dtwin model list` shows them.

    Args:
        store: folder of the models; None for that of the cell if it is up on this machine, else `identified`.
        cell: name of the cell.

    Raises:
        ModelError: a model cannot be read.
    """
    found = model_store(store, cell)
    return [KeptModel(entry, read_model(entry.path)) for name in found.names() for entry in found.history(name)]


@checked
def model(model: str, *, store: AnyPath | None = None, cell: str = "cell") -> IdentifiedModel:
    """An identified model, as `dtwin model show` shows it.

    Args:
        model: NAME, NAME@REVISION or a file that ends in .json.
        store: folder of the models, as of `models`.
        cell: name of the cell.

    Raises:
        ModelError: there is no such model, or it cannot be read.
    """
    return open_model(model, model_store(store, cell))


@checked
def compare_models(
    first: str, second: str, *, store: AnyPath | None = None, cell: str = "cell"
) -> dict[str, Difference]:
    """The parameters in which two identified models differ, by name, as `dtwin model diff` shows them.

    Args:
        first: a model, as of `model`.
        second: the model to compare it with, named in the same way.
        store: folder of the models, as of `models`.
        cell: name of the cell.

    Raises:
        ModelError: there is no such model, or it cannot be read.
    """
    one, other = (model(name, store=store, cell=cell) for name in (first, second))
    return {
        name: Difference(one.parameters[name], other.parameters[name], _apart(one, other, name))
        for name in PARAMETER_NAMES
        if one.parameters[name] != other.parameters[name]
    }


@checked
def export_model(
    model: str,
    file: AnyPath,
    *,
    store: AnyPath | None = None,
    cell: str = "cell",
    format: Literal["mjcf", "parameters"] | None = None,
) -> IdentifiedModel:
    """Writes an identified model as an MJCF of the cell or as plain parameters, as `dtwin model export` does.

    Args:
        model: NAME, NAME@REVISION or a file that ends in .json.
        file: file to write: .xml for an MJCF, .json for parameters by name.
        store: folder of the models, as of `models`.
        cell: name of the cell.
        format: what to write, if the file's ending does not say.

    Returns:
        The model, whose `validity.doubts` say why it should not be used.

    Raises:
        ModelError: there is no such model, or it cannot be read.
        ParameterError: the file's ending says no format.
        RecordingError: the file cannot be written.
    """
    path = Path(file)
    found = open_model(model, model_store(store, cell))
    kind = format or {".xml": "mjcf", ".json": "parameters"}.get(path.suffix)
    if kind is None:
        raise ParameterError(f"{path}: expected a name that ends in .xml or .json, or `format`")
    if kind == "mjcf":
        export_mjcf(found.arm, path)
    else:
        values = dict(zip(PARAMETER_NAMES, found.arm.vector(), strict=True))
        with replacing(path) as temporary:
            temporary.write_bytes(msgspec.json.format(msgspec.json.encode(values), indent=2) + b"\n")
    return found


def _apart(one: IdentifiedModel, other: IdentifiedModel, name: str) -> float | None:
    """Difference over its standard error; None where one model does not know the parameter's."""
    errors = [each.standard_errors.get(name, 0.0 if name not in each.free else math.nan) for each in (one, other)]
    joint = math.hypot(*errors)
    return abs(one.parameters[name] - other.parameters[name]) / joint if joint > 0 else None

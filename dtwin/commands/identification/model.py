"""`dtwin model ...`: identified models and their history."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tyro
from rich.console import Console
from rich.table import Column, Table

from dtwin.errors import ModelError
from dtwin.files import replacing
from dtwin.identification.mjcf import export_mjcf
from dtwin.identification.model import IdentifiedModel, read_model
from dtwin.identification.store import STORE, ModelStore, StoredModel, open_model
from dtwin.parameters import PARAMETER_NAMES
from dtwin.services.runfile import kept
from dtwin.terminal import as_text, print_json, print_table

_DIFFERENT = 3.0
"""standard errors from which two estimates count as different"""


def _folder(given: Path | None, cell: str) -> Path:
    """The folder of models that an option names, or that of a cell."""
    return given or kept(cell, "store", STORE)


@dataclass(frozen=True)
class ModelList:
    """List the identified models of a store, all revisions."""

    store: Path | None = None
    """Folder of the models; that of the cell if it is up on this machine, else identified, if not given."""
    cell: str = "cell"
    """Name of the cell."""
    json: bool = False
    """Print one JSON array on standard output and nothing else."""

    def execute(self) -> int:
        store = ModelStore(_folder(self.store, self.cell))
        entries = [(entry, read_model(entry.path)) for name in store.names() for entry in store.history(name)]
        if self.json:
            rows = [
                {
                    "name": entry.name,
                    "revision": entry.revision,
                    "file": str(entry.path),
                    "free": model.free,
                    "unidentifiable": model.unidentifiable,
                    "fit": model.validity.fit,
                    "residual_white": model.validity.residual_white,
                    "fingerprint": model.data.fingerprint,
                }
                for entry, model in entries
            ]
            print_json(rows)
            return 0
        title = as_text(f"identified models in {store.folder}")
        table = Table("model", "estimated", "fit", "residuals", "data", title=title)
        for entry, model in entries:
            _add(table, entry, model)
        print_table(table)
        return 0


@dataclass(frozen=True)
class ModelShow:
    """Show an identified model: parameters, intervals, what it was made from and how well it fits."""

    model: Annotated[str, tyro.conf.Positional]
    """NAME, NAME@REVISION or a file that ends in .json."""
    store: Path | None = None
    """Folder of the models; that of the cell if it is up on this machine, else identified, if not given."""
    cell: str = "cell"
    """Name of the cell."""
    json: bool = False
    """Print the model's JSON and nothing else."""

    def execute(self) -> int:
        model = open_model(self.model, ModelStore(_folder(self.store, self.cell)))
        if self.json:
            print_json(model)
            return 0
        table = Table("", "value", "standard error", "status", title=as_text(self.model))
        for name in PARAMETER_NAMES:
            error = model.standard_errors.get(name)
            status = (
                "undetermined" if name in model.unidentifiable else "estimated" if name in model.free else "fixed"
            )
            table.add_row(name, f"{model.parameters[name]:.6g}", f"{error:.2g}" if error is not None else "", status)
        console = Console()
        print_table(table)
        console.print(as_text(model.identifiability))
        white = "white" if model.validity.residual_white else "not white: the model leaves something unexplained"
        console.print(f"fit {_numbers(model.validity.fit)}; residuals {white}", highlight=False)
        if model.validity.doubts:
            console.print(f"in doubt: {model.validity.doubts}", highlight=False, soft_wrap=True)
        loads = _numbers(model.data.payload_kg)
        source = f"from {model.data.source}, {sum(model.data.samples)} samples, load {loads} kg"
        console.print(as_text(f"{source}, data {model.data.fingerprint[:12]}"))
        return 0


@dataclass(frozen=True)
class ModelDiff:
    """Compare two identified models parameter by parameter, in units of their joint standard error."""

    first: Annotated[str, tyro.conf.Positional]
    """NAME, NAME@REVISION or a file that ends in .json."""
    second: Annotated[str, tyro.conf.Positional]
    """The model to compare it with, named in the same way."""
    store: Path | None = None
    """Folder of the models; that of the cell if it is up on this machine, else identified, if not given."""
    cell: str = "cell"
    """Name of the cell."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        store = ModelStore(_folder(self.store, self.cell))
        one, other = open_model(self.first, store), open_model(self.second, store)
        rows = {
            name: {
                "first": one.parameters[name],
                "second": other.parameters[name],
                "standard_errors_apart": _apart(one, other, name),
            }
            for name in PARAMETER_NAMES
            if one.parameters[name] != other.parameters[name]
        }
        if self.json:
            print_json(rows)
            return 0
        console = Console()
        if not rows:
            console.print("no difference")
            return 0
        names = (Column(as_text(name)) for name in (self.first, self.second))
        table = Table("", *names, "change", "standard errors apart")
        for name, row in rows.items():
            first, second, apart = row["first"], row["second"], row["standard_errors_apart"]
            assert first is not None
            assert second is not None
            change = f"{100 * (second / first - 1):+.2f} %" if first else ""
            style = "bold" if apart is not None and apart > _DIFFERENT else ""
            table.add_row(
                name,
                f"{first:.6g}",
                f"{second:.6g}",
                change,
                f"{apart:.1f}" if apart is not None else "",
                style=style,
            )
        print_table(table)
        return 0


@dataclass(frozen=True)
class ModelExport:
    """Write an identified model as an MJCF of the cell or as plain parameters."""

    model: Annotated[str, tyro.conf.Positional]
    """NAME, NAME@REVISION or a file that ends in .json."""
    file: Annotated[Path, tyro.conf.Positional]
    """File to write: .xml for an MJCF, .json for parameters by name."""
    store: Path | None = None
    """Folder of the models; that of the cell if it is up on this machine, else identified, if not given."""
    cell: str = "cell"
    """Name of the cell."""
    format: Literal["mjcf", "parameters"] | None = None
    """What to write, if the file's ending does not say."""

    def execute(self) -> int:
        model = open_model(self.model, ModelStore(_folder(self.store, self.cell)))
        arm = model.arm
        kind = self.format or {".xml": "mjcf", ".json": "parameters"}.get(self.file.suffix)
        if kind is None:
            raise ModelError(f"{self.file}: expected a name that ends in .xml or .json, or --format")
        if kind == "mjcf":
            export_mjcf(arm, self.file)
        else:
            values = dict(zip(PARAMETER_NAMES, arm.vector(), strict=True))
            with replacing(self.file) as temporary:
                temporary.write_bytes(msgspec.json.format(msgspec.json.encode(values), indent=2) + b"\n")
        if doubts := model.validity.doubts:
            print(f"dtwin: model {self.model} is in doubt: {doubts}", file=sys.stderr)
        return 0


def _add(table: Table, entry: StoredModel, model: IdentifiedModel) -> None:
    open_ = f", {len(model.unidentifiable)} undetermined" if model.unidentifiable else ""
    table.add_row(
        as_text(str(entry)),
        f"{len(model.free)}{open_}",
        _numbers(model.validity.fit),
        "white" if model.validity.residual_white else "not white",
        as_text(f"{sum(model.data.samples)} samples, {model.data.fingerprint[:12]}"),
    )


def _numbers(values: list[float]) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _apart(one: IdentifiedModel, other: IdentifiedModel, name: str) -> float | None:
    """Difference over its standard error; None where one model does not know the parameter's."""
    errors = [model.standard_errors.get(name, 0.0 if name not in model.free else math.nan) for model in (one, other)]
    joint = math.hypot(*errors)
    return abs(one.parameters[name] - other.parameters[name]) / joint if joint > 0 else None

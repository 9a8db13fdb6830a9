"""`dtwin model ...`: identified models and their history."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.table import Column, Table

from dtwin.api.kept.models import compare_models, export_model, model_store, models
from dtwin.api.kept.models import model as kept_model
from dtwin.commands.frame import arguments_as_options
from dtwin.identification.model import IdentifiedModel
from dtwin.identification.store import StoredModel
from dtwin.parameters import PARAMETER_NAMES
from dtwin.terminal import as_text, print_json, print_table

_DIFFERENT = 3.0
"""standard errors from which two estimates count as different"""


@dataclass(frozen=True, kw_only=True)
class _Kept:
    """Where models are kept."""

    store: Path | None = None
    """Folder of the models; that of the cell if it is up on this machine, else identified, if not given."""
    cell: str = "cell"
    """Name of the cell."""


@dataclass(frozen=True, kw_only=True)
class ModelList(_Kept):
    """List the identified models of a store, all revisions."""

    json: bool = False
    """Print one JSON array on standard output and nothing else."""

    def execute(self) -> int:
        entries = models(store=self.store, cell=self.cell)
        if self.json:
            rows = [
                {
                    "name": each.entry.name,
                    "revision": each.entry.revision,
                    "file": str(each.entry.path),
                    "free": each.model.free,
                    "unidentifiable": each.model.unidentifiable,
                    "fit": each.model.validity.fit,
                    "residual_white": each.model.validity.residual_white,
                    "fingerprint": each.model.data.fingerprint,
                }
                for each in entries
            ]
            print_json(rows)
            return 0
        title = as_text(f"identified models in {model_store(self.store, self.cell).folder}")
        table = Table("model", "estimated", "fit", "residuals", "data", title=title)
        for each in entries:
            _add(table, each.entry, each.model)
        print_table(table)
        return 0


@dataclass(frozen=True, kw_only=True)
class ModelShow(_Kept):
    """Show an identified model: parameters, intervals, what it was made from and how well it fits."""

    model: Annotated[str, tyro.conf.Positional]
    """NAME, NAME@REVISION or a file that ends in .json."""
    json: bool = False
    """Print the model's JSON and nothing else."""

    def execute(self) -> int:
        model = kept_model(self.model, store=self.store, cell=self.cell)
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


@dataclass(frozen=True, kw_only=True)
class ModelDiff(_Kept):
    """Compare two identified models parameter by parameter, in units of their joint standard error."""

    first: Annotated[str, tyro.conf.Positional]
    """NAME, NAME@REVISION or a file that ends in .json."""
    second: Annotated[str, tyro.conf.Positional]
    """The model to compare it with, named in the same way."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""

    def execute(self) -> int:
        rows = compare_models(self.first, self.second, store=self.store, cell=self.cell)
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
            first, second, apart = row.first, row.second, row.standard_errors_apart
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


@dataclass(frozen=True, kw_only=True)
class ModelExport(_Kept):
    """Write an identified model as an MJCF of the cell or as plain parameters."""

    model: Annotated[str, tyro.conf.Positional]
    """NAME, NAME@REVISION or a file that ends in .json."""
    file: Annotated[Path, tyro.conf.Positional]
    """File to write: .xml for an MJCF, .json for parameters by name."""
    format: Literal["mjcf", "parameters"] | None = None
    """What to write, if the file's ending does not say."""

    def execute(self) -> int:
        with arguments_as_options(self):
            model = export_model(self.model, self.file, store=self.store, cell=self.cell, format=self.format)
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

"""Identified models as JSON files, validated on load, with all figures that say how far to trust them.

Reading a model loads neither the estimator nor numpy: commands and services that only pass one on start at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import msgspec

from dtwin.errors import DtwinError, ModelError, choices
from dtwin.files import replacing
from dtwin.parameters import PARAMETER_NAMES, ArmParameters

SCHEMA: Final = "dtwin identified model 1"
OFFSETS: Final = ("offset1", "offset2", "offset3")
"""Names of the encoder offsets, which are in rad."""


class PriorRecord(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mean and standard deviation of a parameter before the identification, SI units."""

    mean: float
    deviation: float


class Covariance(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Covariance matrix of the estimates, SI units; rows and columns are in the order of the names."""

    names: list[str]
    matrix: list[list[float]]


class Data(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The data that a model was made from.

    Attributes:
        fingerprint: SHA-256 of all experiments.
        source: description of the data in words.
        samples: number of samples of every experiment.
        payload_kg: largest load of every experiment, kg.
        payload_model: how the load acts on the arm, "point" or "weight".
    """

    fingerprint: str
    source: str
    samples: list[int]
    payload_kg: list[float]
    payload_model: str


class Validity(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """How well a model explains the arm.

    Per joint, fit is 1 - ||y - yhat|| / ||y - mean(y)|| on motion that the model was not fitted to, noise the
    standard deviation of the residuals (rad) and whiteness_p the p-value of the autocorrelation test. noise_shape is
    the exponent of the density of the residuals. at_bound names the parameters that sit on a bound of the search; a
    file in which none does leaves it out.
    """

    converged: bool
    fit: list[float]
    noise: list[float]
    noise_shape: float
    residual_white: bool
    whiteness_p: list[float]
    whiteness_lags: int
    bic: float
    at_bound: list[str] = []

    @property
    def doubts(self) -> str:
        """Why the model should not be used, in words; "" if nothing speaks against it."""
        found = [] if self.converged else ["the search did not converge"]
        if not self.residual_white:
            found.append("the residuals are not white: the model leaves something unexplained")
        if self.at_bound:
            found.append(f"on a bound of the search: {', '.join(self.at_bound)}")
        return "; ".join(found)


class IdentifiedModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An identified model.

    Attributes:
        schema: name and version of the file format, SCHEMA.
        parameters: values of all 21 parameters by name, SI units; those in `unidentifiable` are one choice among
            many that fit.
        free: names of the estimated parameters; the others were fixed.
        unidentifiable: names of the free parameters that the data do not determine.
        identifiability: which parameters the data determine, in words.
        standard_errors: standard errors by the names of the identifiable estimates, SI units.
        covariance: covariance of the identifiable estimates.
        offsets: encoder offsets, rad.
        priors: prior knowledge by the names of the parameters.
        data: data that the model was made from.
        validity: how well the model fits.
        versions: versions of the software that made the model.
    """

    schema: str
    parameters: dict[str, float]
    free: list[str]
    unidentifiable: list[str]
    identifiability: str
    standard_errors: dict[str, float]
    covariance: Covariance
    offsets: list[float]
    priors: dict[str, PriorRecord]
    data: Data
    validity: Validity
    versions: dict[str, str]

    @property
    def arm(self) -> ArmParameters:
        """The parameters as `ArmParameters`."""
        return ArmParameters.from_vector(tuple(self.parameters[name] for name in PARAMETER_NAMES))


def encode(model: IdentifiedModel) -> bytes:
    """The bytes of a model file; equal models give equal bytes."""
    return msgspec.json.format(msgspec.json.encode(model), indent=2) + b"\n"


def write_model(model: IdentifiedModel, path: Path) -> None:
    """Writes a model file; the file appears complete or not at all.

    Raises:
        RecordingError: the path cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(encode(model))


def read_model(path: Path) -> IdentifiedModel:
    """Reads and validates a model file.

    Raises:
        ModelError: the file is missing or no model, or a value in it is impossible; the message names the value.
    """
    try:
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    try:
        model = msgspec.json.decode(content, type=IdentifiedModel)
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected an identified model: {error}") from None
    try:
        _check(model)
    except DtwinError as error:
        raise ModelError(f"{path}: {error}") from None
    return model


def _check(model: IdentifiedModel) -> None:
    if model.schema != SCHEMA:
        raise ModelError(f"schema: expected {SCHEMA!r}, got {model.schema!r}")
    _check_names("parameters", model.parameters, PARAMETER_NAMES)
    if missing := [name for name in PARAMETER_NAMES if name not in model.parameters]:
        raise ModelError(f"parameters: {missing[0]} is missing")
    _ = model.arm
    _check_names("free", model.free, PARAMETER_NAMES)
    _check_names("unidentifiable", model.unidentifiable, model.free)
    _check_names("at_bound", model.validity.at_bound, model.free)
    _check_names("standard_errors", model.standard_errors, (*model.free, *OFFSETS))
    _check_names("covariance", model.covariance.names, (*model.free, *OFFSETS))
    for name, error in model.standard_errors.items():
        if not (math.isfinite(error) and error >= 0):
            raise ModelError(f"standard_errors: {name}: expected a finite number of at least 0, got {error}")
    count = len(model.covariance.names)
    rows: list[Any] = model.covariance.matrix
    if len(rows) != count or any(len(row) != count for row in rows):
        raise ModelError(f"covariance: expected a {count} x {count} matrix, one row a name")
    for i, row in enumerate(rows):
        for j, value in enumerate(row):
            scale = math.sqrt(abs(row[i])) * math.sqrt(abs(rows[j][j]))
            if not math.isfinite(value) or abs(value - rows[j][i]) > 1e-9 * scale:
                raise ModelError("covariance: expected a symmetric matrix of finite numbers")
    for name, values in (("offsets", model.offsets), ("fit", model.validity.fit), ("noise", model.validity.noise)):
        if len(values) != 3:
            raise ModelError(f"{name}: expected 3 numbers, one a joint, got {len(values)}")


def _check_names(where: str, names: Iterable[str], allowed: Iterable[str]) -> None:
    valid = list(allowed)
    for name in names:
        if name not in valid:
            raise ModelError(f"{where}: unknown name {name!r}: expected {choices(valid) if valid else 'none'}")

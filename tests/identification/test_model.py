"""Identified models as files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.errors import ModelError
from dtwin.identification.data import fingerprint
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, identify
from dtwin.identification.model import IdentifiedModel, encode, read_model, write_model
from dtwin.identification.result import from_estimate
from tests.support.arms import Array
from tests.support.identification import ALL, SETTINGS, clean, noisy


def test_a_model_says_what_it_is_made_from(
    estimate: Estimate, fit: Array, model: IdentifiedModel, tmp_path: Path
) -> None:
    write_model(model, tmp_path / "m.json")
    read = read_model(tmp_path / "m.json")
    assert read == model
    assert read.arm == estimate.parameters
    assert read.standard_errors["K1"] == estimate.standard_errors["K1"]
    assert read.data.fingerprint == fingerprint([noisy(0, 0.005)])
    assert read.data.payload_kg == [0.2]
    assert read.validity.fit == fit.tolist()
    assert read.validity.residual_white
    covariance = np.array(read.covariance.matrix)
    assert np.sqrt(covariance.diagonal()) == pytest.approx([read.standard_errors[n] for n in read.covariance.names])
    assert np.linalg.eigvalsh(covariance / np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))).min() > 0


def test_equal_estimates_give_equal_bytes(fit: Array, model: IdentifiedModel) -> None:
    again = from_estimate(identify([noisy(0, 0.005)], SETTINGS), fit, "a test")
    assert encode(again) == encode(model)


def test_what_is_undetermined_is_no_result(fit: Array) -> None:
    estimate = identify([clean()], EstimationSettings(ALL, SETTINGS.known))
    model = from_estimate(estimate, fit, "a test")
    assert model.unidentifiable == list(ALL)
    assert not set(model.standard_errors) & set(ALL)
    assert set(model.covariance.names) == {"offset1", "offset2", "offset3"}
    assert "fix 14 of 18" in model.identifiability
    encode(model)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "expected an identified model: "),
        ("[]", "expected an identified model: Expected `object`, got `array`"),
    ],
)
def test_a_file_that_is_no_model_is_refused_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    assert complaint in refusal(tmp_path / "m.json", text)


@pytest.mark.parametrize(
    ("damage", "complaint"),
    [
        (lambda m: m.pop("free"), "missing required field `free`"),
        (lambda m: m.update(extra=1), "unknown field `extra`"),
        (lambda m: m.update(schema="other"), "schema: expected 'dtwin identified model 1', got 'other'"),
        (
            lambda m: m["parameters"].update(K1=-1.0),
            "K1 (voltage_constant): expected a finite number above 0",
        ),
        (lambda m: m["parameters"].update(K1="x"), "Expected `float`, got `str` - at `$.parameters"),
        (lambda m: m["parameters"].pop("m3"), "parameters: m3 is missing"),
        (lambda m: m["parameters"].update(K4=1.0), "parameters: unknown name 'K4': expected K1, K2"),
        (lambda m: m["standard_errors"].update(K1=-1.0), "standard_errors: K1: expected a finite number"),
        (lambda m: m["covariance"]["matrix"].pop(), "covariance: expected a 15 x 15 matrix"),
        (
            lambda m: m["covariance"]["matrix"][0].__setitem__(1, 9.0),
            "covariance: expected a symmetric matrix",
        ),
        (lambda m: m["offsets"].pop(), "offsets: expected 3 numbers, one a joint, got 2"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(
    model: IdentifiedModel, tmp_path: Path, damage: Callable[[dict[str, Any]], object], complaint: str
) -> None:
    content = json.loads(encode(model))
    damage(content)
    assert complaint in refusal(tmp_path / "m.json", json.dumps(content))


def refusal(path: Path, text: str) -> str:
    """Why a file with this text is refused, in one line that names it."""
    path.write_text(text)
    with pytest.raises(ModelError) as caught:
        read_model(path)
    said = str(caught.value)
    assert said.startswith(f"{path}: ")
    assert "\n" not in said
    return said

"""Identified models as files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.errors import ModelError
from dtwin.identification.data import fingerprint
from dtwin.identification.estimation.estimate import EstimationSettings, identify
from dtwin.identification.model import encode, read_model, write_model
from dtwin.identification.result import from_estimate
from tests.support.identification import ALL, CLEAN, SETTINGS, noisy
from tests.support.identified import ESTIMATE, FIT, MODEL


def test_a_model_says_what_it_is_made_from(tmp_path: Path) -> None:
    write_model(MODEL, tmp_path / "m.json")
    model = read_model(tmp_path / "m.json")
    assert model == MODEL
    assert model.arm == ESTIMATE.parameters
    assert model.standard_errors["K1"] == ESTIMATE.standard_errors["K1"]
    assert model.data.fingerprint == fingerprint([noisy(0, 0.005)])
    assert model.data.payload_kg == [0.2]
    assert model.validity.fit == FIT.tolist()
    assert model.validity.residual_white
    covariance = np.array(model.covariance.matrix)
    assert np.sqrt(covariance.diagonal()) == pytest.approx([model.standard_errors[n] for n in model.covariance.names])
    assert np.linalg.eigvalsh(covariance / np.sqrt(np.outer(covariance.diagonal(), covariance.diagonal()))).min() > 0


def test_equal_estimates_give_equal_bytes() -> None:
    again = from_estimate(identify([noisy(0, 0.005)], SETTINGS), FIT, "a test")
    assert encode(again) == encode(MODEL)


def test_what_is_undetermined_is_no_result() -> None:
    estimate = identify([CLEAN], EstimationSettings(ALL, SETTINGS.known))
    model = from_estimate(estimate, FIT, "a test")
    assert model.unidentifiable == list(ALL)
    assert not set(model.standard_errors) & set(ALL)
    assert set(model.covariance.names) == {"offset1", "offset2", "offset3"}
    assert "fix 14 of 18" in model.identifiability
    encode(model)


def damaged(change: Callable[[dict[str, Any]], object]) -> str:
    content = json.loads(encode(MODEL))
    change(content)
    return json.dumps(content)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("{", "expected an identified model: "),
        ("[]", "expected an identified model: Expected `object`, got `array`"),
        (damaged(lambda m: m.pop("free")), "missing required field `free`"),
        (damaged(lambda m: m.update(extra=1)), "unknown field `extra`"),
        (damaged(lambda m: m.update(schema="other")), "schema: expected 'dtwin identified model 1', got 'other'"),
        (
            damaged(lambda m: m["parameters"].update(K1=-1.0)),
            "K1 (voltage_constant): expected a finite number above 0",
        ),
        (damaged(lambda m: m["parameters"].update(K1="x")), "Expected `float`, got `str` - at `$.parameters"),
        (damaged(lambda m: m["parameters"].pop("m3")), "parameters: m3 is missing"),
        (damaged(lambda m: m["parameters"].update(K4=1.0)), "parameters: unknown name 'K4': expected K1, K2"),
        (damaged(lambda m: m["standard_errors"].update(K1=-1.0)), "standard_errors: K1: expected a finite number"),
        (damaged(lambda m: m["covariance"]["matrix"].pop()), "covariance: expected a 15 x 15 matrix"),
        (
            damaged(lambda m: m["covariance"]["matrix"][0].__setitem__(1, 9.0)),
            "covariance: expected a symmetric matrix",
        ),
        (damaged(lambda m: m["offsets"].pop()), "offsets: expected 3 numbers, one a joint, got 2"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "m.json"
    path.write_text(text)
    with pytest.raises(ModelError) as caught:
        read_model(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)

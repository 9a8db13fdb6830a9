"""Identified models as files, their store, and what is exported from them."""

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.emulation.plant import Plant
from dtwin.errors import ModelError
from dtwin.identification.data import Experiment, fingerprint
from dtwin.identification.estimation.estimate import EstimationSettings, identify
from dtwin.identification.excitation.plan import HELD_OUT
from dtwin.identification.held_out import compare
from dtwin.identification.mjcf import export_mjcf
from dtwin.identification.model import encode, from_estimate, read_model, write_model
from dtwin.identification.store import ModelStore, open_model
from tests.support.identification import ALL, ARM, CLEAN, SETTINGS, measured, noisy

ESTIMATE = identify([noisy(0, 0.005)], SETTINGS)
FIT = np.array([0.99, 0.98, 0.97])
MODEL = from_estimate(ESTIMATE, FIT, "a test")


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
    estimate = identify([CLEAN], Settings(ALL, SETTINGS.known))
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


def test_the_store_keeps_every_revision(tmp_path: Path) -> None:
    store = ModelStore(tmp_path / "kept")
    assert store.names() == []
    other = from_estimate(ESTIMATE, FIT, "another")
    entries = [store.save(model, "arm") for model in (MODEL, other, MODEL)]
    store.save(MODEL, "left-arm")
    assert [str(entry) for entry in entries] == ["arm@1", "arm@2", "arm@3"]
    assert store.names() == ["arm", "left-arm"]
    assert store.load("arm") == MODEL
    assert store.load("arm@2") == other
    assert open_model(str(entries[1].path), store) == other
    assert sorted(path.name for path in (tmp_path / "kept" / "arm").iterdir()) == [f"000{k}.json" for k in (1, 2, 3)]


def test_savers_at_once_get_a_revision_each(tmp_path: Path) -> None:
    store = ModelStore(tmp_path)
    with ThreadPoolExecutor(8) as pool:
        entries = list(pool.map(lambda _: store.save(MODEL, "arm"), range(24)))
    assert sorted(entry.revision for entry in entries) == list(range(1, 25))
    assert all(read_model(entry.path) == MODEL for entry in entries)


def test_the_store_names_what_there_is(tmp_path: Path) -> None:
    store = ModelStore(tmp_path)
    with pytest.raises(ModelError, match=r"no model 'arm' in .*: it is empty; dtwin identify --save NAME stores one"):
        store.load("arm")
    store.save(MODEL, "arm")
    with pytest.raises(ModelError, match=r"no model 'leg' in .*: expected arm"):
        store.load("leg")
    with pytest.raises(ModelError, match=r"no revision '7' of model arm: expected 1"):
        store.load("arm@7")
    for name in ("", "../arm", ".hidden", "a/b", "a b"):
        with pytest.raises(ModelError, match=r"model name .*: expected letters"):
            store.save(MODEL, name)
        with pytest.raises(ModelError, match=r"no model"):
            store.find(name)


def test_a_store_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ModelError, match=r"file/arm: cannot be written: Not a directory"):
        ModelStore(tmp_path / "file").save(MODEL, "arm")


def test_the_exported_mjcf_moves_like_the_model(tmp_path: Path) -> None:
    """MuJoCo itself, on the file as it is, against the plant with the model's parameters."""
    import mujoco

    path = tmp_path / "arm.xml"
    export_mjcf(MODEL.arm, path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    plant = Plant(MODEL.arm)
    plant.reset((0.0, 0.0, 0.0))
    data.qpos[:] = (0.0, 0.0, 0.0, plant.gripper)
    volts = (2.0, -1.0, 0.5, 0.0)
    data.ctrl[:] = volts
    plant.apply(volts)
    for _ in range(200):
        mujoco.mj_step(model, data)
    plant.advance(0.5)
    assert data.qpos[:3] == pytest.approx(plant.theta, abs=1e-9)
    assert list(tmp_path.iterdir()) == [path]


def test_held_out_motion_judges_a_model() -> None:
    judged = measured(signal=HELD_OUT, noise=0.002, seed=9)
    offset = np.full(3, 0.001)
    right = compare([judged], ARM, offset)
    wrong = compare([judged], SETTINGS.known, offset)
    assert right.fit.min() > 0.99
    assert wrong.fit.max() < 0.9
    unknown = Experiment(judged.measured, judged.volts, judged.payload, None, payload_model=judged.payload_model)
    assert compare([unknown], ARM, offset).fit == pytest.approx(right.fit, abs=1e-3)

"""The identification of a real arm: from synthetic motions of the same twin, and as far as it may be trusted."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.cli import main
from dtwin.errors import IdentificationError, ModelError
from dtwin.identification.data import Array, Experiment
from dtwin.identification.machine.fit import MachineFit, fit_machine, without_strays
from dtwin.identification.machine.judged import HeldOutMotion, Judged, identify_machine, judge, record_of
from dtwin.identification.machine.left import what_is_left
from dtwin.identification.machine.problem import FARTHEST, RANGE, MachineProblem
from dtwin.identification.machine.record import EncoderCheck, SensorCheck, read_record, write_record
from dtwin.identification.machine.sheet import sheet
from dtwin.parameters import ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import MACHINE_NAMES, SUBSTEP, vector_of
from tests.support.segments import NOISE, motions

ARM = ArmParameters()
FREE = ("D1", "D2", "D3", "mu1", "mu2", "mu3", "dead_zone1", "dead_zone2", "dead_zone3", "delay")
TRUE = vector_of(
    ArmParameters(damping=(0.06, 0.07, 0.05), coulomb=(0.01, 0.02, 0.015)),
    Effects(dead_zone=(0.1, 0.2, 0.05), delay=0.007),
)


ENCODER = EncoderCheck(None, NOISE, NOISE, 0.0, 0.002)
SENSORS = SensorCheck((ENCODER, ENCODER, ENCODER), 0.0, 60.0, 0.0, 300.0)


def fitting(*fits: float) -> HeldOutMotion:
    """Held-out motion of which each joint is predicted with a given fit."""
    measured = np.linspace(-1.0, 1.0, 50)[:, None] * np.ones(3)
    return HeldOutMotion((measured,), (measured * np.array(fits),))


@pytest.fixture(scope="module")
def fitted() -> MachineFit:
    return fit_machine(motions(TRUE, 12, 1), FREE, vector_of(ARM, NO_EFFECTS), sheet(ARM))


def test_a_machine_of_the_model_is_found_with_honest_intervals(fitted: MachineFit) -> None:
    assert fitted.converged
    np.testing.assert_allclose(fitted.noise, NOISE, rtol=0.2)
    for name in FREE:
        truth, deviation = TRUE[MACHINE_NAMES.index(name)], fitted.deviations[name]
        assert abs(fitted.values[name] - truth) < 3 * deviation, name
        assert deviation < 0.3 * sheet(ARM)[name].deviation, name
    assert what_is_left(fitted) == ()
    assert judge(fitted, motions(TRUE, 3, 2)).fit.min() > 0.98


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_a_delay_is_told_as_well_where_commands_begin_to_act_in_another_step(steps: int) -> None:
    """At whole integration steps readings jump a little with the delay: a slope over 1 ms passes over that."""
    segments = tuple(motions(TRUE, 3, 1))
    problem = MachineProblem(segments, ("delay",), TRUE, sheet(ARM))
    x, weights = problem.start(), [np.ones(e.measured.shape) for e in segments]

    def at(delay: float) -> Array:
        x[0] = delay / problem.scale[0]
        return np.concatenate([readings.ravel() for readings in problem.simulate(x)])

    delay = steps * SUBSTEP - 1e-7
    slope = (at(delay + 5e-4) - at(delay - 5e-4)) / 1e-3
    x[0] = delay / problem.scale[0]
    column = np.concatenate([part.shared[:, 0] for part in problem.linearise(x, weights)]) / problem.scale[0]
    assert np.linalg.norm(column - slope) < 0.25 * np.linalg.norm(slope)


def test_what_the_model_lacks_is_said_in_words() -> None:
    rough = TRUE.copy()
    rough[MACHINE_NAMES.index("direction2")] = 0.02
    fit = fit_machine(motions(rough, 12, 3), ("D1", "D2", "D3"), replaced(TRUE, D1=0.05), sheet(ARM))
    first = what_is_left(fit)[0]
    assert (first.shape, first.joint) == ("direction", 2)
    assert "depends on the direction of motion of joint 2: friction that the model lacks" in first.text()
    remarks = Judged(fit, fitting(0.95, 0.95, 0.95), np.full(3, NOISE), (first,)).remarks()
    assert any("joint 2" in remark and "an effect that the model lacks" in remark for remark in remarks)


def test_what_is_small_beside_the_noise_is_said_if_it_is_alike_in_neighbouring_samples(fitted: MachineFit) -> None:
    assert Judged(fitted, fitting(1.0, 1.0, 1.0), np.full(3, NOISE), ()).remarks() == []
    slow = NOISE * np.sin(np.arange(40) / 6.0)[:, None] * [0.0, 1.0, 0.0]
    biased = replace(fitted, residuals=tuple(residual + slow for residual in fitted.residuals))
    (said,) = Judged(biased, fitting(1.0, 1.0, 1.0), np.full(3, NOISE), ()).remarks()
    assert said.startswith("joint 2:")
    assert "of what is left is alike in neighbouring samples" in said


def replaced(vector: Array, **values: float) -> Array:
    result = vector.copy()
    for name, value in values.items():
        result[MACHINE_NAMES.index(name)] = value
    return result


def test_a_number_stays_near_the_data_sheet_and_it_is_said_if_it_would_not() -> None:
    weak = vector_of(ARM, Effects(dead_zone=(1.0, 0.1, 0.1)))
    fit = fit_machine(motions(weak, 12, 3), ("dead_zone1", "dead_zone2"), vector_of(ARM, NO_EFFECTS), sheet(ARM))
    prior = sheet(ARM)["dead_zone1"]
    assert fit.values["dead_zone1"] == pytest.approx(prior.mean + FARTHEST * prior.deviation)
    assert fit.at_edge == ("dead_zone1",)
    (said,) = [
        text for text in Judged(fit, fitting(1.0, 1.0, 1.0), np.full(3, NOISE), ()).remarks() if "sheet" in text
    ]
    assert said.startswith("dead_zone1: as far from the data sheet")


def test_an_effect_that_the_data_do_not_tell_is_kept_within_the_range_of_the_data_sheet() -> None:
    weak = vector_of(replace(ARM, coulomb=(0.1, 0.01, 0.01)), Effects(dead_zone=(1.0, 0.1, 0.1)))
    fit = fit_machine(motions(weak, 12, 3), ("dead_zone1", "mu1"), vector_of(ARM, NO_EFFECTS), sheet(ARM))
    prior = sheet(ARM)["dead_zone1"]
    sure = replace(fit, covariance=np.diag((0.1 * fit.problem.scale) ** 2))
    assert (sure.strays, set(sure.at_edge)) == ((), {"dead_zone1", "mu1"})  # the data tell it, whatever it stands for
    unsure = replace(fit, covariance=np.diag(fit.problem.scale**2))
    assert unsure.strays == ("dead_zone1",)  # a parameter at the edge is left to the grade
    kept = without_strays(unsure)
    assert kept.values["dead_zone1"] == pytest.approx(prior.mean + RANGE * prior.deviation)
    assert kept.strays == ()
    said = Judged(kept, fitting(1.0, 1.0, 1.0), np.full(3, NOISE), ()).remarks()
    assert any(text.startswith("dead_zone1: the motion hardly tells") for text in said)


def test_what_the_data_do_not_tell_keeps_the_data_sheets_tolerance() -> None:
    still = Experiment(np.zeros((40, 3)), np.zeros((40, 3)))
    priors = sheet(ARM)
    fit = fit_machine(
        [still], ("dead_zone1", "cable3"), replaced(vector_of(ARM, NO_EFFECTS), mu1=0.5, mu2=0.5, mu3=0.5), priors
    )
    for name in fit.problem.free:
        assert fit.deviations[name] == pytest.approx(priors[name].deviation, rel=0.05)
        assert fit.values[name] == pytest.approx(priors[name].mean, rel=0.05)
    assert Judged(fit, fitting(1.0, 1.0, 1.0), np.ones(3), ()).identified == ()


def test_grades_and_the_record(fitted: MachineFit, tmp_path: Path) -> None:
    judged = Judged(fitted, fitting(0.99, 0.985, 0.999), np.full(3, NOISE), ())
    assert (judged.grade, set(judged.identified)) == ("identified", set(FREE))
    assert replace(judged, held_out=fitting(0.99, 0.95, 0.999)).grade == "approximate"
    assert replace(judged, held_out=fitting(0.99, 0.5, 0.999)).grade == "unusable"
    record = record_of(judged, SENSORS, ARM, "motions from the bench")
    write_record(record, tmp_path / "arm.json")
    assert read_record(tmp_path / "arm.json") == record
    assert record.effects.delay == fitted.values["delay"]
    assert record.arm.damping[1] == fitted.values["D2"]
    content = json.loads((tmp_path / "arm.json").read_text())
    delay = content["numbers"]["delay"]
    for change, message in (
        ({"schema": "2"}, "schema: expected 'dtwin machine record 6', got '2'; commission the machine anew"),
        ({"schema": "2", "grade": "good", "older": 1}, "schema: expected 'dtwin machine record 6', got '2'"),
        ({"grade": "good"}, "expected the record of a machine: Invalid enum value 'good'"),
        ({"numbers": {}}, "numbers: K1 is missing"),
        ({"numbers": {**content["numbers"], "delay": {**delay, "value": -1.0}}}, "delay: expected"),
    ):
        (tmp_path / "wrong.json").write_text(json.dumps({**content, **change}))
        with pytest.raises(ModelError, match=message):
            read_record(tmp_path / "wrong.json")


def test_a_log_with_too_little_motion_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cell = Cell(CellSettings(duration=8.0))
    cell.run()
    log = cell.log.freeze()
    with pytest.raises(IdentificationError, match=r"too little motion with an empty gripper: .* record two minutes"):
        identify_machine(log, ARM)
    log.write_parquet(tmp_path / "short.parquet")
    assert main(("commission", str(tmp_path / "short.parquet"))) == 2
    assert "too little motion" in capsys.readouterr().err

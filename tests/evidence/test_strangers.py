"""The scorecard of strangers: what it counts, and that the data sheet allows for every machine that is drawn."""

from typing import Any

import msgspec
import pytest

from dtwin.campaign.spread import Workforce
from dtwin.cli import main
from dtwin.emulation.machine.drawing import draw
from dtwin.emulation.machine.sections import Machine
from dtwin.identification.machine.sheet import IDENTIFIED, sheet
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from evidence.identification.strangers import (
    Stranger,
    covered,
    strangers,
    strangers_report,
    truth_of,
    well_met,
)

MET = Stranger(
    7, "identified", (0.99, 0.985, 0.999), {"K1": 0.3, **{f"c{k}": 1.0 for k in range(18)}, "D1": 2.5}, ["x"]
)


def test_every_drawn_machine_is_within_the_data_sheet() -> None:
    """The tolerance of a number is 1.5 times the standard deviation of a uniform distribution: 1.155 of them."""
    priors, nominal = sheet(ArmParameters()), ArmParameters()
    for number in range(200):
        truth = truth_of(draw(number), nominal)
        assert truth.keys() >= set(IDENTIFIED)
        for name in IDENTIFIED:
            assert abs(truth[name] - priors[name].mean) <= 1.16 * priors[name].deviation, (number, name)


def test_an_ideal_machine_is_the_nominal_arm_without_effects() -> None:
    nominal = ArmParameters()
    truth = truth_of(Machine(), nominal)
    for name in IDENTIFIED:
        assert truth[name] == (nominal.get(name) if name in PARAMETER_NAMES else 0.0), name


def test_what_is_counted() -> None:
    assert covered([MET]) == 0.95
    assert well_met([MET])
    changes: tuple[dict[str, Any], ...] = (
        {"fit": (0.99, 0.97, 0.999)},
        {"remarks": []},
        {"away": {"K1": 0.3}},
        {"away": {"K1": 0.3, "D1": 2.5}},
    )
    for change in changes:
        assert not well_met([msgspec.structs.replace(MET, **change)])
    assert "95.0%" in str(strangers_report([MET], 120.0))


def test_a_machine_that_stands_still_is_unusable() -> None:
    found = strangers(1, 1, 0, 4.0, Workforce(1), lambda done, of: None)
    assert [(one.number, one.grade, one.away) for one in found] == [(1, "unusable", {})]
    assert "too little motion" in found[0].remarks[0]


def test_machines_that_the_method_was_tuned_on_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(("experiment", "strangers", "--first", "500")) == 2
    assert "expected machines that nobody tuned to, got 501" in capsys.readouterr().err

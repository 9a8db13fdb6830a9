"""The three plants of the examples: nothing is found in them, their tests pass, and execute every transition."""

from __future__ import annotations

import pytest

from dtwin.parameters import ROOT
from iec61499.cli import main
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.runtime.resource import Resource

PLANTS = ROOT / "examples" / "plants"


def test_nothing_is_found_in_the_plants(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(PLANTS), "--level", "info"]) == 0
    assert capsys.readouterr().out == "files: 9, problems: 0, remarks: 0\n"


def test_the_tests_of_the_plants_execute_every_transition(capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["test", "--coverage", str(PLANTS)]) == 0
    total = capfd.readouterr().out.strip().splitlines()[-1]
    assert total.split() == ["all", "states", "22/22", "transitions", "31/31", "lines", "76/76"]


@pytest.mark.parametrize("name", ["conveyor", "two_tanks", "elevator"])
def test_a_plant_runs_by_itself(name: str) -> None:
    library = Library([PLANTS / name])
    system = library.load_system(PLANTS / name / f"{name}.sys")
    assert (system.left_out, system.inserted) == ((), ())
    resource = Resource(resource_network(system), library)
    resource.start()
    resource.advance(1_000_000_000)

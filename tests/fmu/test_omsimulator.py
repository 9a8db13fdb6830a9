"""OMSimulator, a simulator without Python, comes to what dtwin computes itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest

from dtwin.fmu.sources import Subject, Version
from dtwin.parameters import HANGING, ArmParameters
from dtwin.twin.dynamics import Array
from dtwin.twin.rollout import rollout
from tests.fmu.conftest import Made
from tests.support.closed_loop import Instant, closed_loop
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.omsimulator import (
    NO_OMSIMULATOR,
    OMSIMULATOR,
    Component,
    simulate,
    simulate_system,
    ticks_in_time,
)

pytestmark = [needs_compiler, pytest.mark.skipif(not OMSIMULATOR, reason=NO_OMSIMULATOR)]

VERSIONS: tuple[Version, ...] = ("3.0", "2.0")
JOINTS = (1, 2, 3)
ANGLES = tuple(f"theta{j}" for j in JOINTS)
STATES = (*ANGLES, *(f"omega{j}" for j in JOINTS))
VOLTS = (*(f"V{j}" for j in JOINTS), "V_gripper")
SAME = 1e-12
"""The largest difference from dtwin's own numbers, rad, rad/s and V."""


def archive(made: Made, subject: Subject, version: Version) -> Path:
    folder = made(subject, version)
    return folder.with_name(f"{folder.name}.fmu")


def stacked(found: Mapping[str, Array], names: Iterable[str], component: str = "") -> Array:
    """The values of some variables at the start and after each tick, (ticks + 1, variables)."""
    return np.stack([found[component + name] for name in names], axis=1)


def assert_without_complaints(printed: str) -> None:
    assert "warning:" not in printed, printed
    assert "error:" not in printed, printed


@pytest.mark.parametrize("version", VERSIONS)
def test_the_twin_is_the_rollout(made: Made, version: Version, tmp_path: Path) -> None:
    ticks = 500
    times = np.array(ticks_in_time(ticks))
    names = (*VOLTS[:3], "payload")
    payload = np.where(times > 2.0, 0.2, 0.0)
    columns = np.column_stack((times, *((j + 3.0) * np.sin(j * times) for j in JOINTS), payload))
    rows = (",".join(map(repr, row)) for row in columns.tolist())
    (tmp_path / "table.csv").write_text("\n".join((",".join(("time", *names)), *rows)))
    components = {
        "table": Component(tmp_path / "table.csv", outputs=names),
        "twin": Component(archive(made, "twin", version), inputs=names, start={"mu2": 0.01, "omega1_start": 0.5}),
    }
    found, printed = simulate_system(tmp_path, components, [("table", "twin", name) for name in names], ticks)
    assert_without_complaints(printed)
    # it interpolates its table with an error of rounding, which a motion of the free arm would multiply
    given = stacked(found, names, "twin.")
    assert np.abs(given - columns[:, 1:]).max() <= SAME
    arm = ArmParameters().with_values({"mu2": 0.01})
    expected = rollout(arm, (*HANGING, 0.5, 0.0, 0.0), given[:-1, :3], given[:-1, 3])
    assert np.abs(stacked(found, STATES, "twin.") - expected).max() <= SAME


@pytest.mark.parametrize("version", VERSIONS)
def test_controller_and_twin_are_coupled(made: Made, version: Version, tmp_path: Path) -> None:
    """Both are stepped at once, so that voltages act a tick later; a text cannot be set, so that no box comes."""
    measured = (*ANGLES, "gripper")
    components = {
        "controller": Component(archive(made, "controller", version), inputs=measured, outputs=VOLTS),
        "twin": Component(archive(made, "twin", version), inputs=VOLTS, outputs=measured),
    }
    connections = [
        *(("twin", "controller", name) for name in measured),
        *(("controller", "twin", name) for name in VOLTS),
    ]
    found, printed = simulate_system(tmp_path, components, connections, 300)
    assert_without_complaints(printed)
    expected = list(closed_loop(300, late=True))
    assert_same_states(stacked(found, (*STATES, "gripper"), "twin.")[1:], expected)
    volts = np.array([instant.volts for instant in expected])
    assert np.abs(stacked(found, VOLTS, "controller.")[1:] - volts).max() <= SAME


@pytest.mark.parametrize("version", VERSIONS)
def test_the_cell_is_controller_and_rollout(made: Made, version: Version, tmp_path: Path) -> None:
    found, printed = simulate(tmp_path, archive(made, "cell", version), 600)
    assert_without_complaints(printed)
    expected = list(closed_loop(600, "red", 0.2))
    assert_same_states(stacked(found, (*STATES, "gripper"))[1:], expected)
    carried = [instant.payload for instant in expected]
    assert found["payload"][1:].tolist() == carried
    assert 100 < sum(mass > 0.0 for mass in carried) < 400


def test_no_algebraic_loop_is_found(made: Made, tmp_path: Path) -> None:
    """The controller's voltages follow no input at once.

    Only in FMI 2.0 does OMSimulator read on what values at the start depend.
    """
    components = {
        "controller": Component(archive(made, "controller", "2.0"), inputs=ANGLES, outputs=VOLTS),
        "twin": Component(archive(made, "twin", "2.0"), inputs=VOLTS, outputs=ANGLES),
    }
    connections = [*(("twin", "controller", n) for n in ANGLES), *(("controller", "twin", n) for n in VOLTS)]
    _, printed = simulate_system(tmp_path, components, connections, 2)
    assert "Alg. loop" not in printed


def assert_same_states(found: Array, expected: list[Instant]) -> None:
    states = np.array([(*instant.state, instant.gripper) for instant in expected])
    assert np.abs(found - states).max() <= SAME

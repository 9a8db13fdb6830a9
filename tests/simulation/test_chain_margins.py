"""Margins of any arm's control, against the arm's motion under its own blocks."""

import numpy as np
import pytest

from dtwin.arm.poses import Poses
from dtwin.cli import main
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.equations.rigid import mass_matrix
from dtwin.run.chain import ChainSettings, run
from dtwin.run.margins import chain
from dtwin.run.margins.chain import margins

WIDE = Control(following=1e9)


def rests(late: int) -> bool:
    """Whether the arm comes to rest in a pose; one that swings ever more is stopped by its blocks."""
    arm = arm_of("planar-2r")
    poses = Poses(np.array([[0.0, 0.0], [0.05, 0.05]]), 4.0)
    result = run(ChainSettings(arm, machine_of("ideal", arm), poses, WIDE, 4.0, late=late))
    return result.stop == 0 and float(np.abs(result.error[-100:]).max()) < 0.01


def test_delays_within_the_margin_are_stood_and_others_are_not() -> None:
    arm = arm_of("planar-2r")
    period = arm.period
    least = min(joint.delay for joint in margins(arm, WIDE, 8))
    for late in range(5):
        stable = all(joint.stable for joint in margins(arm, WIDE, 8, late=late))
        assert stable == (late * period < least)
        assert rests(late) == stable


def test_every_arm_of_the_project_has_the_margins_of_its_gains() -> None:
    for name in ("planar-2r", "six-axis", "thesis"):
        for joint in margins(arm_of(name), Control(), 3):
            assert joint.stable
            assert joint.gain > 4.0
            assert joint.weakest < 0.5
            assert np.degrees(joint.phase) > 40.0
            assert joint.delay > 0.02


def test_the_command_prints_a_row_for_each_joint(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["margins", "--arm", "planar-2r"]) == 0
    printed = capsys.readouterr().out
    assert "shoulder" in printed
    assert "elbow" in printed


def test_the_response_of_a_sampled_system_is_that_of_its_equations() -> None:
    """Also where poles coincide, as those of the observers do, and a matrix has too few eigenvectors."""
    generator = np.random.default_rng(4)
    matrix = 0.2 * generator.standard_normal((12, 12))
    matrix[:2] = 0.0
    matrix[:2, :2] = [[0.5, 1.0], [0.0, 0.5]]
    inward, outward = generator.standard_normal((12, 3)), generator.standard_normal((2, 12))
    z = np.exp(1j * np.geomspace(1e-3, np.pi, 50))
    expected = [outward @ np.linalg.solve(each * np.eye(12) - matrix, inward) for each in z]
    assert chain._response(matrix, inward, outward, z) == pytest.approx(np.array(expected), rel=1e-9)


@pytest.mark.parametrize("late", [0, 2])
def test_a_loop_is_what_comes_back_while_the_others_are_closed(late: int) -> None:
    arm, control = arm_of("six-axis"), Control()
    n, q = len(arm), np.linspace(-0.8, 0.7, len(arm))
    masses = mass_matrix(arm, q[None])[0] + np.diag([joint.actuator.rotor or 0.0 for joint in arm.joints])
    plant, law = chain._plant(arm, q, masses, late), chain._law(control, arm.period)
    w = np.geomspace(0.01, np.pi, 25) / arm.period
    z = np.exp(1j * w * arm.period)
    posed = chain.PosedPlant(arm, masses, plant, w, chain._response(*plant[:3], z))
    loops = posed._loops(control, slice(None))
    viscous = np.diag([joint.friction.viscous for joint in arm.joints])
    for k, found in enumerate(loops):
        for at, one in zip(z, found, strict=True):
            motion = plant[2] @ np.linalg.solve(at * np.eye(len(plant[0])) - plant[0], plant[1])
            u, friction = (law[2] @ np.linalg.solve(at * np.eye(5) - law[0], law[1]) + law[3])[:, 0]
            blocks = u * masses + friction * viscous
            others = np.eye(n)
            others[k, k] = 0.0
            inward = np.linalg.solve(np.eye(n) - motion @ others @ blocks, motion[:, k])
            assert one == pytest.approx(-(blocks @ inward)[k], rel=1e-6)

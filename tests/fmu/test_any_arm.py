"""FMUs of arms that are not the thesis's, held to the chain twin and to the function blocks in this process."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dtwin.arm.chain import Arm, Array, Friction
from dtwin.arm.poses import Poses
from dtwin.cli import main
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.arms import arm_of
from dtwin.equations.native import NativeChain
from dtwin.equations.rigid import forward_dynamics, usual_inertia
from dtwin.errors import ModelError
from dtwin.fmu.chain import STEPS, write_chain_fmu
from dtwin.fmu.sources import Subject, Version
from dtwin.parameters import ROOT
from tests.commands.test_cli import complain
from tests.fmu.test_simulated import VERSIONS, Slave
from tests.support.iec61499.c_harness import needs_compiler

fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install dtwin[test]")
pytestmark = needs_compiler

MODELS = [(subject, version) for subject in ("twin", "controller", "cell") for version in VERSIONS]
Opened = Callable[..., "ChainSlave"]


class ChainSlave(Slave):
    """An FMU of any arm, whose names have brackets and whose numbers may be whole ones."""

    def put(self, name: str, value: float) -> None:
        getattr(self.fmu, "setReal" if self._second else "setFloat64")([self.references[name]], [value])

    def put_whole(self, name: str, value: int) -> None:
        getattr(self.fmu, "setInteger" if self._second else "setInt32")([self.references[name]], [value])

    def advance(self, tick: int, period: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=tick * period, communicationStepSize=period)


def frictionless(arm: Arm) -> Arm:
    joints = (replace(joint, friction=Friction(joint.friction.viscous)) for joint in arm.joints)
    return replace(arm, joints=tuple(joints))


def two_poses(arm: Arm) -> Poses:
    return Poses(np.array([[0.3] * len(arm), [-0.2] * len(arm)]), 0.2, True)


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    slaves: list[ChainSlave] = []

    def instantiate(arm: Arm, subject: Subject, version: Version, start: dict[str, Any], **more: Any) -> ChainSlave:
        file, folder = tmp_path / f"{len(slaves)}.fmu", tmp_path / str(len(slaves))
        write_chain_fmu(file, subject, version, arm, **more)
        with zipfile.ZipFile(file) as archive:
            archive.extractall(folder)
        slaves.append(ChainSlave(folder, **start))
        return slaves[-1]

    yield instantiate
    for each in slaves:
        each.fmu.terminate()
        each.fmu.freeInstance()


@pytest.mark.parametrize(("subject", "version"), MODELS)
def test_the_description_is_valid(subject: Subject, version: Version, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    arm = arm_of("planar-2r")
    write_chain_fmu(tmp_path / "arm.fmu", subject, version, arm, poses=two_poses(arm))
    assert validate_fmu(str(tmp_path / "arm.fmu")) == []


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", ["planar-2r", "six-axis"])
def test_the_twin_is_the_chain_twin(opened: Opened, name: str, version: Version) -> None:
    arm = frictionless(arm_of(name))
    n, ticks = len(arm), 300
    generator = np.random.default_rng(3)
    fmu = opened(arm, "twin", version, {f"q{k + 1}_start": 0.1 * k for k in range(n)})
    limit = np.array([joint.actuator.limit for joint in arm.joints])
    commands = 0.3 * limit * np.sin(np.outer(np.arange(ticks) * arm.period, generator.uniform(1.0, 5.0, n)))
    torque: Array = commands * np.array([joint.actuator.constant for joint in arm.joints])
    q, qd = NativeChain(arm).rollout(
        0.1 * np.arange(n, dtype=np.float64), np.zeros(n), torque, arm.period / STEPS, STEPS
    )
    for tick in range(ticks):
        for k in range(n):
            fmu.put(f"u{k + 1}", commands[tick, k])
        fmu.advance(tick, arm.period)
        assert np.abs(np.array(fmu.get(*(f"q{k + 1}" for k in range(n)))) - q[tick + 1]).max() <= 1e-9
        assert np.abs(np.array(fmu.get(*(f"qd{k + 1}" for k in range(n)))) - qd[tick + 1]).max() <= 1e-9
    assert np.abs(q).max() > 0.5


def loaded(arm: Arm, mass: float) -> Arm:
    """The arm with a point mass at its tool, put together from the definition of a moment of inertia."""
    last = arm.links[-1]
    total = last.mass + mass
    centre = (last.mass * last.centre + mass * arm.tool) / total
    inertia = np.array(last.inertia)
    for part, at in ((last.mass, last.centre), (mass, arm.tool)):
        away = at - centre
        inertia = inertia + part * (away @ away * np.eye(3) - np.outer(away, away))
    return replace(arm, links=(*arm.links[:-1], replace(last, mass=total, centre=centre, inertia=inertia)))


@pytest.mark.parametrize("name", ["planar-2r", "six-axis"])
def test_accelerations_are_those_of_the_equations(opened: Opened, name: str) -> None:
    """With a load, rotors and friction, in a state of motion; the equations are those in Python, of rigid.py."""
    arm = arm_of(name)
    n = len(arm)
    generator = np.random.default_rng(5)
    q, qd = generator.uniform(-1.0, 1.0, (2, n))
    u = np.array([0.5 * joint.actuator.limit for joint in arm.joints])
    start = {f"q{k + 1}_start": q[k] for k in range(n)} | {f"qd{k + 1}_start": qd[k] for k in range(n)}
    fmu = opened(arm, "twin", "3.0", {**start, "payload": 0.4})
    for k in range(n):
        fmu.put(f"u{k + 1}", u[k])
    width = fmu.get("coulomb_width")[0]
    rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
    drive = np.array([(joint.actuator.constant or 1.0) for joint in arm.joints]) * u
    friction = [joint.friction for joint in arm.joints]
    lost = np.array([f.viscous * v + f.coulomb * np.tanh(v / width) for f, v in zip(friction, qd, strict=True)])
    heavier = loaded(arm, 0.4)
    found = np.array(fmu.get(*(f"qdd{k + 1}" for k in range(n))))
    without = forward_dynamics(heavier, q[None], qd[None], (drive - lost - rotor * found)[None])[0]
    assert found == pytest.approx(without, rel=1e-9, abs=1e-9)


def test_friction_that_grows_with_the_load_slows_the_arm_down(opened: Opened) -> None:
    arm = arm_of("six-axis")
    names = [f"q{k + 1}" for k in range(len(arm))]
    moved = []
    for own in (arm, frictionless(arm)):
        fmu = opened(own, "twin", "3.0", {})
        for tick in range(50):
            for k, joint in enumerate(arm.joints):
                fmu.put(f"u{k + 1}", 0.6 * joint.actuator.limit)
            fmu.advance(tick, arm.period)
        moved.append(np.abs(fmu.get(*names)))
    assert (moved[0] < moved[1]).any()
    assert np.isfinite(moved).all()


@pytest.mark.parametrize("version", VERSIONS)
def test_the_controller_answers_as_the_blocks_do(opened: Opened, version: Version) -> None:
    arm = arm_of("six-axis")
    poses = two_poses(arm)
    blocks = ChainController(len(arm), inputs(arm, usual_inertia(arm), Control(), poses))
    fmu = opened(arm, "controller", version, {}, poses=poses)
    generator = np.random.default_rng(1)
    q = np.array(poses.positions[0])
    for tick in range(200):
        expected = blocks.step(q.tolist())
        for k in range(len(arm)):
            fmu.put(f"q{k + 1}", q[k])
        fmu.advance(tick, arm.period)
        assert tuple(fmu.get(*(f"u{k + 1}" for k in range(len(arm))))) == expected
        q = blocks.desired()[0] + 1e-4 * generator.standard_normal(len(arm))


@pytest.mark.parametrize("version", VERSIONS)
def test_the_cell_is_blocks_and_chain_twin(opened: Opened, version: Version) -> None:
    arm = frictionless(arm_of("planar-2r"))
    poses = two_poses(arm)
    n = len(arm)
    blocks = ChainController(n, inputs(arm, usual_inertia(arm), Control(), poses))
    fmu = opened(arm, "cell", version, {}, poses=poses)
    chain, q, qd = NativeChain(arm), np.array(poses.positions[0]), np.zeros(n)
    constant = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
    for tick in range(300):
        command: Array = np.array(blocks.step(q.tolist()))
        q, qd = (x[-1] for x in chain.rollout(q, qd, (constant * command)[None], arm.period / STEPS, STEPS))
        fmu.advance(tick, arm.period)
        assert np.abs(np.array(fmu.get(*(f"q{k + 1}" for k in range(n)))) - q).max() <= 1e-9
    assert np.abs(q - poses.positions[0]).max() > 0.1


def test_poses_and_gains_are_parameters(opened: Opened) -> None:
    """Another second pose is where the arm goes then."""
    arm = frictionless(arm_of("planar-2r"))
    start = {"JOINT_1__POSES[1]": 0.1, "SEQUENCE__DWELL": 0.0}
    fmu = opened(arm, "cell", "3.0", start, poses=replace(two_poses(arm), again=False))
    for tick in range(600):
        fmu.advance(tick, arm.period)
    assert fmu.get("q1", "q2") == pytest.approx([0.1, -0.2], abs=1e-3)


def test_a_state_goes_on_as_it_was(opened: Opened) -> None:
    arm = arm_of("planar-2r")
    fmu = opened(arm, "cell", "3.0", {}, poses=two_poses(arm))
    for tick in range(50):
        fmu.advance(tick, arm.period)
    state = fmu.call("serializeFMUState", fmu.call("getFMUState"))
    ways = []
    for _ in range(2):
        for tick in range(50, 100):
            fmu.advance(tick, arm.period)
        ways.append(fmu.get("q1", "q2", "qd1", "qd2"))
        fmu.call("setFMUState", fmu.call("deserializeFMUState", state))
    assert ways[0] == ways[1]


def test_what_is_out_of_range_is_refused(opened: Opened) -> None:
    fmu = opened(arm_of("planar-2r"), "twin", "3.0", {})
    for name, value in (("m_1", -1.0), ("share_1", 2.0), ("u1", np.nan)):
        before = fmu.get(name)
        with pytest.raises(Exception, match=r"iscard|failed"):
            fmu.put(name, value)
        assert fmu.get(name) == before


def test_the_command_writes_what_was_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = str(tmp_path / "arm.fmu")
    assert main(["fmu", "twin", file, "--arm", "planar-2r", "--machine", "7"]) == 0
    description = fmpy.read_model_description(file)
    drawn = {v.name: float(v.start) for v in description.modelVariables if v.start is not None}
    assert drawn["m_1"] != arm_of("planar-2r").links[0].mass
    assert drawn["coulomb_1"] > 0.0
    assert main(["fmu", "cell", file, "--arm", "planar-2r", "--machine", "ideal", "--fmi", "2.0"]) == 0
    description = fmpy.read_model_description(file)
    ideal = {v.name: float(v.start) for v in description.modelVariables if v.start is not None and v.type == "Real"}
    assert ideal["arm.coulomb_1"] == 0.0
    assert ideal["JOINT_1.COULOMB"] == pytest.approx(arm_of("planar-2r").joints[0].friction.coulomb)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["twin", "--arm", "planar-2r", "--model", "x"], "--model: has no meaning for another arm than the thesis's"),
        (["twin", "--machine", "7"], "--machine: expected --arm with another arm than the thesis's"),
        (["cell", "--poses", "p.toml"], "--poses: expected --arm with another arm than the thesis's"),
        (
            ["twin", "--arm", "planar-2r", "--machine", "x"],
            "machine 'x': expected ideal, nominal, a number up to 1000000000",
        ),
        (["controller", "--arm", "nobody"], "nobody"),
    ],
)
def test_mistakes_get_one_line(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "arm.fmu"
    assert said in complain(capsys, "fmu", words[0], str(file), *words[1:])
    assert not file.exists()


def test_gears_that_yield_are_refused_and_their_controller_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, machine = str(tmp_path / "arm.fmu"), tmp_path / "worn.toml"
    machine.write_text("[joints.elbow]\nrotor = 0.01\ngear_stiffness = 800.0\ngear_damping = 1.0\n")
    said = complain(capsys, "fmu", "cell", file, "--arm", "planar-2r", "--machine", str(machine))
    assert "worn.toml: the gears of elbow yield" in said
    sheet = (ROOT / "arms" / "planar-2r.toml").read_text().replace('"planar', f'"{ROOT / "arms"}/planar')
    own = tmp_path / "elastic.toml"
    own.write_text(sheet.replace("[joints.elbow]\n", machine.read_text()))
    assert "the gears of elbow yield" in complain(capsys, "fmu", "twin", file, "--arm", str(own))
    assert main(["fmu", "twin", file, "--arm", str(own), "--machine", "ideal"]) == 0
    assert main(["fmu", "controller", file, "--arm", str(own)]) == 0


def test_a_drive_without_its_constant_is_named(tmp_path: Path) -> None:
    arm = arm_of("planar-2r")
    first = arm.joints[0]
    unknown = replace(first, actuator=replace(first.actuator, constant=None))
    with pytest.raises(ModelError, match=f"joints.{first.name}: expected a drive with its constant"):
        write_chain_fmu(tmp_path / "arm.fmu", "twin", "3.0", replace(arm, joints=(unknown, *arm.joints[1:])))

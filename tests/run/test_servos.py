"""Arms whose drives are commanded a position and have loops of their own."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import servo_torque
from dtwin.arm.file import read_file
from dtwin.arm.poses import Poses, drawn_poses
from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick
from dtwin.cli import main
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.rigid import inverse_dynamics, usual_inertia
from dtwin.errors import ModelError
from dtwin.identification.chain.identify import Sample, identify, unexplained
from dtwin.identification.chain.overlay import overlaid, write_arm
from dtwin.identification.chain.result import numbers
from dtwin.parameters import ROOT
from dtwin.run.chain import ChainRun, ChainSettings, run
from dtwin.services.chain.ticks import BRIDGED, Rows
from tests.run.test_chain_sorting import TASK

ARM = arm_of("servo-2r")
START = np.array([0.4, -0.9])


def settings(seed: int, duration: float = 30.0, late: int = 0) -> ChainSettings:
    poses = drawn_poses(ARM, 40, np.random.default_rng(seed))
    control = Control(delay=late * ARM.period)
    return ChainSettings(ARM, machine_of("1901", ARM), poses, control, duration, seed, late)


@pytest.mark.parametrize("late", [0, 1])
def test_a_drawn_machine_follows_its_path(late: int) -> None:
    found = run(settings(1, 10.0, late))
    assert found.stop == 0
    assert np.abs(found.error).max() < 0.01
    assert not found.saturated.any()


def test_boxes_are_sorted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "task.toml").write_text(TASK)
    words = ["run", "--arm", "servo-2r", "--sort", str(tmp_path / "task.toml"), "--duration", "30"]
    assert main([*words, "--machine", "1902", "--json"]) == 0
    boxes = json.loads(capsys.readouterr().out)["boxes"]
    assert boxes["delivered"] >= 4
    assert boxes["within_5_mm"] == boxes["delivered"]
    assert boxes["missed"] == 0


def test_without_torque_the_arm_is_held_where_it_was() -> None:
    """The stop `torque off` of the blocks, at rest and in motion; it sags by what its loops yield."""
    poses = Poses(np.array([START, [1.4, 0.3]]), 0.0, False)
    blocks = ChainController(2, inputs(ARM, usual_inertia(ARM), settings(1).control, poses))
    plant = ChainPlant(machine_of("ideal", ARM), START)
    for _ in range(25):
        plant.apply(blocks.step(plant.read().tolist()))
        plant.advance()
    assert np.abs(plant.state[1]).max() > 0.5
    blocks.halt(angles_known=False)
    where, commands = plant.read(), []
    for _ in range(300):
        commands.append(blocks.step(plant.read().tolist()))
        plant.apply(commands[-1])
        plant.advance()
    assert blocks.stop == 3
    assert len(set(commands)) == 1
    assert np.abs(np.array(commands[-1]) - where).max() < 0.05
    assert np.abs(plant.state[1]).max() < 1e-3
    assert np.abs(plant.state[0] - where).max() < 0.1


def test_a_loop_gives_what_its_stiffness_and_damping_say() -> None:
    """At rest under a constant command, the plant is off it by what gravity needs of the stiffness."""
    plant = ChainPlant(machine_of("ideal", ARM), START)
    for _ in range(400):
        plant.apply(START.tolist())
        plant.advance()
    q, qd = plant.state
    needed = inverse_dynamics(ARM, q[None], qd[None], np.zeros((1, 2)))[0]
    assert q == pytest.approx(START - needed / [joint.actuator.stiffness for joint in ARM.joints], abs=1e-4)
    assert servo_torque(ARM, START, q, qd) == pytest.approx(needed, abs=1e-4)
    assert servo_torque(ARM, q + 100.0, q, qd).tolist() == [20.0, 8.0]


@pytest.mark.parametrize("strength", [0.5, 0.8])
def test_a_weaker_loop_is_commanded_as_much_farther_as_it_is_weaker(strength: float) -> None:
    """It holds the arm with the same torque: strength times stiffness times what the command is beyond."""
    poses = Poses(np.array([START, START]), 0.0, False)
    beyond = []
    for each in (1.0, strength):
        blocks = ChainController(2, inputs(ARM, usual_inertia(ARM), settings(1).control, poses))
        blocks.adjust(Adjustment((0.0, 0.0), (each, each), (1.0, 1.0)))
        beyond.append(np.array(blocks.step(START.tolist())) - START)
    assert np.abs(beyond[0]).min() > 1e-3
    assert strength * beyond[1] == pytest.approx(beyond[0], rel=1e-9)


def test_it_is_identified_by_the_torque_of_its_loops() -> None:
    fitted, other = (run(settings(seed)).measurement() for seed in (1, 2))
    assert fitted.kind == "torque"
    found = identify(ARM, [Sample(fitted)])
    assert (unexplained(*found.predicted(other)) < 0.06).all()


def ticks_of(ran: ChainRun) -> list[JointTick]:
    rows = zip(ran.t.tolist(), ran.q.tolist(), ran.command.tolist(), ran.target.tolist(), strict=True)
    return [
        JointTick(JointSensors(k, t, tuple(q)), JointCommands(k, t, tuple(command), tuple(target)))
        for k, (t, q, command, target) in enumerate(rows)
    ]


@pytest.mark.parametrize("late", [0, 1])
def test_ticks_off_the_bus_tell_the_torque_of_its_loops(late: int) -> None:
    """However many are drained together: the velocity of a tick is known two ticks later."""
    ran = run(settings(3, 2.0, late))
    rows, drained = Rows(ARM, late), []
    for tick in ticks_of(ran):
        assert rows.add(tick) == 0
        if len(rows) >= 7:
            drained.append(rows.drain())
    t, q, target, effort, _ = (np.concatenate(each) for each in zip(*drained, strict=True))
    told = np.isin(ran.t, t)
    assert t[0] == ran.t[late + 2]
    assert len(t) > 180
    for mine, whole in ((q, ran.q), (target, ran.target), (effort, ran.effort)):
        assert mine == pytest.approx(whole[told], abs=1e-9)


def test_after_ticks_that_are_lost_nothing_counts_on_those_before() -> None:
    ran, rows, lost = run(settings(3, 1.0)), Rows(ARM, 0), slice(40, 40 + BRIDGED)
    ticks = ticks_of(ran)
    del ticks[lost]
    missing = [rows.add(tick) for tick in ticks]
    assert sum(missing) == missing[lost.start] == BRIDGED
    t, *_, effort = rows.drain()
    assert t[0] == ran.t[lost.stop + 2]
    assert effort == pytest.approx(ran.effort[lost.stop + 2 : -2], abs=1e-9)


def test_what_is_found_counts_that_its_loops_differ_from_the_data_sheet(tmp_path: Path) -> None:
    found = identify(ARM, [Sample(run(settings(1)).measurement())])
    assert found.prior.gain_deviation == pytest.approx([ARM.tolerances.constant] * 2)
    assert (found.gain_deviations() > 0.2 * ARM.tolerances.constant).all()
    loops = [(joint.actuator.stiffness, joint.actuator.damping) for joint in overlaid(found).joints]
    assert pytest.approx(np.array([[150.0, 60.0], [6.0, 2.0]]) * found.found.gain) == np.array(loops).T
    known = read_file(ROOT / "arms" / "servo-2r.toml")
    model = Path(shutil.copy(ROOT / "arms" / "planar-2r.xml", tmp_path))
    write_arm(found, known, model, tmp_path / "found.toml")
    kept = [joint.actuator.stiffness for joint in arm_of(str(tmp_path / "found.toml")).joints]
    assert kept == pytest.approx([stiffness for stiffness, _ in loops])
    held = replace(ARM, joints=tuple(replace(j, actuator=replace(j.actuator, tolerance=0.0)) for j in ARM.joints))
    exact = {row.name: row for row in numbers(identify(held, [Sample(run(settings(1)).measurement())]))}
    wider = {row.name: row for row in numbers(found)}
    assert "shoulder gain" not in exact
    assert wider["fore Iyy"].half > 1.2 * exact["fore Iyy"].half


def test_drives_of_two_kinds_are_refused_by_name() -> None:
    joints = (ARM.joints[0], arm_of("planar-2r").joints[1])
    mixed = replace(ARM, joints=joints)
    with pytest.raises(
        ModelError, match=r"joints\.shoulder: expected a drive that is commanded as those of the other"
    ):
        inputs(mixed, usual_inertia(mixed), settings(1).control, None)


@pytest.mark.parametrize("words", [["margins"], ["fmu", "twin", "x.fmu"]])
def test_what_needs_a_torque_says_so(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*words, "--arm", "servo-2r"]) == 2
    assert "this one is commanded a position and makes its torque itself" in capsys.readouterr().err


def test_position_actuators_of_a_model_tell_their_loops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (Path(__file__).parents[2] / "arms" / "planar-2r.xml").read_text()
    servos = (
        '<actuator><position joint="shoulder" kp="150" kv="6" forcerange="-20 20"/>'
        '<position joint="elbow" kp="60" kv="2"/></actuator>'
    )
    (tmp_path / "small.xml").write_text(text.replace("</mujoco>", f"{servos}</mujoco>"))
    arm = arm_of(str(tmp_path / "small.xml"))
    assert [joint.actuator.stiffness for joint in arm.joints] == [150.0, 60.0]
    assert [joint.actuator.damping for joint in arm.joints] == [6.0, 2.0]
    assert arm.joints[0].effort == 20.0
    assert main(["arm", "import", str(tmp_path / "small.xml"), "--out", str(tmp_path / "small.toml")]) == 0
    said = (tmp_path / "small.toml").read_text()
    assert "stiffness = 150" in said
    assert "# add effort" in said
    assert "# add limit" not in said
    capsys.readouterr()
    assert main(["arm", "check", str(tmp_path / "small.toml")]) == 1
    assert "add joints.elbow.effort" in capsys.readouterr().out

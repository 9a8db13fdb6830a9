"""Drives and surroundings of joints in MJCF files of others: what counts, and what is left out and told."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dtwin.arm.chain import Arm
from dtwin.arm.urdf import read_urdf
from dtwin.emulation.chain.mjcf import read_mjcf
from dtwin.equations.rigid import inverse_dynamics
from dtwin.errors import ModelError

BODIES = """
<body name="load" gravcomp="0"><joint name="one" axis="0 1 0" damping="0.5" armature="0.2"/>
  <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.04" mass="2"/>
  <body pos="0 0 0.4"><joint name="two" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.03" mass="1"/>
    <site name="tip" pos="0 0 0.3"/></body></body>"""


def model(folder: Path, actuators: str = "", bodies: str = BODIES, more: str = "") -> Path:
    file = folder / "arm.xml"
    world = f'<worldbody><site name="wall" pos="1 0 1"/>{bodies}</worldbody>'
    file.write_text(f"<mujoco>{world}<actuator>{actuators}</actuator>{more}</mujoco>")
    return file


def first(folder: Path, actuators: str) -> tuple[Arm, str]:
    """The arm with actuators on its joint 1, and what is said of that joint."""
    arm = read_mjcf(model(folder, actuators + '<motor joint="two"/>'))
    return arm, " ".join(remark for remark in arm.remarks if "joint one" in remark)


def test_a_motor_gives_what_its_command_and_its_force_allow(tmp_path: Path) -> None:
    arm, said = first(tmp_path, '<motor joint="one" gear="50" ctrlrange="-3 3" forcerange="-2 2"/>')
    assert (arm.joints[0].actuator.constant, arm.joints[0].actuator.limit, said) == (50.0, 2.0, "")
    arm, said = first(tmp_path, '<motor joint="one" ctrlrange="0 3"/>')
    assert arm.joints[0].actuator.limit == np.inf
    assert "actuator 1 acts one way, from 0 to 3" in said


def test_a_servo_behind_a_gear_is_one_of_the_joint(tmp_path: Path) -> None:
    servo = '<position joint="one" kp="10" kv="1" gear="2" forcerange="-5 5" timeconst="0.1"/>'
    arm, said = first(tmp_path, servo)
    joint = arm.joints[0]
    assert (joint.actuator.stiffness, joint.actuator.damping, joint.effort) == (40.0, 4.0, 10.0)
    assert "lag of 0.1 s" in said
    assert "takes 2 times the position" in said


@pytest.mark.parametrize(
    ("actuators", "what"),
    [
        ('<velocity name="v" joint="one" kv="3"/>', "actuator v takes a velocity, which no drive of an arm does"),
        ('<intvelocity name="v" joint="one" kp="3" actrange="-1 1"/>', "actuator v is of another kind"),
        ('<damper name="v" joint="one" kv="3" ctrlrange="0 1"/>', "actuator v is of another kind"),
        ("", "no actuator of the model moves it"),
        ('<motor name="m" site="tip" gear="1 0 0 0 0 0"/>', "actuator m moves it by a tendon, site or body"),
        (
            '<position name="p" joint="one" kp="9"/><velocity name="v" joint="one" kv="3"/>',
            "2 actuators move it: p counts, v left out",
        ),
    ],
)
def test_what_no_drive_does_is_left_out_and_told(tmp_path: Path, actuators: str, what: str) -> None:
    arm, said = first(tmp_path, actuators)
    assert what in said
    if "p counts" not in what:
        assert (arm.joints[0].actuator.commanded, arm.joints[0].actuator.constant) == ("torque", None)


@pytest.mark.parametrize(
    ("old", "new", "more", "what"),
    [
        ('damping="0.5"', 'stiffness="7"', "", "joint one: its spring of 7 N m/rad is left out"),
        ('damping="0.5"', 'damping="0.5 0.1"', "", "joint one: of its damping what is not proportional"),
        ('gravcomp="0"', 'gravcomp="1"', "", "takes the weight off load (gravcomp)"),
        ("", "", '<option density="1000"/>', "the model moves in a fluid"),
        (
            "",
            "",
            '<tendon><spatial name="rope" stiffness="5"><site site="wall"/><site site="tip"/></spatial></tendon>',
            "tendon rope acts on the chain",
        ),
        (
            "",
            "",
            '<equality><connect name="bolt" body1="load" anchor="0 0 1" active="false"/></equality>',
            "bolt between load and world is left out",
        ),
    ],
)
def test_what_acts_on_the_chain_beside_its_drives_is_told(
    tmp_path: Path, old: str, new: str, more: str, what: str
) -> None:
    arm = read_mjcf(model(tmp_path, bodies=BODIES.replace(old, new) if old else BODIES, more=more))
    assert any(what in remark for remark in arm.remarks), arm.remarks


def test_rotor_and_friction_of_actuators_count_and_gravity_may_be_off(tmp_path: Path) -> None:
    motors = '<motor joint="one" gear="3" armature="0.01" damping="0.1"/><motor joint="two"/>'
    file = model(tmp_path, motors, more='<option><flag gravity="disable" contact="disable"/></option>')
    arm = read_mjcf(file)
    assert arm.remarks == ()
    reference = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(reference)
    data.qpos[:], data.qvel[:], data.qacc[:] = (0.3, -0.8), (1.1, 0.4), (2.0, -3.0)
    mujoco.mj_inverse(reference, data)
    q, qd, qdd = (np.array(values)[None] for values in (data.qpos, data.qvel, data.qacc))
    rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
    viscous = np.array([joint.friction.viscous for joint in arm.joints])
    ours = inverse_dynamics(arm, q, qd, qdd)[0] + rotor * qdd[0] + viscous * qd[0]
    assert np.allclose(ours, data.qfrc_inverse, atol=1e-12)


def test_bodies_without_names_are_told_apart(tmp_path: Path) -> None:
    finger = '<body><joint/><geom size="0.1"/></body>'
    with pytest.raises(ModelError, match="several chains have 1 joint: body 1 or body 2"):
        read_mjcf(model(tmp_path, bodies=finger * 2))
    assert read_mjcf(model(tmp_path, bodies=finger * 2), "body 2").joints[0].name == "joint_2"


def test_a_loop_is_named_by_what_it_holds(tmp_path: Path) -> None:
    loop = '<equality><connect name="bolt" body1="load" anchor="0 0 1"/></equality>'
    with pytest.raises(ModelError, match="bolt between load and world: expected a tree, got a closed loop"):
        read_mjcf(model(tmp_path, more=loop))


def urdf(folder: Path, dynamics: str) -> Path:
    file = folder / "arm.urdf"
    inertial = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    ends = '<parent link="a"/><child link="b"/>'
    joint = f'<joint name="one" type="continuous">{ends}{dynamics}</joint>'
    file.write_text(f'<robot name="r"><link name="a"/><link name="b">{inertial}</link>\n{joint}</robot>')
    return file


def test_friction_of_a_urdf_counts(tmp_path: Path) -> None:
    friction = read_urdf(urdf(tmp_path, '<dynamics damping="0.7" friction="1.5"/>')).joints[0].friction
    assert (friction.viscous, friction.coulomb) == (0.7, 1.5)
    with pytest.raises(ModelError, match=r"arm\.urdf:2: joint one: expected damping of at least 0, got -1"):
        read_urdf(urdf(tmp_path, '<dynamics damping="-1"/>'))

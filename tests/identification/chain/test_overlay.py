"""What was found, back in files of models: MuJoCo and Pinocchio compute the torque of the identified regressor."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from dtwin.arm.chain import Actuator, Arm
from dtwin.arm.file import ArmFile, read_file
from dtwin.emulation.chain.arms import arm_of, chain_of
from dtwin.emulation.chain.overlay import write_mjcf
from dtwin.equations.rigid import regressor
from dtwin.errors import ModelError
from dtwin.identification.chain.identify import Identification, Sample, Settings, identify
from dtwin.identification.chain.overlay import overlaid, write_arm, write_urdf
from tests.support.chains import drawn_urdf, measured

JOINTS = 3
GAIN = np.array([8.0, 12.0, 5.0])
ROTOR = np.array([0.3, 0.2, 0.1])
DIGITS = 2e-5
"""What MuJoCo's own writer leaves: it writes six digits."""
HAND = """<link name="hand"><inertial><origin xyz="0.02 0 0.05"/><mass value="0.4"/>
  <inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>
<joint name="mount" type="fixed"><parent link="link_3"/><child link="hand"/><origin xyz="0 0.1 0"/></joint></robot>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a description whose last link has a hand, and MuJoCo's form of it with two fingers."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "drawn.urdf").write_text(drawn_urdf(JOINTS, 11).replace("</robot>", HAND))
    spec = mujoco.MjSpec.from_string(drawn_urdf(JOINTS, 11))
    spec.compiler.fusestatic = False
    last = spec.body("link_3")
    hand = last.add_body(name="hand", pos=[0.0, 0.1, 0.0])
    hand.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.03, 0.04], mass=0.3)
    for side in (-1.0, 1.0):
        finger = hand.add_body(name=f"finger {side:g}", pos=[0.0, 0.02 * side, 0.05])
        finger.add_joint(name=f"grip {side:g}", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[0.0, 1.0, 0.0])
        finger.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.005, 0.005, 0.03], mass=0.05)
    spec.compile()
    (folder / "drawn.xml").write_text(spec.to_xml())
    return folder


def found_of(arm: Arm) -> Identification:
    """The arm identified in amperes from a motion with a load of 1.5 kg and one without, from a wrong data sheet."""
    sheet = replace(
        arm.with_parameters(1.1 * arm.parameters),
        joints=tuple(replace(joint, actuator=Actuator("current", gear=50.0)) for joint in arm.joints),
    )
    logs = []
    for seed, load in ((1, 0.0), (2, 1.5)):
        log = measured(arm, 25.0, seed, noise=0.005, load=load)
        assert log.v is not None
        assert log.effort is not None
        torque = log.effort + ROTOR * np.gradient(log.v, log.t, axis=0)
        logs.append(replace(log, effort=torque / GAIN, kind="current"))
    return identify(sheet, [Sample(logs[0]), Sample(logs[1], "box")], Settings({"box": 1.5}, ("rotor",)))


@pytest.fixture(scope="module")
def found(folder: Path) -> Identification:
    return found_of(chain_of(folder / "drawn.urdf"))


def states(seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    q, v, a = np.random.default_rng(seed).uniform(-1.5, 1.5, (3, 40, JOINTS))
    return q, v, a


def torque_of(arm: Arm, rotors: bool) -> np.ndarray:
    """What the identified regressor says of the states, with viscous friction and, if asked, rotors."""
    q, v, a = states()
    viscous = np.array([joint.friction.viscous for joint in arm.joints])
    rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
    found: np.ndarray = regressor(arm, q, v, a) @ arm.parameters + (viscous * v + rotor * a if rotors else 0.0)
    return found


def in_mujoco(path: Path, joints: tuple[str, ...]) -> np.ndarray:
    """MuJoCo's inverse dynamics of the same states, without dry friction, which it tells as a constraint."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    places = [int(model.jnt_dofadr[model.joint(name).id]) for name in joints]
    torques = []
    for q, v, a in zip(*states(), strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = 0.0, 0.0, 0.0
        data.qpos[places], data.qvel[places], data.qacc[places] = q, v, a
        mujoco.mj_inverse(model, data)
        torques.append(data.qfrc_inverse[places].copy())
    return np.array(torques)


def test_friction_and_rotors_are_those_that_act(found: Identification) -> None:
    arm = overlaid(found)
    assert np.allclose([joint.actuator.constant or 0.0 for joint in arm.joints], GAIN, rtol=0.02)
    assert np.allclose([joint.actuator.rotor or 0.0 for joint in arm.joints], ROTOR, atol=0.06)
    assert np.allclose([joint.friction.coulomb for joint in arm.joints], 2.0, rtol=0.1)
    assert np.allclose([joint.friction.viscous for joint in arm.joints], 1.5, rtol=0.1)


@pytest.mark.parametrize("shapes", [False, True], ids=["of the chain", "of the template"])
def test_mujoco_computes_the_torque_that_was_identified(shapes: bool, folder: Path, tmp_path: Path) -> None:
    template = folder / ("drawn.xml" if shapes else "drawn.urdf")
    arm = overlaid(found_of(chain_of(template)))
    file = tmp_path / "found.xml"
    write_mjcf(arm, template if shapes else None, file)
    names = tuple(joint.name for joint in arm.joints)
    expected = torque_of(arm, rotors=True)
    assert np.allclose(in_mujoco(file, names), expected, rtol=DIGITS, atol=DIGITS * np.abs(expected).max())
    model = mujoco.MjModel.from_xml_path(str(file))
    dry = [model.dof_frictionloss[model.jnt_dofadr[model.joint(name).id]] for name in names]
    assert np.allclose(dry, [joint.friction.coulomb for joint in arm.joints], rtol=DIGITS)
    again = chain_of(file)
    assert np.allclose(again.parameters, arm.parameters, rtol=DIGITS, atol=DIGITS)
    if shapes:
        assert model.body("finger 1").mass[0] == pytest.approx(0.05)  # joints move it: it keeps its own
        assert model.body("hand").mass[0] == 0.0


def test_pinocchio_computes_the_torque_that_was_identified(
    found: Identification, folder: Path, tmp_path: Path
) -> None:
    pinocchio = pytest.importorskip("pinocchio")
    file = tmp_path / "found.urdf"
    write_urdf(found, folder / "drawn.urdf", file)
    model = pinocchio.buildModelFromUrdf(str(file))
    data = model.createData()
    arm = overlaid(found)
    got = np.array([pinocchio.rnea(model, data, *state) for state in zip(*states(), strict=True)])
    expected = torque_of(arm, rotors=False)
    assert np.allclose(got, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    assert np.allclose(model.damping, [joint.friction.viscous for joint in arm.joints])
    assert np.allclose(model.upperDryFrictionLimit, [joint.friction.coulomb for joint in arm.joints])


@pytest.mark.parametrize("ending", [".urdf", ".xml"])
def test_the_file_of_the_arm_is_read_as_what_was_found(ending: str, folder: Path, tmp_path: Path) -> None:
    template = folder / f"drawn{ending}"
    source = folder / "drawn.toml"
    limits = "".join(f"[joints.joint_{k}]\ngear = 50.0\nlimit = 20.0\nacceleration = 4.0\n" for k in (1, 2, 3))
    source.write_text(f'model = "drawn{ending}"\ntool = [0.1, 0.0, 0.2]\n{limits}[gripper]\npayload = 2.0\n')
    result = found_of(chain_of(template))
    model = tmp_path / f"found{ending}"
    if ending == ".urdf":
        write_urdf(result, template, model)
    else:
        write_mjcf(overlaid(result), template, model)
    write_arm(result, read_file(source), model, tmp_path / "found.toml")
    again, expected = arm_of(str(tmp_path / "found.toml")), overlaid(result)
    assert np.allclose(again.parameters, expected.parameters, rtol=DIGITS, atol=DIGITS)
    for mine, other in zip(again.joints, expected.joints, strict=True):
        assert mine.friction == other.friction
        assert mine.actuator.commanded == "current"
        assert mine.actuator.constant == pytest.approx(other.actuator.constant)
        assert mine.actuator.rotor == pytest.approx(other.actuator.rotor)
        assert mine.actuator.limit == 20.0
        assert mine.acceleration == 4.0
    assert again.tool.tolist() == [0.1, 0.0, 0.2]
    assert again.gripper is not None


def test_files_that_are_not_those_of_the_arm_are_refused(found: Identification, folder: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.urdf"
    other.write_text(drawn_urdf(2, 5))
    with pytest.raises(ModelError, match=r"other\.urdf: expected a link 'link_3'"):
        write_urdf(found, other, tmp_path / "found.urdf")
    light = overlaid(found_of(chain_of(folder / "drawn.xml")))
    tiny = light.with_parameters(np.concatenate([light.parameters[:-10], 1e-3 * light.parameters[-10:]]))
    with pytest.raises(ModelError, match="body link_3: what joints move beside the chain is heavier"):
        write_mjcf(tiny, folder / "drawn.xml", tmp_path / "found.xml")
    with pytest.raises(ModelError, match="expected the model in the same folder"):
        write_arm(found, ArmFile(other, other), folder / "drawn.urdf", tmp_path / "found.toml")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other.urdf"]

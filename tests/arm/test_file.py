"""Files of arms: what they say, what is refused and how, and that the arms of the project are whole."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from dtwin.arm.chain import aligned
from dtwin.arm.file import names
from dtwin.arm.text import findings
from dtwin.cli import main
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.geometry import Geometry
from dtwin.emulation.chain.mjcf import read_mjcf
from dtwin.equations.rigid import inverse_dynamics
from dtwin.errors import ModelError
from dtwin.parameters import ROOT

ODD = """
<mujoco>
  <compiler angle="radian"/>
  <option gravity="1 2 -9"/>
  <worldbody>
    <body pos="0.1 0 0.2" euler="0.3 0.2 0.1">
      <geom type="box" size="0.1 0.2 0.1"/>
      <body name="a" pos="0 0.2 0.1" euler="0.4 0 0.2">
        <joint name="swing" axis="1 2 0.5" pos="0.05 0.02 -0.1" ref="0.3"/>
        <joint name="slide" type="slide" axis="0 1 1" pos="0.3 0 0" ref="-0.1"/>
        <geom type="capsule" size="0.05 0.2" pos="0.1 0 0.1"/>
        <body name="plate" pos="0.2 0 0" euler="0 1 0">
          <geom type="box" size="0.02 0.1 0.1"/>
          <body name="b" pos="0 0.1 0.3" euler="1 0.2 0">
            <joint name="turn" axis="0.2 1 0" pos="0 0.05 0"/>
            <geom type="box" size="0.02 0.1 0.1" pos="0.1 0 0"/>
            <body name="finger" pos="0.1 0.1 0"><joint name="grip" type="slide"/><geom size="0.03"/></body>
            <body name="hand" pos="0 0 0.2"><geom size="0.04"/><site name="tool" pos="0 0.1 0"/></body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


def by_mujoco(file: Path, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Torques of MuJoCo's inverse dynamics; joints beyond those given stand still at 0."""
    model = mujoco.MjModel.from_xml_path(str(file))
    data = mujoco.MjData(model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    model.dof_damping[:] = model.dof_armature[:] = 0.0
    n = len(q)
    data.qpos[:n], data.qvel[:n], data.qacc[:n] = q, qd, qdd
    mujoco.mj_inverse(model, data)
    return np.array(data.qfrc_inverse[:n])


@pytest.mark.parametrize("source", ["odd", "planar-2r", "six-axis", "thesis"])
def test_chains_of_mjcf_move_as_in_mujoco(source: str, tmp_path: Path) -> None:
    file = {"odd": tmp_path / "odd.xml", "thesis": ROOT / "models/arm.xml"}.get(source, ROOT / f"arms/{source}.xml")
    if source == "odd":
        file.write_text(ODD)
    arm = read_mjcf(file, "hand" if source == "odd" else "tip" if source == "thesis" else None)
    generator = np.random.default_rng(1)
    q, qd, qdd = generator.uniform(-2.0, 2.0, (3, 20, len(arm)))
    # MuJoCo's finger at 0, its armature left out, is the body that the reader welds
    expected = np.stack([by_mujoco(file, *row) for row in zip(q, qd, qdd, strict=True)])
    for chain in (arm, aligned(arm)):
        np.testing.assert_allclose(inverse_dynamics(chain, q, qd, qdd), expected, rtol=1e-10, atol=1e-10)


def test_a_chain_of_mjcf_ends_where_its_fingers_begin(tmp_path: Path) -> None:
    body = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom size="0.1"/>{1}</body>'
    fingers = "".join(body.format(name, "") for name in ("left", "right"))
    file = tmp_path / "hand.xml"
    inside = body.format("upper", body.format("hand", fingers))
    file.write_text(f"<mujoco><worldbody>{inside}</worldbody></mujoco>")
    arm = read_mjcf(file)
    assert [joint.name for joint in arm.joints] == ["upper", "hand"]
    assert arm.remarks[0] == "the chain ends at hand, where its fingers begin; tip names another link"


def test_a_model_that_is_not_there_is_told_as_such(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["arm", "import", str(tmp_path / "away" / "arm.urdf")]) == 2
    assert "arm.urdf: cannot be read" in capsys.readouterr().err


def test_fingers_are_welded_where_the_file_has_them(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """There they weigh and are drawn, also where that is not their position 0; what MuJoCo warns of is no concern."""
    file = tmp_path / "ref.xml"
    file.write_text(
        '<mujoco><compiler settotalmass="2"/><worldbody><body name="upper"><joint name="lift" axis="0 1 0"/>'
        '<geom type="box" size="0.1 0.1 0.1"/><body name="finger" pos="0.4 0 0"><joint name="grip" type="slide" '
        'axis="1 0 0" ref="0.2"/><geom type="box" size="0.1 0.1 0.1"/></body></body></worldbody></mujoco>'
    )
    arm = read_mjcf(file, "upper")
    assert arm.remarks == ("joint grip is not in the chain: it is welded at 0.2",)
    assert arm.links[0].mass == pytest.approx(2.0)
    assert arm.links[0].centre[0] == pytest.approx(0.2)
    (tmp_path / "ref.toml").write_text('model = "ref.xml"\ntip = "upper"\nperiod = 0.01\n')
    placed = Geometry(arm_of(str(tmp_path / "ref.toml"))).place(np.zeros(1))
    assert placed.body("finger").xpos == pytest.approx([0.4, 0.0, 0.0])
    assert "settotalmass" not in "".join(capfd.readouterr())
    assert not Path("MUJOCO_LOG.TXT").exists()


def test_the_tool_is_a_point_of_the_last_link(tmp_path: Path) -> None:
    file = tmp_path / "odd.xml"
    file.write_text(ODD)
    arm = read_mjcf(file, "hand")
    assert arm.remarks == ("joint grip is not in the chain: it is welded at 0",)
    assert [link.name for link in arm.links] == ["a before slide", "a", "b"]
    assert arm.tool.tolist() == [0.0, 0.05, 0.2]


@pytest.mark.parametrize("name", names())
def test_arms_of_the_project_can_be_driven(name: str) -> None:
    arm = arm_of(name)
    assert findings(arm) == []
    assert all(link.mass > 0.0 for link in arm.links)


LOOP = '<equality><connect body1="b" anchor="0 0 0"/></equality>'
FOLLOWS = '<equality><joint joint1="turn" joint2="swing"/></equality>'
BALL = '<body name="b" pos="0 0 1"><joint type="ball"/>'


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("</mujoco>", LOOP + "</mujoco>", "closed loop"),
        ("</mujoco>", FOLLOWS + "</mujoco>", "joint turn follows swing"),
        ('<body name="b" pos="0 0.1 0.3" euler="1 0.2 0">', BALL, "ball"),
        ('<geom size="0.04"/>', '<geom size="0.04">', "odd.xml:18"),
        ("<worldbody>", '<default><geom mass="0"/></default><worldbody>', "mass and inertia"),
    ],
)
def test_what_is_no_chain_is_refused(old: str, new: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "odd.xml"
    file.write_text(ODD.replace(old, new))
    with pytest.raises(ModelError, match=words) as caught:
        read_mjcf(file, "hand")
    assert str(file) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "model: expected a text, got nothing"),
        ('model = "a.txt"', "expected a model that ends in"),
        ('model = "none.xml"', "none.xml"),
        ('model = "six.xml"\nspeed = 2', "speed: unknown key: expected .*model"),
        ('model = "six.xml"\n[joints.none]', "joints.none: expected a joint of the model, .*shoulder"),
        ('model = "six.xml"\n[joints.base]\nmass = 2', "joints.base.mass: unknown key: expected .*constant"),
        ('model = "six.xml"\n[joints.base]\ncommanded = "W"', "joints.base.commanded: expected .*\"?V.*got 'W'"),
        ('model = "six.xml"\n[joints.base]\nlimit = -1', "joints.base.limit: expected a number above 0.*got -1"),
        ('model = "six.xml"\n[joints.base]\ngear = 0', "joints.base.gear: expected a number other than 0"),
        ('model = "six.xml"\n[joints.base]\nlimit = inf', "joints.base.limit"),
        ('model = "six.xml"\n[joints.base]\nlower = 9', "joints.base: expected lower below upper"),
        ('model = "six.xml"\n[joints]\nbase = 3', "joints.base: expected a table"),
        ('model = "six.xml"\nperiod = 1.0', "period: expected at most 0.1"),
        ('model = "six.xml"\ntip = "hand"', "tip 'hand': expected one of the bodies"),
        ('model = "six.xml"\ntool = [1, 2]', "tool: expected three numbers"),
        ("model = ", "expected an arm"),
    ],
)
def test_wrong_files_say_key_and_choices(text: str, words: str, tmp_path: Path) -> None:
    (tmp_path / "six.xml").write_bytes((ROOT / "arms/six-axis.xml").read_bytes())
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ModelError, match=words):
        arm_of(str(tmp_path / "mine.toml"))


def test_an_imported_arm_says_what_a_person_must_add(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, file = tmp_path / "six.xml", tmp_path / "six.toml"
    model.write_bytes((ROOT / "arms/six-axis.xml").read_bytes())
    assert main(["arm", "import", str(model)]) == 0
    assert "add joints.base.speed" in capsys.readouterr().out
    text = file.read_text()
    assert 'model = "six.xml"' in text
    assert "# add acceleration" in text
    assert main(["arm", "check", str(file)]) == 1
    text = text.replace("# add limit = largest command either way, in its unit", "limit = 200.0")
    text = text.replace("# add speed = largest speed, rad/s or m/s", "speed = 2.0")
    text = text.replace("# add acceleration = largest acceleration of a path, rad/s^2 or m/s^2", "acceleration = 5.0")
    file.write_text(text)
    assert main(["arm", "check", str(file)]) == 0
    assert main(["arm", "import", str(model)]) == 2
    assert file.read_text() == text

"""Descriptions of robots: what is read of them, and what is refused by name, file and line."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.chain import Link
from dtwin.arm.file import missing
from dtwin.arm.urdf import read_urdf
from dtwin.cli import main
from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ModelError

INERTIAL = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", inside: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<origin xyz="0 0 1"/><axis xyz="0 0 1"/>{inside}</joint>'


def robot(folder: Path, *parts: str, links: str = "abc") -> Path:
    file = folder / "robot.urdf"
    bodies = [f'<link name="{name}">{"" if name == "a" else INERTIAL}</link>' for name in links]
    file.write_text("\n".join(['<robot name="r">', *bodies, *parts, "</robot>"]))
    return file


def test_a_chain_is_read_from_base_to_tip(tmp_path: Path) -> None:
    arm = read_urdf(robot(tmp_path, joint("one", "a", "b"), joint("two", "b", "c", "prismatic")))
    assert [j.name for j in arm.joints] == ["one", "two"]
    assert [j.kind for j in arm.joints] == ["revolute", "prismatic"]
    assert arm.joints[1].translation.tolist() == [0.0, 0.0, 1.0]
    assert [link.mass for link in arm.links] == [2.0, 2.0]
    assert len(arm.parameter_names) == len(arm.parameters) == 20


def test_what_hangs_on_a_link_by_a_fixed_joint_is_part_of_it(tmp_path: Path) -> None:
    arm = read_urdf(robot(tmp_path, joint("one", "a", "b"), joint("flange", "b", "c", "fixed")))
    assert arm.links[0].mass == 4.0
    assert arm.links[0].centre.tolist() == [0.0, 0.0, 0.5]
    assert np.allclose(np.diag(arm.links[0].inertia), [3.0, 3.0, 2.0])  # 2 x 1, and 2 kg twice at half a metre


def test_a_branch_is_welded_and_told(tmp_path: Path) -> None:
    parts = [joint("one", "a", "b"), joint("two", "b", "c"), joint("finger", "c", "d", "prismatic")]
    arm = read_urdf(robot(tmp_path, *parts, links="abcd"), tip="c")
    assert len(arm) == 2
    assert arm.links[1].mass == 4.0
    assert arm.remarks == ("joint finger is not in the chain: it is welded at 0",)


ROS = (
    '<transmission name="t"><joint name="{0}"/><actuator name="m">'
    "<mechanicalReduction>{1}</mechanicalReduction></actuator></transmission>"
)
ROS_2 = (
    '<ros2_control name="s" type="system"><transmission name="t"><joint name="{0}" role="joint1">'
    "<mechanical_reduction>{1}</mechanical_reduction></joint></transmission></ros2_control>"
)


@pytest.mark.parametrize("form", [ROS, ROS_2])
def test_a_gear_between_a_motor_and_its_joint_is_told(tmp_path: Path, form: str) -> None:
    def told(name: str, reduction: str) -> tuple[str, ...]:
        parts = joint("one", "a", "b"), joint("two", "b", "c"), form.format(name, reduction)
        return read_urdf(robot(tmp_path, *parts)).remarks

    assert told("two", "-50") == ("joint two: a transmission with gear = 50, for a rotor or a constant of the motor",)
    assert told("two", "1") == told("finger", "50") == ()
    for wrong in ("fifty", "0", "inf", ""):
        with pytest.raises(
            ModelError, match=rf"robot.urdf:\d+: <mechanical.*>: expected a finite number .* got '{wrong}'"
        ):
            told("two", wrong)


def hand(folder: Path) -> Path:
    """Two joints, a flange, and two fingers that slide."""
    parts = [joint("one", "a", "b"), joint("two", "b", "c"), joint("flange", "c", "d", "fixed")]
    parts += [joint(name, "d", end, "prismatic") for name, end in (("left", "e"), ("right", "f"))]
    return robot(folder, *parts, links="abcdef")


def test_a_chain_ends_where_its_fingers_begin(tmp_path: Path) -> None:
    arm = read_urdf(hand(tmp_path))
    assert [j.name for j in arm.joints] == ["one", "two"]
    assert arm.links[1].mass == 8.0
    assert arm.tool.tolist() == [0.0, 0.0, 1.0]
    assert arm.remarks == (
        "the chain ends at d, where its fingers begin; tip names another link",
        "joint left is not in the chain: it is welded at 0",
        "joint right is not in the chain: it is welded at 0",
    )
    assert len(read_urdf(hand(tmp_path), tip="f")) == 3


def test_two_arms_are_asked_for_by_their_hands(tmp_path: Path) -> None:
    """Arms of two joints with two fingers each, whose trunk is the link that stands still."""
    links, parts = "a", []
    for one, two, *fingers in (list("bcde"), list("fghi")):
        parts += [joint(one, "a", one), joint(two, one, two), *(joint(each, two, each) for each in fingers)]
        links += "".join((one, two, *fingers))
    with pytest.raises(ModelError, match=r"expected a tip, as several chains have 3 joints: c or g$"):
        read_urdf(robot(tmp_path, *parts, links=links))


def test_a_prefix_that_is_declared_nowhere_is_no_reason_to_refuse_a_robot(tmp_path: Path) -> None:
    file = robot(tmp_path, joint("one", "a", "b"), "<sensor:camera name='c'/>", links="ab")
    assert len(read_urdf(file)) == 1


def test_a_file_that_was_refused_is_no_reason_to_refuse_the_next_one(tmp_path: Path) -> None:
    (tmp_path / "torn.urdf").write_text("<robot><link></robot>")
    with pytest.raises(ModelError, match="expected XML"):
        read_urdf(tmp_path / "torn.urdf")
    file = robot(tmp_path, joint("one", "a", "b"), "<sensor:camera name='c'/>", links="ab")
    assert len(read_urdf(file)) == 1


def test_every_link_without_mass_is_named_at_once(tmp_path: Path) -> None:
    file = robot(tmp_path, joint("one", "a", "b"), joint("two", "b", "c"))
    file.write_text(file.read_text().replace(INERTIAL, ""))
    with pytest.raises(ModelError, match=r":3: link b: expected an <inertial> with a mass above 0; c lacks it too$"):
        read_urdf(file)


def test_parameters_and_links_are_the_same_told_twice() -> None:
    link = Link("l", 3.0, np.array([0.1, 0.2, 0.3]), np.diag([0.1, 0.2, 0.25]))
    again = Link.from_parameters("l", link.parameters)
    assert again.mass == 3.0
    assert np.allclose(again.centre, link.centre)
    assert np.allclose(again.inertia, link.inertia)


@pytest.mark.parametrize(
    ("parts", "links", "said"),
    [
        ([joint("one", "a", "b", inside='<mimic joint="two"/>')], "ab", ":4: joint one follows joint two"),
        (
            [joint("one", "a", "b"), joint("two", "c", "b")],
            "abc",
            ":6: expected one joint above link b, got joints one",
        ),
        ([joint("one", "b", "a")], "ab", ":2: link a: expected an <inertial> with a mass above 0"),
        ([joint("one", "a", "b", "floating")], "ab", "joint one: expected a type revolute"),
        ([joint("one", "a", "x")], "ab", "expected one of the links, a or b"),
        (
            [joint("one", "a", "b"), joint("two", "a", "c")],
            "abc",
            "expected a tip, as several chains have 1 joint: b or c",
        ),
        ([], "a", "expected a joint that moves below link a, got none"),
        ([joint("one", "a", "b").replace("0 0 1", "0 nan 1")], "ab", "expected three finite numbers"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(tmp_path: Path, parts: list[str], links: str, said: str) -> None:
    file = robot(tmp_path, *parts, links=links)
    with pytest.raises(ModelError) as error:
        read_urdf(file)
    assert str(error.value).startswith(str(file))
    assert said in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("base", [None, "a", "b"])
def test_a_closed_loop_is_refused_wherever_the_chain_shall_begin(tmp_path: Path, base: str | None) -> None:
    file = robot(tmp_path, joint("one", "a", "b"), joint("two", "b", "a"), links="ab")
    with pytest.raises(ModelError, match="joint one: expected a tree, got a closed loop"):
        read_urdf(file, base=base)


def test_a_file_without_links_is_no_closed_loop(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="expected links, got none"):
        read_urdf(robot(tmp_path, links=""))


def test_a_chain_without_end_is_refused(tmp_path: Path) -> None:
    links = [f"l{number}" for number in range(2000)]
    file = tmp_path / "long.urdf"
    parts = [f'<link name="{link}"/>' for link in links]
    parts += [joint(f"j{k}", *ends, "fixed") for k, ends in enumerate(pairwise(links))]
    file.write_text(f"<robot name='long'>{''.join(parts)}</robot>")
    with pytest.raises(ModelError, match="expected at most 500 links, got 2000"):
        read_urdf(file)


def test_other_files_are_refused_as_what_they_are(tmp_path: Path) -> None:
    file = tmp_path / "other.urdf"
    for text, said in (
        ("<mujoco/>", "expected <robot>, got <mujoco>"),
        ("not xml", "expected XML"),
        ("", "expected XML"),
    ):
        file.write_text(text)
        with pytest.raises(ModelError, match=said):
            read_urdf(file)
    with pytest.raises(ModelError, match="cannot be read"):
        read_urdf(tmp_path / "missing.urdf")


def test_an_entity_reads_no_other_file(tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("hidden")
    file = tmp_path / "evil.urdf"
    file.write_text(f'<!DOCTYPE r [<!ENTITY x SYSTEM "{secret}">]><robot name="r"><link name="a">&x;</link></robot>')
    with pytest.raises(ModelError) as error:
        read_urdf(file)
    assert "hidden" not in str(error.value)


LIGHT = """<robot name="light"><link name="base"/>
<link name="rod"><inertial><origin xyz="0 0 {centre}"/><mass value="0.1"/>
<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>{limit}</joint>
</robot>"""


def test_zeros_in_place_of_limits_are_not_known(tmp_path: Path) -> None:
    file = tmp_path / "light.urdf"
    file.write_text(LIGHT.format(centre=0.1, limit='<limit lower="0" upper="0" velocity="0" effort="0"/>'))
    assert main(["arm", "import", str(file)]) == 0
    joint = arm_of(str(tmp_path / "light.toml")).joints[0]
    assert (joint.lower, joint.upper, joint.speed, joint.effort) == (-np.inf, np.inf, np.inf, np.inf)
    assert "joints.turn.speed" in missing(arm_of(str(tmp_path / "light.toml")))


def test_an_empty_range_is_refused_before_anything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "light.urdf"
    file.write_text(LIGHT.format(centre=0.1, limit='<limit lower="1" upper="-1" velocity="1" effort="1"/>'))
    assert main(["arm", "import", str(file)]) == 2
    assert "light.urdf:4: joint turn: expected lower below upper, got 1 and -1" in capsys.readouterr().err
    assert not (tmp_path / "light.toml").exists()


@pytest.mark.parametrize(("centre", "status"), [(0.1, 0), (0.005, 1)])
def test_a_loop_that_would_fall_over_is_told_by_check(
    centre: float, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limit = '<limit lower="-3" upper="3" velocity="3" effort="5"/>'
    (tmp_path / "light.urdf").write_text(LIGHT.format(centre=centre, limit=limit))
    drive = '[joints.turn]\ncommanded = "N m"\nlimit = 5\nacceleration = 5.0\n'
    (tmp_path / "light.toml").write_text(f'model = "light.urdf"\n{drive}')
    assert main(["arm", "check", str(tmp_path / "light.toml")]) == status
    assert ("the loop is not stable" in capsys.readouterr().out) is bool(status)


def test_a_drive_that_does_not_hold_the_arm_is_told_by_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limit = '<limit lower="-3" upper="3" velocity="3" effort="5"/>'
    (tmp_path / "light.urdf").write_text(LIGHT.format(centre=0.1, limit=limit))
    drive = '[joints.turn]\ncommanded = "N m"\nlimit = 0.01\nacceleration = 5.0\n'
    (tmp_path / "light.toml").write_text(f'model = "light.urdf"\n{drive}')
    assert main(["arm", "check", str(tmp_path / "light.toml")]) == 1
    assert "joints.turn: its drive gives 0.01 N m at most" in capsys.readouterr().out


@pytest.mark.parametrize("command", [["arm", "check"], ["margins", "--arm"]])
def test_links_that_are_points_are_no_arm(
    command: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As in models for pictures, which have masses and inertias of zero."""
    point = '<inertial><mass value="1"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial>'
    file = robot(tmp_path, joint("one", "a", "b"), joint("two", "b", "c"))
    file.write_text(file.read_text().replace(INERTIAL, point))
    drive = 'commanded = "N m"\nlimit = 50\nacceleration = 5.0\nspeed = 2.0\n'
    (tmp_path / "p.toml").write_text(f'model = "robot.urdf"\n[joints.one]\n{drive}[joints.two]\n{drive}')
    assert main([*command, str(tmp_path / "p.toml")]) in (1, 2)
    printed = capsys.readouterr()
    assert "nothing resists a motion of" in printed.out + printed.err

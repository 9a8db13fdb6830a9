"""Serial chains that are drawn for tests, as URDF."""

from pathlib import Path

import numpy as np

from dtwin.arm.chain import Arm
from dtwin.arm.urdf import read_urdf

_JOINT = """<joint name="joint_{i}" type="{kind}">
  <parent link="link_{before}"/><child link="link_{i}"/>
  <origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>
  <limit lower="-3" upper="3" velocity="3" effort="100"/>
</joint>"""
_LINK = """<link name="link_{i}"><inertial>
  <origin xyz="{xyz}" rpy="{rpy}"/><mass value="{mass}"/>
  <inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/>
</inertial></link>"""


def _words(numbers: np.ndarray) -> str:
    return " ".join(map(repr, map(float, numbers)))


def drawn_urdf(joints: int, seed: int, *, planar: bool = False, prismatic: int = 0) -> str:
    """A chain with drawn frames, axes and bodies; joint number `prismatic` slides."""
    generator = np.random.default_rng(seed)
    parts = ['<robot name="drawn">', '<link name="link_0"/>']
    for i in range(1, joints + 1):
        size = generator.uniform(0.05, 0.3, 3)
        mass = generator.uniform(0.5, 8.0)
        angles = np.zeros(3) if planar else generator.uniform(-1.5, 1.5, 3)
        axis = np.array([0.0, 1.0, 0.0]) if planar else generator.normal(size=3)
        x, y, z = mass / 12.0 * size**2
        inertia = {"ixx": y + z, "iyy": x + z, "izz": x + y, "ixy": 0.0, "ixz": 0.0, "iyz": 0.0}
        parts += [
            _LINK.format(i=i, xyz=_words(size / 2), rpy=_words(angles[::-1]), mass=mass, **inertia),
            _JOINT.format(
                i=i,
                before=i - 1,
                kind="prismatic" if i == prismatic else "revolute",
                xyz=_words(generator.uniform(-0.4, 0.4, 3)),
                rpy=_words(angles),
                axis=_words(axis / np.linalg.norm(axis)),
            ),
        ]
    return "\n".join([*parts, "</robot>"])


def drawn_arm(folder: Path, joints: int, seed: int, **options: bool | int) -> Arm:
    """The chain of `drawn_urdf`, written to and read from a file."""
    file = folder / "drawn.urdf"
    file.write_text(drawn_urdf(joints, seed, **options))  # type: ignore[arg-type]
    return read_urdf(file)

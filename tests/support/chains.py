"""Serial chains that are drawn for tests, as URDF, and logs of their motion."""

from pathlib import Path
from typing import Any

import numpy as np

from dtwin.arm.chain import Actuator, Arm, Friction, Joint, Link
from dtwin.arm.urdf import read_urdf
from dtwin.equations.rigid import regressor
from dtwin.measurements.measurement import Measurement

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


def drawn_arm(folder: Path, joints: int, seed: int, **options: Any) -> Arm:
    """The chain of `drawn_urdf`, written to and read from a file."""
    file = folder / "drawn.urdf"
    file.write_text(drawn_urdf(joints, seed, **options))
    return read_urdf(file)


def motion_of(joints: int, seconds: float, rate: float, seed: int) -> tuple[np.ndarray, ...]:
    """Time, positions, velocities and accelerations of a drawn sum of sines, (N,) and (N, joints) each."""
    generator = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / rate)
    q, v, a = (np.zeros((len(t), joints)) for _ in range(3))
    for joint in range(joints):
        for frequency in generator.uniform(0.05, 0.5, 5):
            w, phase, size = 2.0 * np.pi * frequency, generator.uniform(0.0, 6.3), generator.uniform(0.1, 0.4)
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w * w * np.sin(w * t + phase)
    return t, q, v, a


def measured(arm: Arm, seconds: float, seed: int, noise: float = 0.002, load: float = 0.0) -> Measurement:
    """What a drawn motion of an arm would log: friction of 2 + 1.5 v in every joint, noise in parts of the torque."""
    t, q, v, a = motion_of(len(arm), seconds, 100.0, seed)
    held = arm.parameters
    held[-10] += load
    torque = regressor(arm, q, v, a) @ held + 2.0 * np.tanh(v / 0.02) + 1.5 * v
    generator = np.random.default_rng(seed + 1)
    torque += noise * torque.std(axis=0) * generator.normal(size=torque.shape)
    names = tuple(joint.name for joint in arm.joints)
    return Measurement(f"drawn {seed}", names, t, q, v, torque, "torque")


def csv_of(measurement: Measurement) -> list[list[str]]:
    """Header and rows of a measurement: t, q0.., qd0.., tau0.."""
    n = measurement.q.shape[1]
    head = ["t", *(f"{name}{k}" for name in ("q", "qd", "tau") for k in range(n))]
    assert measurement.v is not None
    assert measurement.effort is not None
    columns = np.column_stack([measurement.t, measurement.q, measurement.v, measurement.effort])
    return [head, *([f"{value:.6f}" for value in row] for row in columns)]


def driven_arm(joints: int, seed: int) -> Arm:
    """An arm of joints of both kinds, with drives, whose axes and frames nothing simplifies."""
    generator = np.random.default_rng(seed)
    made, links = [], []
    for k in range(joints):
        rotation = np.linalg.qr(generator.normal(size=(3, 3)))[0]
        rotation *= np.sign(np.linalg.det(rotation))
        axis = generator.normal(size=3)
        root = 0.1 * generator.normal(size=(3, 3))
        made.append(
            Joint(
                f"j{k}",
                "prismatic" if k % 3 == 2 else "revolute",
                axis / np.linalg.norm(axis),
                rotation,
                0.4 * generator.normal(size=3),
                lower=-2.0,
                upper=2.0,
                speed=1.0 + k,
                acceleration=4.0 + k,
                actuator=Actuator("voltage", 0.5 + k, rotor=0.1),
                friction=Friction(0.2, 0.3, 0.05),
            )
        )
        inertia = root @ root.T
        links.append(Link(f"l{k}", 1.0 + k, 0.2 * generator.normal(size=3), np.trace(inertia) * np.eye(3) - inertia))
    return Arm("drawn", tuple(made), tuple(links), np.array([0.3, -0.2, -9.0]), tool=np.array([0.1, 0.2, 0.3]))

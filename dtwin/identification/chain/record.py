"""What is kept of an identified arm, so that later logs can be held against it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.equations.rigid import regressor
from dtwin.errors import RecordingError
from dtwin.files import reason_of
from dtwin.identification.chain.design import Filtering, Smooth
from dtwin.identification.chain.friction import Scale, friction_terms
from dtwin.identification.chain.identify import Identification
from dtwin.identification.chain.moments import columns
from dtwin.measurements.measurement import Effort

Numbers = tuple[float, ...]


class Record(msgspec.Struct, frozen=True):
    """An arm with an empty hand, as it was identified; n joints, SI units.

    Attributes:
        joints: names of the joints.
        kind: what the logs' effort is.
        gain: N m (N) per unit of the log, joint by joint.
        parameters: inertial parameters of all links, in the order of chain.INERTIAL, 10 n numbers.
        friction: coefficient of every term that was used, by its name, joint by joint.
        speed: usual speed of every joint.
        travel: usual travel of every joint.
        temperature: mean temperature of every drive, degrees Celsius.
        noise: root mean square of what was not explained, N m (N).
        largest: largest of it, N m (N).
        torque: root mean square of the torque, N m (N).
        cutoff: corner of the filter, Hz.
    """

    joints: tuple[str, ...]
    kind: Effort
    gain: Numbers
    parameters: Numbers
    friction: tuple[dict[str, float], ...]
    speed: Numbers
    travel: Numbers
    temperature: Numbers
    noise: Numbers
    largest: Numbers
    torque: Numbers
    cutoff: float

    @property
    def scales(self) -> tuple[Scale, ...]:
        """What is usual for each joint."""
        return tuple(map(Scale, self.speed, self.travel, self.temperature))

    @property
    def filtering(self) -> Filtering:
        """How noise was taken away."""
        return Filtering(self.cutoff)

    def predicted(self, arm: Arm, stretch: Smooth) -> tuple[Array, Array]:
        """Torque of a motion with an empty hand, before the filter: what the gears carry, and what is lost.

        Args:
            arm: the arm, of which only lengths and axes are looked at.
            stretch: the motion; terms of temperature are left out where it has none.

        Returns:
            Both (N, n), N m (N).
        """
        found: Array = regressor(arm, stretch.q, stretch.v, stretch.a) @ np.array(self.parameters)
        carried, lost = np.abs(found), np.zeros_like(found)
        for j, scale in enumerate(self.scales):
            warm = None if stretch.temperature is None else stretch.temperature[:, j]
            terms = friction_terms(scale, stretch.q[:, j], stretch.v[:, j], stretch.a[:, j], carried[:, j], warm)
            lost[:, j] = terms.values @ np.array([self.friction[j].get(name, 0.0) for name in terms.names])
        return found, lost


class _File(msgspec.Struct, frozen=True):
    """The part of the file of `dtwin identify --out` that is read again."""

    model: Record


def record_of(found: Identification) -> Record:
    """What is kept of an identification."""
    design, layout, fit = found.design, found.moments.layout, found.found
    efforts = np.concatenate([rows.effort for rows in design.rows]) * fit.gain
    residuals = efforts - np.concatenate([columns(layout, rows) @ fit.unknowns for rows in design.rows])
    friction = []
    for joint, names in enumerate(design.names):
        place = layout.friction(joint)
        pairs = zip(names, fit.unknowns[place].tolist(), fit.used[place].tolist(), strict=True)
        friction.append({name: value for name, value, used in pairs if used})
    return Record(
        tuple(joint.name for joint in found.arm.joints),
        design.kind,
        tuple(fit.gain.tolist()),
        tuple(fit.unknowns[: 10 * layout.joints].tolist()),
        tuple(friction),
        tuple(scale.speed for scale in design.scales),
        tuple(scale.travel for scale in design.scales),
        tuple(scale.temperature for scale in design.scales),
        tuple(np.sqrt(np.mean(residuals**2, axis=0)).tolist()),
        tuple(np.abs(residuals).max(axis=0).tolist()),
        tuple(np.sqrt(np.mean(efforts**2, axis=0)).tolist()),
        design.filtering.cutoff,
    )


def read_record(path: Path) -> Record:
    """Reads what `dtwin identify --arm --out` has written.

    Raises:
        RecordingError: the file cannot be read, or is no such file.
    """
    try:
        return msgspec.toml.decode(path.read_bytes(), type=_File).model
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
    except (msgspec.MsgspecError, ValueError) as error:
        raise RecordingError(
            f"{path}: expected a file that dtwin identify LOG --arm ARM --out FILE.toml wrote: {error}"
        ) from None

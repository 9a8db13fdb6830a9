"""Margins of a controlled arm: how much it may differ from its model before the controller makes it unstable."""

from __future__ import annotations

from dataclasses import dataclass, replace

from dtwin.api.arguments import AnyPath, checked
from dtwin.api.simulation import Model, arm_of_model
from dtwin.controller.bounds import check_model
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import APPLICATION_LAW, Compensation, ControlSettings, usual_gains
from dtwin.errors import ParameterError
from dtwin.identification.store import STORE
from dtwin.parameters import ArmParameters, CellJoints, Gains, Law
from dtwin.run.cell_file import cell_of
from dtwin.simulation.margins.demands import MARGINS, Case, Demands, Shortfall, cases
from dtwin.simulation.margins.poses import POSES
from dtwin.simulation.margins.poses import poses as poses_of
from dtwin.task import DEFAULT_TASK


@dataclass(frozen=True, slots=True)
class CaseMargins:
    """The margins at one pose, with a box or without.

    Attributes:
        case: pose, mass of the box (kg) and margins.
        shortfall: the margin that falls short of the demand the most; None when all are as demanded.
    """

    case: Case
    shortfall: Shortfall | None


@dataclass(frozen=True, slots=True)
class CellMargins:
    """The margins of the arm of the cell at all poses.

    Attributes:
        cases: all poses, with a box and without, the worst first.
        demanded: what is demanded of settings before an upload.
    """

    cases: tuple[CaseMargins, ...]
    demanded: Demands

    @property
    def broken(self) -> tuple[CaseMargins, ...]:
        """The cases that have less than what is demanded, the worst first."""
        return tuple(each for each in self.cases if each.shortfall is not None)


@checked
def margins(
    *,
    law: Law = APPLICATION_LAW,
    gains: Gains | None = None,
    friction: CellJoints | None = None,
    delay: float = Compensation().delay,
    dead_zone: float = Compensation().dead_zone,
    bandwidth: float = Compensation().bandwidth,
    model: Model | None = None,
    store: AnyPath = STORE,
    box: float = ControlSettings().payload,
    late: float = 0.0,
    poses: int = POSES,
    cell_file: AnyPath | None = None,
) -> CellMargins:
    """Computes how much the arm may differ from its model before the controller makes it unstable.

    At every pose, with a box and without one, the loop of function blocks and arm is linearised at rest, as
    `dtwin margins` does.

    Args:
        law: control law: cascade, computed_torque or row_sum.
        gains: gains of the control law; None for its usual ones.
        friction: Coulomb friction of each joint that the cascade adds, N m, 0 to 5; None for that of the model.
        delay: time from a sample until its voltages act that the cascade counts on, s, 0 to 0.01.
        dead_zone: voltage lost in every amplifier that the cascade adds, V, 0 to 1.
        bandwidth: double pole of the cascade's observer, rad/s, 10 to 300.
        model: identified model of arm and controller; None for the data sheet.
        store: folder of the kept models.
        box: mass of a box, kg; 0 leaves the cases with a box out.
        late: ticks after which the arm obeys a command, at least 0.
        poses: number of poses, at least 1: the places of the cell first, then others in the whole workspace.
        cell_file: cell whose places there are: a file (*.toml), or a name of the folder cells; None for the usual.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range.
        ModelError: there is no such model.
    """
    _check_poses(poses)
    if not 0.0 <= late < float("inf"):
        raise ParameterError(f"late: expected at least 0 ticks, got {late:g}")
    task = DEFAULT_TASK if cell_file is None else cell_of(str(cell_file)).task
    arm = arm_of_model(model, store, ArmParameters())
    settings = ControlSettings(
        gains=gains or usual_gains(law),
        law=law,
        model=arm if friction is None else replace(arm, coulomb=friction),
        payload=box,
        compensation=Compensation(delay, dead_zone, bandwidth),
    )
    check_model(settings.model)
    found = cases(MotionController(), settings, arm, poses_of(poses, task), late)
    judged = [CaseMargins(case, MARGINS.shortfall(case.margins)) for case in found]
    judged.sort(key=lambda each: (each.shortfall.share if each.shortfall else 1.0, each.case.margins.disk))
    return CellMargins(tuple(judged), MARGINS)


def _check_poses(poses: int) -> None:
    if poses < 1:
        raise ParameterError(f"poses: expected at least 1, got {poses}")

"""A cell of another arm that is up: what its twin expects, and other settings for its blocks."""

from __future__ import annotations

import getpass
from dataclasses import replace
from pathlib import Path

from dtwin.api.arguments import AnyPath, checked
from dtwin.api.live import LiveCell
from dtwin.arm.model import ArmModel
from dtwin.bus.chain.messages import JointPredicted, JointQuestion, JointUpload, JointUploadRequest
from dtwin.bus.messages import ARM_PREDICT, ARM_ROLL_BACK, ARM_UPLOAD
from dtwin.bus.twin_messages import RollBackRequest
from dtwin.errors import ParameterError
from dtwin.services.runfile import join


class LiveArm(LiveCell):
    """A cell of another arm that is up; it is stopped, released and identified as any cell."""

    @checked
    def predict(
        self,
        *,
        pole: float | None = None,
        observer: float | None = None,
        speed: float | None = None,
        payload: float = 0.0,
        model: AnyPath | None = None,
    ) -> JointPredicted:
        """Asks the twin what the arm would do under other settings. Needs `dtwin up --arm NAME --simulation`.

        Args:
            pole: triple pole of the errors of every joint, rad/s; None for that in force.
            observer: double pole of the observers, rad/s; None for that in force.
            speed: speeds of paths in parts of the data sheet's; None for that in force.
            payload: mass on the tool that the blocks do not know of, kg.
            model: arm whose model the blocks get: a name of arms/ or a file (*.toml); None for that in force.

        Returns:
            What it expects beside what is in force and was measured, by joint, and the margins.

        Raises:
            CommunicationError: there is no such service, nothing has been measured, or it refuses a value.
        """
        known = _model_of(model)
        return self.bus.ask(ARM_PREDICT, JointQuestion(pole, observer, speed, payload, known), JointPredicted)

    def arm_settings(self) -> JointUpload:
        """The model and the tuning that are in force, with their version.

        Raises:
            CommunicationError: there is no simulation service, or its controller does not answer.
        """
        return self.bus.ask(ARM_UPLOAD, None, JointUpload)

    @checked
    def upload_arm(
        self,
        *,
        model: AnyPath | None = None,
        pole: float | None = None,
        observer: float | None = None,
        speed: float | None = None,
        version: int | None = None,
        based_on: int | None = None,
        why: str = "by hand",
        who: str | None = None,
    ) -> JointUpload:
        """Gives the blocks another model or tuning, which are checked on the twin and on trial.

        Args:
            model: arm whose model it is: a name of arms/ or a file (*.toml); None for that in force.
            pole: triple pole of the errors of every joint, rad/s; None for that in force.
            observer: double pole of the observers, rad/s; None for that in force.
            speed: speeds of paths in parts of the data sheet's; None for that in force.
            version: version of the history whose settings shall be in force again, alone.
            based_on: version of the settings that you have seen; None for that in force. An old one is refused.
            why: reason, for the history.
            who: name, for the history; None for the login name.

        Raises:
            ParameterError: nothing shall change, or a version is not alone.
            CommunicationError: the settings are refused, or nobody answers.
        """
        tuned = {"pole": pole, "observer": observer, "speed": speed}
        given = {name: value for name, value in tuned.items() if value is not None}
        if (model is None and not given) == (version is None):
            raise ParameterError("upload arm: expected a file, `pole`, `observer` or `speed`, or `version` alone")
        known = _model_of(model)
        now = self.arm_settings()
        seen = now.version if based_on is None else based_on
        tuning = replace(now.tuning, **given) if given else None
        request = JointUploadRequest(who or getpass.getuser(), why, seen, known, version, tuning)
        return self.bus.ask(ARM_UPLOAD, request, JointUpload)

    @checked
    def roll_back_arm(self, why: str = "by hand", *, who: str | None = None) -> JointUpload:
        """Puts the model and the tuning before those on trial into force again, at once and without a check.

        Args:
            why: reason, for the history.
            who: name, for the history; None for the login name.

        Raises:
            CommunicationError: nothing is on trial, or nobody answers.
        """
        return self.bus.ask(ARM_ROLL_BACK, RollBackRequest(who or getpass.getuser(), why), JointUpload)


def _model_of(arm: AnyPath | None) -> ArmModel | None:
    """The model of an arm that is given by name or file; None for none."""
    if arm is None:
        return None
    from dtwin.emulation.chain.arms import arm_of  # Who only asks needs no MuJoCo, which reads models of arms.

    return ArmModel.of(arm_of(str(arm)))


@checked
def connect_arm(cell: str = "cell", *, zenoh: AnyPath | None = None) -> LiveArm:
    """Joins a cell of another arm that is up, as `connect` joins one of the thesis's arm.

    Args:
        cell: name of the cell.
        zenoh: Zenoh configuration file, or a folder with `operator.json5`, for a cell on another machine.

    Raises:
        CommunicationError: the cell is not up, or its bus cannot be joined.
    """
    return LiveArm(join(cell, None if zenoh is None else Path(zenoh)))

"""Tools that ask the twin: what if, what margins, what can still be held, what would recovery do."""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import Annotated, Any, Final

import msgspec
from pydantic import Field

from dtwin.ai.marking import marked
from dtwin.ai.station import Station
from dtwin.ai.tools.arguments import Box, FaultName, Kd, Ki, Kp, TargetTime
from dtwin.bus.messages import LOOK, PREDICT
from dtwin.bus.proposals.messages import Look
from dtwin.bus.twin_messages import Predicted, PredictionRequest, Upload
from dtwin.console.calculations.tasks import Optimise, Work
from dtwin.controller.bounds import check_bounds
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError, ParameterError
from dtwin.monitoring.kinds import KINDS, parse_fault_id
from dtwin.parameters import ArmParameters, Gains, joint_vector
from dtwin.recovery.answers import answer_to
from dtwin.recovery.margins import control_settings
from dtwin.recovery.strength import RESERVE, holding
from dtwin.simulation.margins.demands import MARGINS, cases
from dtwin.simulation.margins.poses import poses

POSES: Final = 7
"""Number of poses at which margins are computed: the places of the cell and a few others."""
LONGEST: Final = 300.0
"""Time after which a search is ended, s."""


class Asking:
    """What an AI can ask the twin; nothing of it changes the cell.

    Args:
        station: where it stands.
    """

    def __init__(self, station: Station) -> None:
        self._station = station
        self._calculating = threading.Lock()

    def what_if(
        self,
        kp: Kp | None = None,
        ki: Ki | None = None,
        kd: Kd | None = None,
        target_time: TargetTime | None = None,
        assumed_box: Box | None = None,
        box: Box | None = None,
    ) -> dict[str, Any]:
        """What the twin expects of all motions of the cell with other settings, beside those in force.

        `assumed_box` is what the controller counts on, `box` what is carried. What is left out stays as it is.
        """
        now = self._now()
        gains = gains_of(now, kp, ki, kd)
        asked = PredictionRequest(gains, target_time, box=box, payload=assumed_box)
        ask = self._station.doors.ask
        return {
            "proposed": _figures(ask(PREDICT, asked, Predicted)),
            "in_force": _figures(ask(PREDICT, PredictionRequest(box=box), Predicted)),
        }

    def margins(
        self, kp: Kp | None = None, ki: Ki | None = None, kd: Kd | None = None, assumed_box: Box | None = None
    ) -> dict[str, Any]:
        """How much the arm may differ from its model before the loop is unstable: the worst of several poses.

        `short` says what falls below what is demanded of settings before an upload, "" if nothing does.
        """
        now, task = self._now(), self._station.hub.task
        with self._one():
            settings = self._settings(now, gains_of(now, kp, ki, kd), assumed_box)
            found = cases(MotionController(), settings, settings.model, poses(POSES, task), 0.0)
            worst = min(found, key=lambda case: case.margins.disk)
            short = [lack.text for case in found if (lack := MARGINS.shortfall(case.margins)) is not None]
        return {
            "pose": marked(pose) if (pose := worst.pose.name) in task.all_places else pose,
            "disk": marked(worst.margins.disk),
            "gain_db": marked(worst.margins.gain),
            "phase_degrees": marked(min(worst.margins.phase)),
            "delay_ticks": marked(worst.margins.delay),
            "short": short[0] if short else "",
        }

    def can_hold(self, box: Box) -> dict[str, Any]:
        """Where the arm, as the controller's model knows it, can hold a box at rest, and with how much voltage."""
        arm = self._now().model
        shares = holding(arm, box, self._station.hub.task)
        return {
            "share_of_voltage": marked(shares),
            "cannot_hold_at": [marked(place) for place, share in shares.items() if share > 1.0 - RESERVE],
        }

    def recovery_answer(self, parameter: FaultName) -> dict[str, Any]:
        """What recovery would do about a finding: the measure, why, what may come of it, what a person has to do."""
        fault = parse_fault_id(parameter)
        if fault.kind not in KINDS:
            raise ParameterError(f"parameter {parameter}: expected what a finding names; see `findings`")
        answer = answer_to(fault)
        return {
            "measure": answer.measure,
            "why": answer.why,
            "outcomes": list(answer.outcomes),
            "order": answer.order.format(joint=fault.joint or "of the arm"),
        }

    def optimise(
        self,
        candidates: Annotated[int, Field(ge=80, le=400, description="Number of settings to judge")] = 120,
        fastest: TargetTime = 1.0,
        slowest: TargetTime = 4.0,
    ) -> dict[str, Any]:
        """Searches gains and target time on the twin, at low priority; takes some seconds to a minute."""
        now = self._now()
        work = Work(
            Optimise(now.gains, now.target_time, fastest, slowest, candidates),
            str(self._station.files.store),
            law=now.law,
            model=now.model,
            box=now.payload,
            cell=self._station.hub.task,
        )
        with self._one():
            return {"found": _said(work)}

    def _now(self) -> Upload:
        return self._station.doors.ask(LOOK, None, Look).settings

    def _settings(self, now: Upload, gains: Gains | None, box: float | None) -> ControlSettings:
        arm: ArmParameters = now.model
        changed = msgspec.structs.replace(
            now, gains=gains or now.gains, payload=now.payload if box is None else box, model=arm
        )
        settings = control_settings(changed, None)
        check_bounds(settings)
        return settings

    def _one(self) -> _Turn:
        return _Turn(self._calculating)


class _Turn:
    """One calculation at a time: another one is refused, so that the machine has time for the cell."""

    def __init__(self, lock: threading.Lock) -> None:
        self._lock = lock

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise ParameterError("a calculation is under way: expected one at a time")

    def __exit__(self, *_: object) -> None:
        self._lock.release()


def gains_of(now: Upload, kp: list[float] | None, ki: list[float] | None, kd: list[float] | None) -> Gains | None:
    """The gains in force with those that are given; None if none are."""
    if kp is None and ki is None and kd is None:
        return None
    return Gains(
        now.gains.kp if kp is None else joint_vector(kp),
        now.gains.ki if ki is None else joint_vector(ki),
        now.gains.kd if kd is None else joint_vector(kd),
    )


def _figures(predicted: Predicted) -> dict[str, Any]:
    motions = predicted.motions
    return {
        "version": predicted.version,
        "farthest_from_path_rad": [marked(max(each.tracking[joint] for each in motions)) for joint in range(3)],
        "peak_volts": [marked(max(each.peak_volts[joint] for each in motions)) for joint in range(3)],
        "saturated_share": marked(max(each.saturated for each in motions)),
        "motions": len(motions),
    }


def _said(work: Work) -> Any:
    """The result of a calculation in a process of its own.

    Raises:
        CommunicationError: it has failed or takes too long.
    """
    command = ["nice", "-n", "10", sys.executable, "-m", "dtwin.console.calculations.work"]
    try:
        done = subprocess.run(
            command, input=msgspec.json.encode(work) + b"\n", capture_output=True, timeout=LONGEST, check=False
        )
    except subprocess.TimeoutExpired:
        raise CommunicationError(f"the calculation took more than {LONGEST:g} s: ask for fewer candidates") from None
    lines: list[dict[str, Any]] = [msgspec.json.decode(line) for line in done.stdout.splitlines()]
    said: dict[str, Any] = lines[-1] if lines else {"error": "the calculation ended without a result"}
    if said.get("error"):
        raise CommunicationError(said["error"])
    result = said.get("result") or {}
    return {name: result[name] for name in ("best", "reference", "broken", "judged") if name in result}

"""Tools that act, within limits, through the doors that people have: checks, trial, rollback."""

from __future__ import annotations

from typing import Any

import msgspec

from dtwin.ai.answering import IDLE, Answering
from dtwin.ai.marking import from_plant, marked
from dtwin.ai.profiles import Allowance
from dtwin.ai.station import Station
from dtwin.ai.tools.arguments import (
    Box,
    FaultName,
    FaultNames,
    Kd,
    Ki,
    Kp,
    ModelName,
    TargetTime,
    Version,
    Why,
)
from dtwin.ai.tools.propose import change_of, check_findings, others_of
from dtwin.bus.messages import ACKNOWLEDGE, LOOK, ROLL_BACK, UPLOAD, StopRequest
from dtwin.bus.proposals.messages import Look
from dtwin.bus.stopping import stop
from dtwin.bus.twin_messages import AcknowledgeRequest, MonitoringVerdict, RollBackRequest, Upload, UploadRequest


class Acting:
    """What an AI can do itself.

    Args:
        station: where it stands.
        allowance: what and how often.
        answering: answers findings.
    """

    def __init__(self, station: Station, allowance: Allowance, answering: Answering) -> None:
        self._station = station
        self._allowance = allowance
        self._answering = answering

    def change_settings(
        self,
        why: Why,
        based_on: Version,
        kp: Kp | None = None,
        ki: Ki | None = None,
        kd: Kd | None = None,
        target_time: TargetTime | None = None,
        assumed_box: Box | None = None,
        model: ModelName | None = None,
    ) -> dict[str, Any]:
        """Uploads gains with or without a target time, or alone a model or the mass of a box.

        They are checked on the twin, then on trial, and taken back when the arm does worse than expected. Offsets of
        encoders come by `answer_findings` alone, as measured: a trial cannot see a wrong one.
        """
        now = self._station.doors.ask(LOOK, None, Look).settings
        change = change_of(self._station, now, why, based_on, (kp, ki, kd), target_time)
        change = msgspec.structs.replace(change, **others_of(self._station, assumed_box, model, None))
        self._check_step(now, change)
        self._allowance.count()
        return _outcome(self._station.doors.ask(UPLOAD, change, Upload))

    def roll_back(self, why: Why) -> dict[str, Any]:
        """Takes back the settings on trial at once."""
        return _outcome(self._station.doors.ask(ROLL_BACK, RollBackRequest(self._station.who, why), Upload))

    def answer_findings(self, parameters: FaultNames) -> dict[str, Any]:
        """Has settled findings that ask for one measure answered as recovery does; ask `answers` what came of it."""
        check_findings(parameters)
        self._allowance.count()
        return {"measure": self._answering.ask(parameters), "number": len(self._answering.answers) + 1}

    def answers(self) -> dict[str, Any]:
        """Whether an answer is under way, and what came of those before. Some ask you to stop the arm.

        Outcomes: done, nothing to do, taken back, too weak, too doubtful, interrupted, failed.
        """
        return {
            "busy": self._answering.busy,
            "doing": "an answer is under way" if self._answering.busy else IDLE,
            "answers": [
                {
                    "parameters": list(each.parameters),
                    "measure": each.measure,
                    "outcome": each.outcome,
                    "text": from_plant(each.text),
                    "values": {name: marked(value) for name, value in each.taken.values.items()},
                }
                for each in self._answering.answers[-20:]
            ],
        }

    def acknowledge(self, why: Why, parameter: FaultName) -> dict[str, Any]:
        """Has the monitor take the arm as it is to be normal, as far as one finding goes."""
        check_findings([parameter])
        self._allowance.count()
        verdict = self._station.doors.ask(ACKNOWLEDGE, AcknowledgeRequest(parameter), MonitoringVerdict)
        return {"units": {name: unit.state for name, unit in verdict.units.items()}}

    def stop(self, why: Why) -> dict[str, Any]:
        """Stops the arm safely, with its box held. Always allowed; no limit counts it. A person releases the arm."""
        stopped = stop(self._station.doors.bus, StopRequest(self._station.who, why))
        self._answering.desk.stopped = True
        return {"stop": stopped.state.stop, "trouble": from_plant(stopped.trouble)}

    def _check_step(self, now: Upload, change: UploadRequest) -> None:
        allowance = self._allowance
        if change.gains is not None:
            allowance.check_gains(now.gains, change.gains)
        if change.target_time is not None:
            allowance.check_step("target_time", now.target_time, change.target_time)
        if change.payload is not None:
            allowance.check_step("assumed_box", now.payload, change.payload)


def _outcome(done: Upload) -> dict[str, Any]:
    return {"version": done.version, "action": done.action, "on_trial": done.on_trial, "text": marked(done.text)}

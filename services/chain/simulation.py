"""Gives the running blocks of an arm of n joints another model or tuning: checked on the twin, on trial, versioned.

What the blocks have forgotten, because others are in their place, is given to them again.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from dtwin.arm.model import ArmModel, ArmSettings
from dtwin.bus.chain.messages import (
    JointAdjustment,
    JointModel,
    JointPredicted,
    JointQuestion,
    JointTick,
    JointTicks,
    JointUpload,
    JointUploadRequest,
)
from dtwin.bus.messages import ADJUSTED, ARM_PREDICT, ARM_UPLOAD, JOINT_TICKS, MODEL
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.parts.readiness.preparation import prepare
from dtwin.services.parts.uploading.uploading import RETRY, BridgePort, Uploading
from dtwin.services.service import Link, Service, main
from dtwin.simulation.chain.checks import as_before, expected_tracking
from dtwin.simulation.chain.history import ArmEntry, ArmHistory
from dtwin.simulation.chain.predicting import Predicting
from dtwin.simulation.history import HISTORY
from dtwin.simulation.trial import TrialRules
from dtwin.simulation.upload import Uploader

NAME: Final = "simulation"
RULES: Final = TrialRules(longest=30.0, measured_start=False)
"""A trial lasts at least 10 s and until a whole way has been judged; at most 30 s where an arm never rests."""
PATIENCE: Final = 10.0
"""Longest wait of an upload until an arm that has just begun was measured, s."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Upload models and tunings to the blocks of a running arm."""

    history: Path = HISTORY
    """File for the history of the settings."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            Simulation(service, settings, ArmHistory(self.history)).run()
        return 0


class _Mark:
    """Stands in the inbox behind the ticks that came before a change."""


class Simulation:
    """One upload after another.

    Args:
        service: frame of the service.
        settings: run of the arm.
        history: history of the settings.
    """

    def __init__(self, service: Service, settings: ChainSettings, history: ArmHistory) -> None:
        self._service = service
        self._settings = settings
        self._history = history
        self._sheet = ArmSettings(ArmModel.of(settings.arm), settings.control.tuning)
        self._offset = (0.0,) * len(settings.arm)
        self._time = 0.0
        self._marks = 0
        bus = service.bus
        self._uploading = Uploading(service, ArmSettings, lambda: self._time, _message, self._mark)
        bus.subscribe(JOINT_TICKS, JointTicks, service.inbox.put)
        bus.subscribe(ADJUSTED, JointAdjustment, service.inbox.put)
        self._uploading.answer(ARM_UPLOAD, self._answer)
        self._predicting = Predicting(settings)
        bus.answer(ARM_PREDICT, JointQuestion, self._predict, lambda: self._predict(JointQuestion()))

    def run(self) -> None:
        """Works until it is asked to end."""
        service, uploading = self._service, self._uploading
        prepare(service, [("the checks of settings", partial(self._expected, self._sheet, self._sheet))])
        port = BridgePort(service.bus, MODEL, JointModel, _settings_of, _request)
        uploading.find(lambda: Uploader(port, self._history, self._expected, RULES, forgotten=self._sheet))
        service.ready()
        while not service.stopping:
            item = service.next(RETRY)
            if isinstance(item, JointTicks):
                self._judge(item)
            elif isinstance(item, JointAdjustment):
                self._offset = item.offset
            elif isinstance(item, _Mark):
                with uploading.lock:
                    self._marks -= 1
            if service.report_due():
                uploading.look_again()
                service.report("running", uploading.done, time=self._time)

    def _predict(self, question: JointQuestion) -> JointPredicted:
        """Answers on a thread of its own, beside everything else: nothing is changed."""
        last = self._uploading.there().last
        return self._predicting.answer(question, last.version, last.settings)

    def _expected(self, wished: ArmSettings, now: ArmSettings) -> tuple[float, ...]:
        """The distances from the path that are expected with other settings than those in force.

        Raises:
            ParameterError: they must not be uploaded.
        """
        expected, measured = expected_tracking(self._settings, wished), self._predicting.measured
        if measured is None or wished.model != now.model:
            return expected
        return as_before(expected, expected_tracking(self._settings, now), measured)

    def _judge(self, passed: JointTicks) -> None:
        self._predicting.receive(passed)
        self._time = passed.ticks[-1].sensors.time
        for tick in passed.ticks:
            if len(tick.sensors.theta) != len(self._offset):
                return
            self._uploading.judge(partial(self._observe, tick))

    def _observe(self, tick: JointTick, uploader: Uploader[ArmSettings, ArmEntry]) -> ArmEntry | None:
        if self._marks:
            return None
        sensors = tick.sensors
        if tick.acted.sequence != sensors.sequence:  # a command for an earlier sample acts on
            return uploader.miss(sensors.time)
        measured = tuple(a - b for a, b in zip(sensors.theta, self._offset, strict=True))
        return uploader.observe(sensors.time, tick.acted.target, measured)

    def _answer(self, asked: JointUploadRequest) -> JointUpload:
        """Answers on a thread of its own: a check may take longer than a tick."""
        if "model" not in self._uploading.proposal(asked).change.values:
            # How far the arm is off its path now says what to expect of it under other gains.
            self._predicting.await_measured(PATIENCE)
        return self._uploading.upload(asked)

    def _mark(self) -> None:
        """Leaves out of a trial what waits in the inbox, which is of the settings before."""
        self._marks += 1
        self._service.inbox.put(_Mark())


def _settings_of(told: JointModel) -> ArmSettings:
    return ArmSettings(told.model, told.tuning)


def _request(group: tuple[str, ...], settings: ArmSettings, who: str, why: str) -> JointModel:
    return JointModel(who, why, settings.model, settings.tuning)


def _message(uploader: Uploader[ArmSettings, ArmEntry]) -> JointUpload:
    last = uploader.last
    text = last.text or last.why
    return JointUpload(
        last.version,
        last.time,
        last.action,
        text,
        uploader.trial is not None,
        last.model,
        last.predicted,
        last.measured,
        last.tuning,
    )


if __name__ == "__main__":
    sys.exit(main(NAME, Options))

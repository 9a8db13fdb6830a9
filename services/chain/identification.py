"""Identifies a running arm of n joints from the motion that passes: an operator asks, and decides what is kept.

Ticks are remembered as the blocks counted on them: without the offsets of encoders, and with the strengths of drives
that the twin has told them. So what is found is what they reckon with besides.
"""

from __future__ import annotations

import logging
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Array
from dtwin.arm.file import ArmFile, file_of
from dtwin.bus.chain.messages import JointAdjustment, JointTick, JointTicks, JointUpload, JointUploadRequest
from dtwin.bus.messages import (
    ADJUSTED,
    ARM_UPLOAD,
    DECIDE,
    IDENTIFY,
    JOINT_TICKS,
)
from dtwin.bus.twin_messages import Estimated, IdentificationDecision, IdentificationRequest, IdentificationState
from dtwin.errors import CommunicationError, DtwinError, IdentificationError, ParameterError
from dtwin.identification.chain.identify import Identification, Sample, identify
from dtwin.identification.chain.result import NINETY_FIVE, numbers
from dtwin.identification.live.kept import keep
from dtwin.identification.live.running import doubts_of, measurement_of, model_without
from dtwin.identification.store import STORE
from dtwin.run.chain import ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.chain.ticks import Rows
from dtwin.services.parts.identifying.progress import Progress
from dtwin.services.service import Link, Service, main

log = logging.getLogger(__name__)

NAME: Final = "identification"
NEEDED: Final = 30.0
"""Time in which it is known what the arm carries, from which it is identified, s."""
REMEMBERED: Final = 120.0
"""Longest time that is remembered, s."""
PATIENCE: Final = 120.0
"""Longest wait for so much motion, s of the clock."""
AT_ONCE: Final = 20
"""Ticks that are taken together."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Identify the arm of a running cell when an operator asks."""

    store: Path = STORE
    """Folder of the kept arms."""

    def run(self) -> int:
        settings = self.settings()
        with Service(NAME, self) as service:
            Identifying(service, settings, file_of(self.kind), self.store).run()
        return 0


class Motion:
    """The last motion of an arm without a gap.

    Args:
        settings: run of the arm.
    """

    def __init__(self, settings: ChainSettings) -> None:
        self._rows = Rows(settings.arm, settings.late)
        self._most = round(REMEMBERED / (settings.arm.period * AT_ONCE))
        self._blocks: list[tuple[Array, Array, Array, Array]] = []

    def add(self, tick: JointTick) -> None:
        """Takes a tick; what was before a gap, or of another run, is forgotten."""
        if self._rows.add(tick):
            self._blocks = []

    def gather(self) -> bool:
        """Keeps what has come, once that is enough; whether it was. The oldest is forgotten."""
        if len(self._rows) < AT_ONCE:
            return False
        self._blocks.append(self._rows.drain()[:4])
        del self._blocks[: max(0, len(self._blocks) - self._most)]
        return True

    def since(self, time: float) -> tuple[Array, Array, Array, Array]:
        """Times (N,), readings, targets and efforts (N, n), NaN while the gripper is closed, from a time (s) on."""
        if not self._blocks:
            nothing: Array = np.zeros(0)
            return nothing, nothing, nothing, nothing
        t, q, target, effort = (np.concatenate(column) for column in zip(*self._blocks, strict=True))
        after = t >= time
        return t[after], q[after], target[after], effort[after]


class Identifying:
    """One identification after another, each from request to decision.

    Args:
        service: frame of the service.
        settings: run of the arm.
        known: what the arm's file says.
        store: folder of the kept arms.
    """

    def __init__(self, service: Service, settings: ChainSettings, known: ArmFile, store: Path) -> None:
        self._service = service
        self._settings = settings
        self._known = known
        self._store = store
        self._adjustment = Adjustment.none(len(settings.arm))
        self._time = self._deadline = 0.0
        self._request = IdentificationRequest()
        self._found: Identification | None = None
        self._finished = 0
        self._motion = Motion(settings)
        bus = service.bus
        self._progress = progress = Progress(bus)
        bus.subscribe(JOINT_TICKS, JointTicks, service.inbox.put)
        bus.subscribe(ADJUSTED, JointAdjustment, service.inbox.put)
        bus.answer(IDENTIFY, IdentificationRequest, self._ask, lambda: progress.state)
        bus.answer(DECIDE, IdentificationDecision, self._decide, lambda: progress.state)

    def run(self) -> None:
        """Works until it is asked to end."""
        service = self._service
        service.ready()
        while not service.stopping:
            item = service.next(0.2)
            try:
                if isinstance(item, JointTicks):
                    self._on_ticks(item)
                elif isinstance(item, JointAdjustment):
                    self._adjust(item)
                elif isinstance(item, IdentificationRequest):
                    self._request, self._found = item, None
                    self._deadline = time.monotonic() + PATIENCE
                    self._look()
                state = self._progress.state
                if state.phase == "measuring" and time.monotonic() > self._deadline > 0.0:
                    raise IdentificationError(f"{state.text}, and there it stopped: does the arm move?")
            except DtwinError as error:
                self._enter(IdentificationState("refused", str(error)[:1000]))
            if service.report_due():
                service.report("running", self._finished, time=self._time)

    def _adjust(self, message: JointAdjustment) -> None:
        """Begins anew where the blocks count on something else: it was an arm that changed."""
        now = message.adjustment
        if len(now.offset) == len(self._settings.arm) and now != self._adjustment:
            self._adjustment = now
            self._motion = Motion(self._settings)

    def _on_ticks(self, passed: JointTicks) -> None:
        for tick in passed.ticks:
            if len(tick.sensors.theta) != len(self._settings.arm):
                return
            self._motion.add(tick)
            self._time = tick.sensors.time
        if self._motion.gather() and self._progress.state.phase == "measuring" and self._deadline:
            self._look()

    def _ask(self, request: IdentificationRequest) -> IdentificationState:
        """Answers on Zenoh's thread; the work is the main thread's."""
        self._progress.ensure_free()
        source = "motion" if request.source == "usual" else request.source
        if source != "motion" or request != IdentificationRequest(source=request.source, since=request.since):
            raise ParameterError(
                "an arm of n joints is identified whole, from its own motion: expected no --source but motion, no "
                "--free, --box-mass and no --anew"
            )
        self._deadline = 0.0
        state = self._progress.request("waits for the motion")
        self._service.inbox.put(request)
        return state

    def _look(self) -> None:
        """Identifies the arm once enough has passed."""
        t, q, target, effort = self._motion.since(self._request.since)
        needed = round(NEEDED / self._settings.arm.period)
        known = int(np.isfinite(effort).all(axis=-1).sum()) if len(t) else 0
        if known < needed:
            text = "the arm is watched" if known == len(t) else "the arm is watched while its gripper is open"
            seen = IdentificationState("measuring", text, known, needed)
            if (seen.samples // 100) != (self._progress.state.samples // 100) or self._progress.state.of != needed:
                self._enter(seen)
            return
        self._enter(IdentificationState("estimating", "the model is fitted", known, known))
        measured = measurement_of(self._settings.arm, self._adjustment, t, q, target, effort)
        self._propose(identify(self._settings.arm, [Sample(measured)]))

    def _propose(self, found: Identification) -> None:
        self._found = found
        self._finished += 1
        fit = tuple(1.0 - error for error in found.held_out[found.groups].tolist())
        told = [row for row in numbers(found) if row.told]
        names = {joint.name: f"joint {k}" for k, joint in enumerate(found.arm.joints, 1)}
        names |= {link.name: f"link {k}" for k, link in enumerate(found.arm.links, 1)}
        left = sum(1 for row in numbers(found) if not row.told)
        self._enter(
            msgspec.structs.replace(
                self._progress.state,
                phase="proposed",
                text=f"{len(told)} numbers are told by the motion; {left} stay as they were known",
                converged=True,
                rank=len(told),
                parameters={_short(row.name, names): Estimated(row.value, row.half / NINETY_FIVE) for row in told},
                fit=fit,
                doubts=doubts_of(found, self._settings.arm)[:1000],
            )
        )

    def _decide(self, decision: IdentificationDecision) -> IdentificationState:
        def kept(found: Identification) -> tuple[Path, str]:
            path = keep(found, self._known, self._store, decision.name)
            return path, f"kept as {path}"

        return self._progress.decide(decision, self._found, kept, self._upload, self._time)

    def _upload(self, found: Identification, why: str) -> str:
        """What became of the model in the blocks; it is kept in any case."""
        bus, model = self._service.bus, model_without(found, self._adjustment)
        try:
            seen = bus.ask(ARM_UPLOAD, None, JointUpload).version
            answer = bus.ask(ARM_UPLOAD, JointUploadRequest(NAME, why[:1000], seen, model), JointUpload)
        except CommunicationError as error:
            log.warning("%s", error)
            return f"not uploaded: {error}"
        return f"on trial in the blocks as version {answer.version} of their settings"

    def _enter(self, state: IdentificationState) -> None:
        self._progress.enter(state, self._time)


def _short(name: str, names: dict[str, str]) -> str:
    """A name that begins with the number of the joint or link, as any length would not pass on the bus."""
    owner = next((each for each in sorted(names, key=len, reverse=True) if name.startswith(f"{each} ")), "")
    return f"{names[owner]}{name.removeprefix(owner)}"[:32] if owner else name[:32]


if __name__ == "__main__":
    sys.exit(main(NAME, Options))

"""A cell that is up, as its operator sees and commands it."""

from __future__ import annotations

import getpass
import itertools
import logging
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Condition
from typing import Final

from dtwin.api.arguments import AnyPath, Texts, checked
from dtwin.bus.messages import (
    DECIDE,
    FAULT,
    RELEASE,
    ROLL_BACK,
    SENSORS,
    SUMMARY,
    UPLOAD,
    VOLTAGES,
    Done,
    FaultRequest,
    ReleaseRequest,
    StopRequest,
    StopState,
    Summary,
)
from dtwin.bus.proposals.identifying import identified
from dtwin.bus.session import Bus
from dtwin.bus.stopping import Stopped, stop
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import (
    DataSource,
    IdentificationDecision,
    IdentificationRequest,
    IdentificationState,
    RollBackRequest,
    Upload,
    UploadRequest,
)
from dtwin.errors import CommunicationError, ParameterError, UnansweredError
from dtwin.parameters import PERIOD, ArmParameters, CellJoints, Gains, Law, joint_vector
from dtwin.services.runfile import join
from dtwin.signals import Sensors, Voltages
from iec61499.net.sockets import Closing

log = logging.getLogger(__name__)

_WHY = "by hand"
SAMPLES: Final = 9
"""Number of samples that the velocity of a running arm is taken from."""
_PATIENCE: Final = 5.0
"""Time in which a command of the controller has to come, s."""


@dataclass(frozen=True, slots=True)
class ArmState:
    """How a running arm is.

    Attributes:
        time: plant time of the last sample, s.
        theta: its angles, rad.
        omega: its velocities from the last samples, rad/s.
        holds_box: whether it holds a box, as its controller says.
    """

    time: float
    theta: CellJoints
    omega: CellJoints
    holds_box: bool


class LiveCell(Closing):
    """A cell that is up; a context manager that leaves it at its end. The cell goes on.

    Attributes:
        bus: the bus of the cell.
        missed: number of samples that came while nobody took them from the iterators, which hold a bounded number.
    """

    def __init__(self, bus: Bus) -> None:
        self.bus = bus
        self.missed = 0

    def close(self) -> None:
        """Leaves the cell; its iterators end."""
        self.bus.close()

    @checked
    def samples(self, count: int | None = None, *, bound: int = 1000, patience: float = 5.0) -> Iterator[Sensors]:
        """The samples of the arm as they come: tick, plant time (s), angles (rad), gripper (rad), box.

        Args:
            count: number of samples after which the iterator ends, at least 0; None goes on.
            bound: number of samples that wait to be taken, at least 1; of more the oldest are lost and counted in
                `missed`.
            patience: time that a sample may take to come, s, above 0.

        Raises:
            ParameterError: an argument is of another kind or out of range.
            CommunicationError: no sample came in time.
        """
        if count is not None and count < 0:
            raise ParameterError(f"count: expected at least 0, got {count}")
        if bound < 1:
            raise ParameterError(f"bound: expected at least 1, got {bound}")
        if not 0.0 < patience < float("inf"):
            raise ParameterError(f"patience: expected a time above 0 s, got {patience:g}")
        return self._samples(count, bound, patience)

    def _samples(self, count: int | None, bound: int, patience: float) -> Iterator[Sensors]:
        waiting: deque[Sensors] = deque(maxlen=bound)
        arrived = Condition()

        def collect(sample: Sensors) -> None:
            with arrived:
                self.missed += len(waiting) == bound
                waiting.append(sample)
                arrived.notify()

        subscription = self.bus.subscribe(SENSORS, Sensors, collect)
        try:
            for _ in itertools.count() if count is None else range(count):
                with arrived:
                    if not arrived.wait_for(lambda: len(waiting) > 0, patience):
                        raise CommunicationError(f"no samples of the arm within {patience:g} s; is the cell working?")
                    sample = waiting.popleft()
                yield sample
        finally:
            subscription.end()

    def arm_state(self) -> ArmState:
        """Where the arm is now, how fast it is, and whether it holds a box.

        Raises:
            CommunicationError: samples or commands do not come in time.
        """
        import numpy as np  # Who only asks or waits needs no library of numbers.

        last: list[Sensors] = []
        for sample in self.samples():
            last = [*last, sample] if last and sample.sequence == last[-1].sequence + 1 else [sample]
            if len(last) == SAMPLES:
                break
        # A parabola through several samples: a difference of two would show the encoders' noise.
        times = PERIOD * np.arange(1 - len(last), 1)
        angles = np.array([sample.theta for sample in last])
        omega = joint_vector(np.polyfit(times, angles, 2)[1])
        return ArmState(last[-1].time, last[-1].theta, omega, self._holds_box())

    def _holds_box(self) -> bool:
        commands: SimpleQueue[Voltages] = SimpleQueue()
        subscription = self.bus.subscribe(VOLTAGES, Voltages, commands.put)
        try:
            return commands.get(timeout=_PATIENCE).box_gripped
        except Empty:
            raise CommunicationError(
                f"no commands of the controller within {_PATIENCE:g} s; is the cell working?"
            ) from None
        finally:
            subscription.end()

    def summary(self) -> Summary:
        """How the services do, and what the emulator says of the run.

        Raises:
            CommunicationError: nobody answers.
        """
        return self.bus.ask(SUMMARY, None, Summary)

    def settings(self) -> Upload:
        """The settings of the controller that are in force, with their version. Needs `dtwin up --simulation`.

        Raises:
            CommunicationError: the cell has no such service, or its controller does not answer.
        """
        return self._settings(UPLOAD, None)

    @checked
    def stop(self, why: str = _WHY, *, who: str | None = None) -> StopState:
        """Stops the arm: it brakes and is held until `release`. This is no emergency stop.

        Returns once what the cell publishes shows the stop. If the function blocks cannot be asked, the emulator is
        told to take the torque off, which a warning of the log says.

        Args:
            why: reason, for the events.
            who: name, for the events; None for the login name.

        Raises:
            CommunicationError: the arm may not be stopped: nobody answers, or nothing shows the stop.
        """
        stopped = self.stop_by_any_way(why, who=who)
        if stopped.trouble:
            log.warning("the torque is off, because: %s", stopped.trouble)
        return stopped.state

    def stop_by_any_way(self, why: str = _WHY, *, who: str | None = None) -> Stopped:
        """Stops the arm as `stop` does, and tells why the first way did not do, if it did not.

        Args:
            why: reason, for the events.
            who: name, for the events; None for the login name.

        Raises:
            CommunicationError: the arm may not be stopped: nobody answers, or nothing shows the stop.
        """
        return stop(self.bus, StopRequest(who or getpass.getuser(), why))

    @checked
    def inject(self, fault: str, *, after: float = 0.0) -> Done:
        """Lets a fault happen to the emulated arm.

        Args:
            fault: as for `dtwin run --fault`; one whose start has passed begins now.
            after: plant time from now until a fault without @START begins, s, at least 0.

        Raises:
            ParameterError: `after` is below 0 or not finite, or the fault has a start of its own beside it.
            CommunicationError: the fault cannot be read or is one too many, or nobody answers.
        """
        if not 0.0 <= after < float("inf") or (after and "@" in fault):
            raise ParameterError(f"after: expected a time of at least 0 s for a fault without @START, got {after:g}")
        if "@" not in fault:
            start = next(self.samples(1)).time + after if after else 0.0
            fault = f"{fault}@{start:.2f}"
        return self.bus.ask(FAULT, FaultRequest((fault,)), Done)

    @checked
    def release(self, why: str = _WHY, *, who: str | None = None) -> StopState:
        """Lets a stopped arm move again; while it brakes it stays stopped.

        Args:
            why: reason, for the events.
            who: name, for the events; None for the login name.

        Raises:
            CommunicationError: nobody answers.
        """
        return self.bus.ask(RELEASE, ReleaseRequest(who or getpass.getuser(), why), StopState)

    @checked
    def upload(
        self,
        *,
        gains: Gains | AnyPath | None = None,
        law: Law | None = None,
        kp: CellJoints | None = None,
        ki: CellJoints | None = None,
        kd: CellJoints | None = None,
        target_time: float | None = None,
        model: ArmParameters | AnyPath | None = None,
        set: Texts | Mapping[str, float] = (),
        version: int | None = None,
        arm: ArmParameters | AnyPath | None = None,
        store: AnyPath | None = None,
        based_on: int | None = None,
        why: str = _WHY,
        who: str | None = None,
    ) -> Upload:
        """Gives the controller other settings, which are checked on the twin and on trial. Needs `up --simulation`.

        Args:
            gains: gains of the control law, or the file in which `dtwin optimise` has saved them and a target time.
            law: law that gains are of, which refuses them under another one; None for that of the file, or in force.
            kp: proportional gains of joints 1 to 3, 1/s^2; None for those of `gains`, or in force.
            ki: integral gains, 1/s^3.
            kd: derivative gains, 1/s.
            target_time: duration of every motion from the next one on, s.
            model: the arm that the controller shall believe in, or file or name in `store` of an identified model.
            set: parameters of it in SI units, `{"m1": 0.12}` or `"m1=0.12"`; others as in `model`, or in force.
            version: version of the history whose settings shall be in force again, alone; so is a model.
            arm: the arm of the check, told like `model`; None for the one that the service knows.
            store: folder of the kept models; None for `identified`.
            based_on: version of the settings that you have seen; None for that in force. An old one is refused.
            why: reason, for the history.
            who: name, for the history; None for the login name.

        Raises:
            ParameterError: nothing shall change, or an argument is of another kind.
            ModelError: a file or a model cannot be read.
            CommunicationError: the settings are refused, or nobody answers.
        """
        from dtwin.api.kept.settings import known_arm, wished_model, wished_tuning  # Who stops an arm needs no files.

        now = self.settings()
        wished = wished_tuning(gains, {"kp": kp, "ki": ki, "kd": kd}, now.gains, law, target_time)
        believed = wished_model(known_arm(model, store), set, now.model)
        if not wished and believed is None and version is None:
            raise ParameterError("upload: expected gains, target_time or model, or a version")
        seen, checked_on = now.version if based_on is None else based_on, known_arm(arm, store)
        values = {**wished, "model": believed, "version": version, "arm": checked_on}
        return self.send(UploadRequest(who or getpass.getuser(), why, seen, **values))

    def send(self, request: UploadRequest) -> Upload:
        """Sends a request for other settings as it is.

        Args:
            request: the message UploadRequest of docs/zenoh.md.

        Raises:
            CommunicationError: the settings are refused, or nobody answers.
        """
        return self._settings(UPLOAD, request)

    @checked
    def identify(
        self,
        *,
        free: str = IdentificationRequest().free,
        box_mass: float | None = None,
        source: DataSource = "usual",
        since: float = 0.0,
        anew: str = "",
        patience: float = 60.0,
        progress: Callable[[IdentificationState], None] = lambda state: None,
    ) -> IdentificationState:
        """Has the arm identified, as `dtwin identify live` does; `decide` keeps the model or not.

        Args:
            free: what to estimate; without a known load something must set the scale of the forces: by default K1.
            box_mass: mass that a box in the gripper is taken to have, kg; None for the middle of the cell's boxes.
            source: signal: the blocks excite the arm; motion: the arm goes on working, and its motions tell what has
                changed; usual: the signal, and motion for another arm than the thesis's.
            since: plant time from which on motion counts, s.
            anew: which of the free parameters are not known any more; "" for all.
            patience: time in which there must be a model, s.
            progress: is told every state on the way.

        Returns:
            The state with the proposed model: parameters with standard errors, fit, doubts.

        Raises:
            CommunicationError: there is no such service (`dtwin up --identification`), or no model in time.
            IdentificationError: the data are too poor, or do not come.
        """
        request = IdentificationRequest(free, box_mass, source, since, anew)
        return identified(self.bus, request, patience, progress)

    @checked
    def decide(
        self, accept: bool, *, name: str = "arm", upload: bool = False, anyway: bool = False
    ) -> IdentificationState:
        """Decides whether the model that `identify` proposes is kept.

        Args:
            accept: whether it is kept.
            name: name to keep it under.
            upload: whether it is uploaded to the controller, too; needs `dtwin up --simulation`.
            anyway: whether a model that is in doubt is kept all the same.

        Raises:
            CommunicationError: no model waits for a decision, it is in doubt, or nobody answers.
        """
        return self.bus.ask(DECIDE, IdentificationDecision(accept, name, upload, anyway), IdentificationState)

    @checked
    def roll_back(self, why: str = _WHY, *, who: str | None = None) -> Upload:
        """Puts the settings before those on trial into force again, at once and without a check.

        Args:
            why: reason, for the history.
            who: name, for the history; None for the login name.

        Raises:
            CommunicationError: nothing is on trial, or nobody answers.
        """
        return self._settings(ROLL_BACK, RollBackRequest(who or getpass.getuser(), why))

    def _settings(self, topic: Topic, request: UploadRequest | RollBackRequest | None) -> Upload:
        try:
            return self.bus.ask(topic, request, Upload)
        except UnansweredError as error:
            raise CommunicationError(f"{error} Settings go through that service: dtwin up --simulation") from None


@checked
def connect(cell: str = "cell", *, zenoh: AnyPath | None = None) -> LiveCell:
    """Joins a cell that is up, as `dtwin status`, `watch`, `stop` and `upload` do.

    Args:
        cell: name of the cell.
        zenoh: Zenoh configuration file, or a folder with `operator.json5`, for a cell on another machine; None for a
            cell that `dtwin up` has started on this one.

    Raises:
        CommunicationError: the cell is not up, or its bus cannot be joined.
    """
    return LiveCell(join(cell, None if zenoh is None else Path(zenoh)))

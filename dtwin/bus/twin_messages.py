"""What the modules of the twin say: identification, simulation and monitoring; and consoles, of the desk.

The rules of `dtwin.bus.messages` hold, which has their topics.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal

import msgspec

from dtwin.names import Name
from dtwin.parameters import ArmParameters, CellJoints, Gains, Law, every_joint
from dtwin.signals import SCHEMA, Count, Line, Seconds, Word

HEAVIEST: Final = 1.0
"""Greatest mass of a box in a request, kg: far more than the arm can lift."""
Ticks = Annotated[float, msgspec.Meta(ge=0.0, le=2.0)]
Kilograms = Annotated[float, msgspec.Meta(ge=0.0, le=HEAVIEST)]


DataSource = Literal["usual", "signal", "motion"]


class IdentificationRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """An operator's request to identify the arm.

    Attributes:
        free: what to estimate, as for `dtwin identify --free`. Without a known load nothing sets the scale of the
            forces: by default motor 1 does, by its data sheet.
        box_mass: kg, taken for a box held meanwhile; the middle of the cell's boxes when None.
        source: where the data come from: a signal that the blocks play, or motion of the empty arm as it passes,
            which takes the known model for all that is not free. The usual one is the signal, and motion for an arm
            whose blocks play none.
        since: plant time from which on the motion counts, s.
        anew: the free parameters of which nothing is known any more, all when empty; what is known of the
            others counts as it is. For motion only.
    """

    free: Line = "K2,K3,I,c,D"
    box_mass: Kilograms | None = None
    source: DataSource = "usual"
    since: Seconds = 0.0
    anew: Line = ""


class IdentificationDecision(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """An operator's answer to a proposed model: kept under a name or not, and uploaded to the controller or not.

    A model in doubt is kept only if `anyway` says so, too.
    """

    accept: bool
    name: Name = "arm"
    upload: bool = False
    anyway: bool = False


class Estimated(msgspec.Struct, frozen=True):
    """A parameter and its standard error, SI units."""

    value: float
    standard_error: float


IdentificationPhase = Literal["idle", "measuring", "estimating", "proposed", "refused", "accepted", "rejected"]


class IdentificationState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """How far an identification is, and what it proposes.

    Attributes:
        phase: proposed waits for a decision; refused says why in text.
        text: the state in a sentence for people.
        samples: ticks of the signal, or pieces of motion, seen.
        of: how many are needed.
        converged: whether the search ended at a minimum.
        residual_white: whether nothing but noise is left to explain.
        rank: independent combinations of the free parameters that the data determine.
        parameters: estimates by name, of what the data determine.
        fit: a joint, on held-out motion.
        model_file: file of an accepted model.
        doubts: why the proposed model should not be used, "" if nothing speaks against it.
    """

    phase: IdentificationPhase
    text: Line = ""
    samples: Count = 0
    of: Count = 0
    converged: bool = False
    residual_white: bool = False
    rank: Count = 0
    parameters: dict[Word, Estimated] = {}
    fit: tuple[float, ...] | None = None
    model_file: Line = ""
    doubts: Line = ""


class UploadRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="schema", tag=SCHEMA):
    """New settings for the running controller: gains and target time, one of them, a model, the mass of a box,
    offsets of the encoders, or an earlier version.

    Attributes:
        who: wants them.
        why: reason in the words of who asks.
        based_on: version of the settings that they have seen.
        gains: gains of the law in force.
        target_time: s.
        model: arm model for the controller.
        version: version of the history that shall be in force again.
        arm: arm as the twin knows it, for the check; that of the cell's record, or the controller's model, when None.
        payload: mass of a box that the controller shall assume, kg.
        encoder_offset: offsets to be taken off what the encoders read, rad.
        late: ticks by which commands act later than they did, for the check.
        law: law that the gains are of; they are refused under another one.
    """

    who: Word
    why: Line
    based_on: Count
    gains: Gains | None = None
    target_time: float | None = None
    model: ArmParameters | None = None
    version: Count | None = None
    arm: ArmParameters | None = None
    payload: Kilograms | None = None
    encoder_offset: CellJoints | None = None
    late: Ticks = 0.0
    law: Law | None = None


class RollBackRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The settings before those on trial shall be in force again, at once and without a check.

    Attributes:
        who: wants it.
        why: reason in the words of who asks.
    """

    who: Word
    why: Line


class Upload(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The newest entry in the history of the settings, and what is in force.

    Attributes:
        version: version of the settings in force.
        time: plant time of the entry, s.
        action: start, upload, refuse, confirm or roll back.
        text: what came of it, or why it was done.
        on_trial: whether the settings are still being watched.
        gains: gains in force.
        target_time: target time in force, s.
        law: control law in force.
        model: arm model in force.
        predicted: largest distance of each joint from its path that the twin expects, rad.
        payload: mass of a box in force, kg.
        encoder_offset: offsets of the encoders in force, rad.
    """

    version: Count
    time: Seconds
    action: Word
    text: Line
    on_trial: bool
    gains: Gains
    target_time: float
    law: Law
    model: ArmParameters
    predicted: CellJoints | None = None
    payload: float = 0.2
    encoder_offset: CellJoints = every_joint(0.0)


class PredictionRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What if the controller had other settings? Nothing is changed.

    Attributes:
        gains: gains of the law in force; those in force when None.
        target_time: s; the one in force when None.
        model: arm model of the controller; the one in force when None.
        arm: arm as the twin knows it; that of the cell's record, or the controller's model, when None.
        box: kg, of a carried box; the middle of the cell's when None.
        payload: mass of a box that the controller assumes, kg; the one in force when None.
        late: ticks by which commands act later than they did.
    """

    gains: Gains | None = None
    target_time: float | None = None
    model: ArmParameters | None = None
    arm: ArmParameters | None = None
    box: Kilograms | None = None
    payload: Kilograms | None = None
    late: Ticks = 0.0


class PredictedMotion(msgspec.Struct, frozen=True):
    """One of the cell's motions on the twin.

    Attributes:
        start, goal: names of places.
        carries: whether a box is held.
        rms: distance of each joint from its path, root mean square, rad.
        tracking: the largest such distance, rad.
        peak_volts: largest voltage of each joint, V.
        saturated: share of the samples with a voltage at its limit.
    """

    start: Word
    goal: Word
    carries: bool
    rms: CellJoints
    tracking: CellJoints
    peak_volts: CellJoints
    saturated: float


class Predicted(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What the twin expects of settings.

    Attributes:
        version: version of the settings in force, which were taken for what the request left open.
        motions: all of the cell's.
    """

    version: Count
    motions: tuple[PredictedMotion, ...]


UnitState = Literal["nominal", "may be degrading", "failed", "not commissioned", "unknown"]
UNITS: Final = ("joint 1", "joint 2", "joint 3", "gripper")
"""What has a state of its own in a verdict."""


class MonitoredUnit(msgspec.Struct, frozen=True):
    """A joint or the gripper as the monitor sees it.

    Attributes:
        state: nominal, may be degrading, failed, not commissioned, which means that the model does not fit this arm,
            or unknown, which no monitor says: it stands in the place of a verdict that is too old.
        cause: cause of what is wrong in words, "" for none.
        parameter: what changed, in the notation of faults, "" for nothing.
        size: size of the change, relative for a voltage constant and in SI units for the others.
        deviation: standard deviation of the size.
        confidence: probability of the cause.
        since: plant time at which it began, s.
        detected: plant time at which it was noticed, s.
        settled: whether the diagnosis is complete; until then cause and size may still change.
        text: all of that in words.
        others: further causes that the samples do not tell from it, in the notation of faults.
        follows: finding before it of which it may be a consequence, in the notation of faults; "" for none.
    """

    state: UnitState
    cause: Word = ""
    parameter: Word = ""
    size: float = 0.0
    deviation: float = 0.0
    confidence: float = 0.0
    since: Seconds = 0.0
    detected: Seconds = 0.0
    settled: bool = False
    text: Line = ""
    others: tuple[Word, ...] = ()
    follows: Word = ""


class MonitoringVerdict(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The monitor's opinion of the arm, twice a second and whenever it changes.

    Attributes:
        time: plant time, s.
        units: the units by their names in UNITS.
        forecasts: slow changes that will reach a limit, in words.
        unobservable: causes that the last seconds could not have shown.
        missed: samples that did not arrive since the service started.
        restarts: how often the estimate of the motion had to start anew.
        findings: all that is wrong, the gravest first; a unit tells of one of them.
    """

    time: Seconds
    units: dict[Word, MonitoredUnit]
    forecasts: tuple[Line, ...]
    unobservable: tuple[Line, ...]
    missed: Count
    restarts: Count
    findings: tuple[MonitoredUnit, ...] = ()


class AcknowledgeRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """An operator knows what is wrong: the arm as it is now counts as normal.

    Attributes:
        parameter: what the finding or forecast names, as in `MonitoredUnit`; "" for all.
    """

    parameter: Word = ""


class WatchRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """The monitor shall watch the arm, or leave it alone; it begins anew from its model.

    Attributes:
        who: name of who wants it.
        run: whether to watch.
    """

    who: Word
    run: bool


class WatchState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Whether the monitor watches the arm, and what with.

    Attributes:
        running: whether it watches.
        model: model or record of the healthy arm in words.
    """

    running: bool
    model: Line


class MonitoringResiduals(msgspec.Struct, frozen=True, gc=False, tag_field="schema", tag=SCHEMA):
    """What the encoders said beyond what was expected, rad; ten times a second.

    Attributes:
        sequence: number of the sample's tick.
        time: plant time of the sample, s.
        predicted: what the encoders should have read, rad.
        residual: reading minus prediction, rad.
        deviation: standard deviation that a healthy arm's residuals have, rad.
        evidence: evidence of a sudden change, 2 log likelihood ratio.
        threshold: evidence from which on a change is diagnosed.
    """

    sequence: Count
    time: Seconds
    predicted: CellJoints
    residual: CellJoints
    deviation: CellJoints
    evidence: float
    threshold: float


DeskAction = Literal["occupy", "keep", "leave"]


class DeskRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What a session wants of the desk.

    Attributes:
        session: name of the session.
        user: name of the person.
        action: occupy takes the desk if it is free, keep is a sign of life of who has it, leave frees it.
    """

    session: Word
    user: Word
    action: DeskAction


class DeskState(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Who has the desk.

    Attributes:
        session: name of the session, "" when it is free.
        user: name of the person, "" when it is free.
        left: time without a sign of life after which it is free, s.
    """

    session: Word = ""
    user: Word = ""
    left: float = 0.0

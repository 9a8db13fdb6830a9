"""The kinds of fault: one row each, from which everything in this room that depends on the kind is taken.

A fault is a kind and a joint, written `K2`, `freeze1` or `payload`. Some kinds are only hypotheses of the diagnosis:
`friction2` is D2 and mu2 together, which is reported as the one that changed more, and `free` is a joint that is
locked no more.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal

from dtwin.errors import ParameterError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters
from dtwin.signals import ArmState

Hypothesis = Literal["jump", "jumps", "scale", "loss", "hold", "torque", "push", "stop", "none"]
"""What an arm with the fault is taken to do in the diagnosis.

The state named like the kind jumps; all states that it is about jump; an encoder reads larger angles than there are;
the state that it is about becomes zero; a joint is held where it is; an unknown torque acts, from then on or for a
short time; the reading of a joint's encoder stays what it is; or nothing, since it is no matter of the arm's motion.
"""

RELATIVE: Final = ""
"""unit of a change that is told relative to the value of the model"""
LOCK: Final = "lock"
FREE: Final = "free"
UNKNOWN: Final = "unknown"
"""Kinds that the diagnosis tries whatever is suspected."""
FREEZE: Final = "freeze"
"""The kind that is seen in the readings themselves, unless a joint at rest would give the same ones."""
GRIP: Final = "grip"
"""The kind that the gripper's own encoder tells: its jaw does not go, or stay, where the motor drives it."""
READ: Final = (FREEZE, GRIP)
"""Kinds that last until an encoder itself says otherwise."""
NAMED: Final = {"cutgripper": GRIP}
"""Kinds as which faults are found that the emulation calls otherwise."""
PUSH: Final = "push"
SLIP: Final = "slip"
BIAS: Final = "bias"
DRIFT: Final = "drift"
SCALE: Final = "scale"
LATE: Final = "late"
MU: Final = "mu"
SUPPLY: Final = "supply"
_JOINTS: Final = (1, 2, 3)
_TEXT: Final = re.compile(r"([A-Za-z]+)([123]?)")


@dataclass(frozen=True, slots=True)
class Limit:
    """The slow change at which a joint has failed.

    Attributes:
        change: the limit, as a share of the model's value if relative, in the unit of the size otherwise.
        relative: whether the change is told relative to the model's value.
        either_way: whether the limit holds for changes of both signs.
    """

    change: float
    relative: bool = True
    either_way: bool = False


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of fault.

    Attributes:
        cause: the fault in words.
        hypothesis: what the diagnosis tries, see `Hypothesis`.
        angles_known: whether the encoders still tell where the arm is. Only then may a stopped arm be held by its
            motors; a kind of which nobody has said so takes the torque off.
        on_joint: whether it befalls one of the joints.
        on_arm: whether it befalls all joints together; the gripper if neither.
        on_box: whether it goes with the box that is held.
        states: symbols of the estimator's states that a finding is about, see `layout`. Findings on equal states tell
            of the same matter, and their cause could be seen wherever a change of the last state could.
        unit: unit of the size, or RELATIVE; None where there is no size.
        plausible: standard deviation of a sudden change before anything is known of it, in the unit; None if the
            diagnosis does not look for one.
        traced: whether the signature bank looks for it, too. What it does not look for shows as something else, and
            the diagnosis tries it then.
        rarer: how much rarer it is than other kinds, before anything is known.
        nothing: share of `plausible` below which a change counts as undone.
        starts: changes, in the unit, that the diagnosis starts from besides none.
        passing: whether it is over before it is named, so that nothing is wrong any more.
        none: the kind that a change to zero is called, "" if that has no name of its own.
        limit: the slow change that is forecast; None if it is not watched.
    """

    cause: str
    hypothesis: Hypothesis
    angles_known: bool = False
    on_joint: bool = True
    on_arm: bool = False
    on_box: bool = False
    states: tuple[str, ...] = ()
    unit: str | None = None
    plausible: float | None = None
    traced: bool = True
    rarer: float = 1.0
    nothing: float = 0.0
    starts: tuple[float, ...] = ()
    passing: bool = False
    none: str = ""
    limit: Limit | None = None


KINDS: Final[dict[str, Kind]] = {
    "K": Kind(
        "voltage constant",
        "jump",
        angles_known=True,
        states=("K",),
        unit=RELATIVE,
        plausible=0.7,
        nothing=0.02,
        none="cut",
        limit=Limit(-0.1),
    ),
    "D": Kind(
        "friction",
        "jump",
        angles_known=True,
        states=("D", MU),
        unit="N m s/rad",
        plausible=0.1,
        nothing=0.1,
        # Strong friction stops a joint within a period or two, which is too unlike linear to start from none.
        starts=(0.1, 0.3),
        limit=Limit(0.5),
    ),
    MU: Kind(
        "friction",
        "jump",
        angles_known=True,
        states=("D", MU),
        unit="N m",
        plausible=0.01,
        nothing=0.1,
        limit=Limit(0.02, relative=False),
    ),
    "friction": Kind("friction", "jumps", angles_known=True, states=("D", MU)),
    "payload": Kind(
        "payload differs",
        "jump",
        angles_known=True,
        on_joint=False,
        on_box=True,
        states=("payload",),
        unit="kg",
        plausible=0.1,
        nothing=0.1,
        # The arm answers to another mass too unlike linearly to start from none.
        starts=(-0.15, -0.1, -0.05, 0.1, 0.2),
        none=SLIP,
    ),
    SLIP: Kind("gripper slip", "loss", angles_known=True, on_joint=False, on_box=True, states=("payload",)),
    GRIP: Kind("gripper does not follow", "none", angles_known=True, on_joint=False),
    BIAS: Kind(
        "encoder bias",
        "jump",
        angles_known=True,
        states=("bias",),
        unit="rad",
        plausible=0.1,
        nothing=0.02,
        limit=Limit(0.01, relative=False, either_way=True),
    ),
    DRIFT: Kind("encoder drift", "jump", states=("drift",), unit="rad/s", plausible=0.02, nothing=0.02),
    SCALE: Kind(
        "encoder scale",
        "scale",
        angles_known=True,
        states=(SCALE,),
        unit=RELATIVE,
        plausible=0.1,
        traced=False,
        rarer=3.0,
        nothing=0.02,
    ),
    FREEZE: Kind("encoder freeze", "stop"),
    LOCK: Kind("locked joint", "hold", angles_known=True),
    FREE: Kind("joint locked no more", "hold", angles_known=True, on_joint=False),
    "cut": Kind("voltage not arriving", "loss", angles_known=True, states=("K",)),
    SUPPLY: Kind(
        "supply voltage",
        "jump",
        angles_known=True,
        on_joint=False,
        on_arm=True,
        states=("supply",),
        unit=RELATIVE,
        plausible=0.5,
        nothing=0.02,
    ),
    LATE: Kind(
        "late commands",
        "jump",
        angles_known=True,
        on_joint=False,
        on_arm=True,
        states=("late",),
        unit="samples",
        plausible=1.0,
        nothing=0.3,
    ),
    PUSH: Kind("push", "push", angles_known=True, passing=True),
    UNKNOWN: Kind("unknown", "torque", angles_known=True),
}
"""By name, in the order in which equally likely ones are preferred."""
UNCLASSIFIED: Final = Kind("unknown", "torque")
"""What is known of a kind that is not in the table."""


@dataclass(frozen=True, slots=True)
class FaultId:
    """Which fault: its kind, and its joint, 1 to 3, or 0 for arm and gripper; `str` gives `K2` or `payload`."""

    kind: str
    joint: int = 0

    def __str__(self) -> str:
        return self.named(self.kind)

    @property
    def about(self) -> Kind:
        """The row of KINDS, UNCLASSIFIED if there is none."""
        return KINDS.get(self.kind, UNCLASSIFIED)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the estimator's states that it is about, such as `D2` and `mu2`."""
        return tuple(self.named(symbol) for symbol in self.about.states)

    @property
    def where(self) -> str:
        """The cause and its joint in words."""
        return f"{self.about.cause} of joint {self.joint}" if self.joint else self.about.cause

    def named(self, symbol: str) -> str:
        """The name of another kind or state at the same joint."""
        return f"{symbol}{self.joint}" if self.joint else symbol

    def same_matter(self, other: FaultId) -> bool:
        """Whether a finding of this fault tells anew of what one of the other told of."""
        if self.joint != other.joint:
            return False
        return self.kind == other.kind or self.about.states == other.about.states != ()


def parse_fault_id(text: str) -> FaultId:
    """Reads `K2`, `freeze1` or `payload`; the inverse of `str`. The kind need not be in the table.

    Raises:
        ParameterError: the text is not letters followed by a joint or nothing.
    """
    match = _TEXT.fullmatch(text)
    if match is None:
        raise ParameterError(f"fault {text!r}: expected a kind and a joint 1 to 3, or a kind alone, as K2 or payload")
    kind, joint = match.groups()
    return FaultId(kind, int(joint or 0))


def arm_state(fault: FaultId) -> ArmState:
    """What a settled finding of a fault means to the function blocks' safe stop: closed by default, see
    `Kind.angles_known`."""
    return "failed" if fault.about.angles_known else "angles unknown"


def faults(kind: str) -> tuple[FaultId, ...]:
    """All faults of a kind: one a joint, or that of the arm or the gripper."""
    return tuple(FaultId(kind, joint) for joint in _JOINTS) if KINDS[kind].on_joint else (FaultId(kind),)


JUMPS: Final = tuple(
    str(fault) for kind, row in KINDS.items() if row.plausible is not None and row.traced for fault in faults(kind)
)
"""Names of the states whose sudden change is looked for."""
LIMITS: Final = {str(fault): row.limit for kind, row in KINDS.items() if row.limit for fault in faults(kind)}
"""Limits of the slow changes that are looked for, by names of the states."""


def reference(state: str, arm: ArmParameters) -> float:
    """What a relative change of a state is told relative to, in the unit of the state."""
    return arm.get(state) if state in PARAMETER_NAMES else 1.0


def plausible_sizes(arm: ArmParameters) -> dict[str, float]:
    """Standard deviation of the size of each sudden change before anything is known of it, in the unit of the
    state."""
    sizes = {}
    for kind, row in KINDS.items():
        if row.plausible is not None:
            for name in map(str, faults(kind)):
                sizes[name] = row.plausible * (reference(name, arm) if row.unit == RELATIVE else 1.0)
    return sizes

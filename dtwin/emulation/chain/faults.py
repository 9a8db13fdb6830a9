"""Faults of a serial arm: what is otherwise than it was, from a time on or for a while.

K2*=0.8@30          the constant of the drive of joint 2
friction2*=2@30     all friction of joint 2
load+=0.5@30        kg that hang on the tool
bias2+=0.01@30      what the encoder of joint 2 reads too much, rad or m
scale2*=0.9@30      the encoder of joint 2 reads the angle times that, with -1 the other way round
freeze2@30-31       the encoder of joint 2 reads what it read last
lock2@30            joint 2 does not move
push2+=20@30-30.3   a torque or force on joint 2, N m or N
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final, Literal, cast, get_args

import numpy as np

from dtwin.errors import FaultError, choices

Kind = Literal["K", "friction", "load", "bias", "scale", "freeze", "lock", "push"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
_FACTORS: Final = ("K", "friction", "scale")
_TEXT: Final = re.compile(
    r"(?P<kind>[A-Za-z]+)(?P<joint>\d*)(?:(?P<sign>[*+])=(?P<value>[^@]+))?@(?P<start>[0-9.e+]+)(?:-(?P<end>[0-9.e+]+))?\Z"
)
_FORM: Final = (
    "K2*=0.8@30, friction2*=2@30, load+=0.5@30, bias2+=0.01@30, scale2*=0.9@30, freeze2@30-31, lock2@30 or "
    "push2+=20@30-30.3"
)


@dataclass(frozen=True, slots=True)
class ChainFault:
    """A fault.

    Attributes:
        kind: what it is.
        joint: number of its joint, from 0; 0 for a load.
        value: factor of a constant or of friction; kg, rad, m, N m or N of the others; 0 where there is none.
        start: when it begins, s.
        end: when it is over, s; inf if it lasts.
    """

    kind: Kind
    joint: int
    value: float
    start: float
    end: float = np.inf

    def acts(self, time: float) -> bool:
        """Whether it acts at a time, s."""
        return self.start - 1e-9 <= time < self.end - 1e-9

    def __str__(self) -> str:
        own = "" if self.kind == "load" else str(self.joint + 1)
        sign = "*" if self.kind in _FACTORS else "+"
        value = "" if self.kind in ("freeze", "lock") else f"{sign}={self.value:g}"
        over = "" if np.isinf(self.end) else f"-{self.end:g}"
        return f"{self.kind}{own}{value}@{self.start:g}{over}"


def parse_chain_fault(text: str, joints: int) -> ChainFault:
    """The fault of an arm of n joints that a text stands for.

    Raises:
        FaultError: it cannot be read, or names a joint that is not there.
    """
    found = _TEXT.match(text.replace(" ", ""))
    if found is None or found["kind"] not in KINDS:
        raise FaultError(f"fault {text!r}: expected {_FORM}, got none of {choices(KINDS)}")
    kind = cast(Kind, found["kind"])
    valued = kind not in ("freeze", "lock")
    sign = ("*" if kind in _FACTORS else "+") if valued else None
    if found["sign"] != sign or bool(found["joint"]) == (kind == "load"):
        raise FaultError(f"fault {text!r}: expected the form of {_FORM}")
    joint = int(found["joint"] or 1) - 1
    if not 0 <= joint < joints:
        raise FaultError(f"fault {text!r}: expected a joint from 1 to {joints}, got {found['joint']}")
    try:
        value = float(found["value"]) if valued else 0.0
        start, end = float(found["start"]), float(found["end"] or np.inf)
    except ValueError:
        raise FaultError(f"fault {text!r}: expected numbers, as in {_FORM}") from None
    if not np.isfinite(value) or (kind in ("K", "friction") and value < 0.0) or not end > start:
        raise FaultError(
            f"fault {text!r}: expected a finite value, factors of at least 0 (scale: any), and an end after the start"
        )
    return ChainFault(kind, joint, value, start, end)

"""Candidates of one cause, which differ in when or how it came about: few of them are worth following for long.

Causes are compared with tempered likelihoods, as what the model lacks may look like one of them. Between candidates
of one cause it makes no difference: it is alike in both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.kinds import FREEZE

_OUTDONE: Final = 25.0
"""log-likelihood by which a candidate is outdone by another one of its cause"""
_TOLD_APART: Final = 100
"""samples after the alarm at which candidates of one cause are told apart as well as they will be"""
_FEW: Final = 3
"""candidates of one cause that are followed from then on"""


def worth_following(candidates: Sequence[Candidate], age: int) -> list[Candidate]:
    """The candidates that no other of their cause outdoes, in their order.

    What comes after may still show of some; and an encoder that has stopped is given up by its readings alone.

    Args:
        candidates: all of them.
        age: samples since the alarm.
    """
    most = _FEW if age >= _TOLD_APART else len(candidates)
    ahead: dict[tuple[str, ...], list[float]] = {}
    outdone = set()
    for each in sorted(candidates, key=lambda each: -each.gain):
        if each.waits or each.fault.kind == FREEZE:
            continue
        better = ahead.setdefault(each.cause, [])
        if better and (len(better) >= most or each.gain < better[0] - _OUTDONE):
            outdone.add(id(each))
        better.append(each.gain)
    return [each for each in candidates if id(each) not in outdone]

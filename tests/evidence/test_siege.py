"""The table of attacks on a cell, and when it has withstood them; tests/services/test_hostile_cell.py makes some."""

from __future__ import annotations

import pytest

from evidence.siege.attacks import ATTACKS, INTRUDERS
from evidence.siege.siege import HostileRun, Repelled


def test_there_are_forty_attacks_of_different_names() -> None:
    names = [attack.name for attack in (*ATTACKS, *INTRUDERS)]
    assert len(ATTACKS) >= 40
    assert len(set(names)) == len(names)


@pytest.mark.parametrize(
    ("believed", "told", "passed"),
    [("", "in the status", True), ("released", "in the status", False), ("", "", False)],
)
def test_an_attack_is_repelled_if_nothing_is_believed_and_it_is_told(believed: str, told: str, passed: bool) -> None:
    run = HostileRun((Repelled("ask", "default", believed, told, 1.0),))
    assert run.passed is passed
    assert run.figures() == {"attacks": 1, "repelled": int(passed), "through": [] if passed else ["default: ask"]}
    assert f"{int(passed)} of 1 attacks" in run.report().text

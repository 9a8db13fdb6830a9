"""Which numbers have a known truth although an effect lies around a machine."""

import pytest

from tests.outside.covered import Wrapped, counts, covered
from tests.outside.table import EFFECTS


@pytest.mark.parametrize(
    ("what", "known", "changed"),
    [
        ("cold oil, D +40 %", "K1", "D1"),
        ("supply ripple, 5 %", "D1", None),
        ("gear friction of 8 % of the torque", "K2", "mu3"),
        ("half bridge of motor 2, 95 % one way", "K1", "K2"),
        ("ripple, jitter and a correction table", "K1", "delay"),
    ],
)
def test_what_an_effect_changes_itself_does_not_count(what: str, known: str, changed: str | None) -> None:
    assert what in EFFECTS
    assert counts(what, known)
    assert changed is None or not counts(what, changed)


def test_a_machine_that_stands_still_tells_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tests.outside.covered.IDENTIFIED_FROM", 0.5)
    found = covered(Wrapped(92000, "supply ripple, 5 %"))
    assert found.grade == "unusable"
    assert not found.away

"""Random programs in matiec, which shares nothing with this project, leave what the oracle says."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.iec61499.surveys.common_programs import Undefined, common_program, defined_by
from tests.support.iec61499.surveys.differential import compared
from tests.support.iec61499.surveys.matiec import MATIEC, NO_MATIEC

CASES = 200


@pytest.mark.skipif(not MATIEC, reason=NO_MATIEC)
def test_programs_in_matiec_leave_what_the_standard_says(tmp_path: Path) -> None:
    outcome = compared(range(CASES), tmp_path)
    assert not outcome.differ, "\n".join(outcome.differ)
    assert outcome.equal > CASES / 10


def test_what_the_standard_does_not_define_is_left_out() -> None:
    undefined = 0
    for seed in range(60):
        try:
            assert defined_by(common_program(seed)).left
        except Undefined:
            undefined += 1
    assert 10 < undefined < 55

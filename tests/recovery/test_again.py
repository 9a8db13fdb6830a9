"""Findings that come again: one that was away is the same one, and one that grows is answered by all of its size."""

from collections.abc import Callable

import pytest

from dtwin.bus.twin_messages import UploadRequest
from dtwin.twin.effects import Effects
from tests.recovery.fake_cell import HEALTHY, FakeCell, measures_of, watched
from tests.support.records import recorded

GROWS = 45.0
"""s"""


def test_a_finding_that_is_away_while_something_else_is_looked_at_is_answered_once() -> None:
    cell = FakeCell()
    cell.refits["K3"] = 0.9 * HEALTHY.get("K3")

    def look() -> None:
        away = 40.0 <= cell.time < 45.0
        cell.found = {} if away else {"K3": (20.0, -0.1, 0.001)}

    cell.changing = look
    assert measures_of(watched(cell)) == [("refit", ("K3",))]
    assert len(cell.uploads) == 1


def _model(name: str) -> Callable[[UploadRequest], float]:
    def told(upload: UploadRequest) -> float:
        assert upload.model is not None
        return upload.model.get(name) / HEALTHY.get(name)

    return told


def _offset(upload: UploadRequest) -> float:
    assert upload.encoder_offset is not None
    return upload.encoder_offset[1]


@pytest.mark.parametrize(
    ("parameter", "sizes", "told", "values"),
    [
        ("K3", (-0.1, -0.15), _model("K3"), (0.9, 0.85)),
        ("supply", (-0.05, -0.1), _model("K1"), (0.95, 0.9)),
        ("bias2", (0.01, 0.014), _offset, (0.01, 0.014)),
    ],
)
@pytest.mark.parametrize("begins", [False, True], ids=["grows", "begins anew"])
def test_the_size_of_a_finding_counts_from_where_it_began(
    parameter: str,
    sizes: tuple[float, float],
    told: Callable[[UploadRequest], float],
    values: tuple[float, float],
    begins: bool,
) -> None:
    """One that was acknowledged and begins anew counts from the arm as it is then."""
    cell = FakeCell()
    first, second = sizes

    def grow() -> None:
        if cell.time < GROWS:
            cell.found[parameter] = (20.0, first, 1e-4)
        else:
            cell.found[parameter] = (GROWS if begins else 20.0, second, 1e-4)
            cell.noticed[parameter] = GROWS

    cell.changing = grow
    operator = watched(cell, recorded(Effects(rotor_inertia=(1e-4, 0.0, 0.0))))
    assert [step.parameters for step in operator.steps] == [(parameter,), (parameter,)]
    after = (
        values[0] + second if parameter == "bias2" else values[0] * (1.0 + second) if parameter == "supply" else 0.75
    )
    assert [told(upload) for upload in cell.uploads] == pytest.approx([values[0], after if begins else values[1]])

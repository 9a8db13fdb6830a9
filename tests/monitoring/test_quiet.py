"""Many samples at once: the same bits as one sample after the other, whatever happens."""

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import TIMING, Belief, Unmodelled, assumed
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import W
from dtwin.monitoring.estimation.traces import STANDSTILL
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.tracking.quiet import LONG_UNSETTLED, UNSETTLED, in_doubt, quiet_rows
from dtwin.parameters import ArmParameters
from dtwin.run.options import ControlOptions
from dtwin.twin.effects import Effects
from evidence.monitoring.twin_cell import TwinCell

STRANGE = 3000
"""row at which something befalls the samples"""


def one_by_one(monitor: Monitor, seen: Stream) -> None:
    for row in range(len(seen)):
        monitor.update(int(seen.sample[row]), seen.measured[row], seen.volts[row], bool(seen.gripped[row]))


def at_once(monitor: Monitor, seen: Stream) -> list[int]:
    taken = [0]
    while sum(taken) < len(seen):
        taken.append(seen.follow(monitor, sum(taken), len(seen)))
    return taken[1:]


def spiked(seen: Stream) -> Stream:
    measured = seen.measured.copy()
    measured[STRANGE, 1] += 0.2
    return replace(seen, measured=measured)


def shortened(seen: Stream) -> Stream:
    kept = np.delete(np.arange(len(seen)), slice(STRANGE, STRANGE + 3))
    return Stream(*(getattr(seen, field.name)[kept] for field in fields(seen)))


def wild(seen: Stream) -> Stream:
    measured = seen.measured.copy()
    measured[STRANGE:, 2] += 50.0
    return replace(seen, measured=measured)


def moved(seen: Stream) -> Stream:
    measured = seen.measured.copy()
    measured[STRANGE:, 0] += 0.05
    return replace(seen, measured=measured)


def frozen(seen: Stream) -> Stream:
    measured = seen.measured.copy()
    measured[STRANGE:, 1] = measured[STRANGE, 1]
    return replace(seen, measured=measured)


def weakened(seen: Stream) -> Stream:
    volts = seen.volts.copy()
    volts[STRANGE:, 0] *= 1.5
    return replace(seen, volts=volts)


@pytest.fixture(scope="module")
def cell() -> TwinCell:
    return TwinCell(901, 1, ControlOptions().control())


@pytest.fixture(scope="module")
def work(cell: TwinCell) -> Stream:
    return stream(cell.run(40.0))


@pytest.mark.parametrize(
    ("befalls", "kinds"),
    [
        (spiked, {"spike"}),
        (shortened, set()),
        pytest.param(wild, {"failed"}, marks=pytest.mark.thorough),  # fails as what follows
        (moved, {"failed"}),
        pytest.param(frozen, {"failed"}, marks=pytest.mark.thorough),
        pytest.param(weakened, {"failed"}, marks=pytest.mark.thorough),  # the next test has it of a simpler arm
    ],
)
def test_the_bits_are_those_of_one_sample_after_the_other(
    cell: TwinCell, work: Stream, befalls: Callable[[Stream], Stream], kinds: set[str]
) -> None:
    seen = befalls(work)
    belief = replace(
        assumed(cell.arm, (5e-4,) * 3),
        effects=cell.effects,
        error=Unmodelled(slow=(0.05,) * 3, compliance=(1e-4,) * 3, timing=TIMING),
    )
    agree(belief, seen, kinds)


@pytest.mark.parametrize(("befalls", "kinds"), [(spiked, {"spike"}), (weakened, {"failed"})])
def test_so_they_are_of_an_arm_that_obeys_the_equations_of_motion(
    run_cell: Callable[..., Log], belief: Belief, befalls: Callable[[Stream], Stream], kinds: set[str]
) -> None:
    agree(belief, befalls(stream(run_cell(40.0, 3))), kinds)


def agree(belief: Belief, seen: Stream, kinds: set[str]) -> None:
    slow, fast = Monitor(belief), Monitor(belief)
    one_by_one(slow, seen)
    taken = at_once(fast, seen)
    assert max(taken) > 100
    assert sum(1 for rows in taken if rows == 1) < len(seen) - 600
    assert fast.events == slow.events
    assert kinds <= {event.kind for event in fast.events}
    assert fast.history == slow.history
    assert (fast.sample, fast.missed, fast.restarts) == (slow.sample, slow.missed, slow.restarts)
    assert fast.statistic == slow.statistic
    for name in ("x", "P", "F", "gains", "innovation", "variance"):
        np.testing.assert_array_equal(getattr(fast.estimator, name), getattr(slow.estimator, name), name)
    np.testing.assert_array_equal(fast.statistics, slow.statistics)
    for ours, theirs in zip(fast.trend.changes(), slow.trend.changes(), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(("fault", "before"), [("freeze1@20", 3), ("freeze1@17.5", 3), ("mu2+=0.01@20", 1)])
def test_work_is_calm_and_no_longer_so_before_an_alarm(
    run_cell: Callable[..., Log], belief: Belief, fault: str, before: int
) -> None:
    """An encoder that stops shows that in its first readings that repeat themselves."""
    seen, monitor, calm = stream(run_cell(30.0, 3, fault)), Monitor(belief), list[bool]()
    while not monitor.events:
        row = len(calm)
        calm.append(monitor.calm)
        monitor.update(int(seen.sample[row]), seen.measured[row], seen.volts[row], bool(seen.gripped[row]))
    assert row > 1750
    assert all(calm[1300:1740])
    assert not any(calm[-before:])
    assert not monitor.calm


def test_a_row_ends_where_samples_are_missing_say_nothing_or_the_gripper_has_changed() -> None:
    sample, told, held = np.arange(5, 15), np.zeros((10, 7)), np.zeros(10, dtype=bool)
    assert quiet_rows(4, False, sample, told, held) == 10
    assert quiet_rows(3, False, sample, told, held) == 0
    assert quiet_rows(4, False, np.delete(sample, 4), told[:9], held[:9]) == 4
    told[6, 2], held[3:] = np.nan, True
    assert quiet_rows(4, False, sample, told, held) == 4
    assert quiet_rows(4, True, sample[3:], told[3:], held[3:]) == 0
    assert quiet_rows(7, True, sample[3:], told[3:], held[3:]) == 3


@pytest.mark.parametrize(
    ("friction", "known_from", "silent"),
    [(0.01, 0, UNSETTLED), (0.01, 15, 15 + UNSETTLED - 1), (0.01, 1000, LONG_UNSETTLED), (0.0, 1000, UNSETTLED)],
)
def test_after_a_doubtful_command_evidence_waits_until_the_speeds_are_known(
    friction: float, known_from: int, silent: int
) -> None:
    """Only dry friction makes that necessary: without it the covariance tells how well they are known."""
    arm = replace(ArmParameters(), coulomb=(0.0, friction, 0.0))
    estimator = Estimator(replace(assumed(arm, (1e-4,) * 3), effects=Effects(delay=0.004)), Tuning())
    left = [in_doubt(0, 0.9, estimator.arrays())]
    while left[-1]:
        estimator.P[W + 1, W + 1] = STANDSTILL**2 * (1.1 if len(left) < known_from else 0.9)
        left.append(in_doubt(left[-1], 0.0, estimator.arrays()))
    assert len(left) - 1 == silent

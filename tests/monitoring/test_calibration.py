"""What is learned of a healthy arm that its model does not explain, and what the monitor makes of it."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from dtwin.errors import ModelError, ParameterError
from dtwin.identification.machine.record import LEARNED, Passed, read_record, write_record
from dtwin.logs.log import Log
from dtwin.monitoring import calibration
from dtwin.monitoring.calibration import LEAST, calibrated, tail_of
from dtwin.monitoring.estimation.belief import Belief, Tail, Unmodelled, commissioned
from dtwin.monitoring.estimation.layout import ARM_NAMES
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.signatures import allowances, threshold
from tests.support.records import EFFECTS, HEALTHY, recorded


@pytest.fixture(scope="module")
def pushed(belief: Belief, run_cell: Callable[..., Log]) -> tuple[Stream, Belief]:
    """A run whose model lacks what its arm has: half as much friction again at joint 2, and a gentler motor 3."""
    return stream(run_cell(30.0, 3, "D2*=1.5@0", "K3*=0.97@0")), belief


@pytest.fixture
def fewer_choices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two choices of each kind, for tests of something else than which one is taken."""
    for name in ("COMPLIANCES", "DISPLACEMENTS", "STICKING", "MEMORIES"):
        monkeypatch.setattr(calibration, name, getattr(calibration, name)[:2])


@pytest.fixture
def fewest_choices(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two choices of how large the torques are, and one of each other kind."""
    for name, count in (("SHARES", 2), ("COMPLIANCES", 1), ("DISPLACEMENTS", 1), ("STICKING", 1), ("MEMORIES", 1)):
        monkeypatch.setattr(calibration, name, getattr(calibration, name)[:count])


@pytest.fixture(scope="module")
def learned(pushed: tuple[Stream, Belief]) -> Belief:
    """What is believed of that arm after the run."""
    seen, belief = pushed
    return calibrated(belief, seen)


def test_an_arm_that_the_model_lacks_is_no_alarm_once_it_is_calibrated(
    pushed: tuple[Stream, Belief], learned: Belief
) -> None:
    seen, belief = pushed
    stern, calm = Monitor(belief), Monitor(learned)
    for monitor in (stern, calm):
        seen.feed(monitor, 0, len(seen))
    assert {event.kind for event in stern.events} & {"misfit", "suspected"}
    assert not calm.events
    assert max(learned.error.slow[1:]) > 1.5 * learned.error.slow[0]
    assert 1.5 <= learned.misfit < belief.misfit


@pytest.mark.usefixtures("fewest_choices")
def test_what_is_learned_of_an_arm_is_what_is_begun_with(pushed: tuple[Stream, Belief]) -> None:
    seen, belief = pushed
    unsure = np.diag([(0.3 * belief.arm.get(name)) ** 2 if name in LEARNED else 0.0 for name in ARM_NAMES])
    learned = calibrated(replace(belief, covariance=unsure), seen)
    assert learned.arm.get("D2") == pytest.approx(1.5 * belief.arm.get("D2"), rel=0.1)
    assert learned.arm.get("K3") == pytest.approx(0.97 * belief.arm.get("K3"), rel=0.03)
    assert np.diag(learned.covariance).max() < 0.01 * unsure.max()


@pytest.mark.usefixtures("fewer_choices")
def test_an_arm_that_the_model_explains_needs_no_torques(belief: Belief, run_cell: Callable[..., Log]) -> None:
    learned = calibrated(belief, stream(run_cell(90.0, 3)))
    assert max(learned.error.slow) < 0.005
    assert 0.0 < learned.error.pushing < 0.1  # N m, where a box on the outstretched arm could do 0.9
    assert allowances(0.01, learned.tails).max() < threshold(0.01, Tail())


def test_a_short_log_is_refused(pushed: tuple[Stream, Belief]) -> None:
    seen, belief = pushed
    rows = round(LEAST / 0.01) - 1
    short = seen.part(0, rows)
    with pytest.raises(ParameterError, match=r"the log has 29\.99 s: expected at least 30 s of healthy work"):
        calibrated(belief, short)


def test_what_a_healthy_arm_passes_more_often_asks_for_a_higher_threshold() -> None:
    """With exponential excesses a value e times as rare is one mean excess farther up."""
    tail = Tail(20.0, 36.0, 5.0)
    assert threshold(0.01, tail) == pytest.approx(20.0 + 5.0 * math.log(3600.0))
    assert threshold(0.01 / math.e, tail) == pytest.approx(threshold(0.01, tail) + 5.0)
    assert threshold(0.01, Tail(2.0, 36.0, 0.1)) == pytest.approx(0.7 * threshold(0.01, Tail()))
    assert threshold(0.01, Tail(2.0)) == threshold(0.01, Tail())
    assert threshold(100.0, tail) == max(20.0, 0.7 * threshold(100.0, Tail()))


def test_a_record_says_what_is_believed() -> None:
    record = recorded()
    found = commissioned(record)
    assert (found.effects, found.noise) == (EFFECTS, record.encoders)
    assert (found.error.slow, found.error.memory, found.error.grip) == (HEALTHY.slow, 0.3, 0.9)
    assert (found.tails, found.misfit) == ({"K2": Tail(20.0, 36.0, 5.0)}, 3.0)
    deviations = dict(zip(ARM_NAMES, np.sqrt(np.diag(found.covariance)), strict=True))
    for name in LEARNED[:9]:
        learned = HEALTHY.learned[name]
        assert (found.arm.get(name), deviations[name]) == pytest.approx((learned.value, learned.deviation))
    assert found.offset == tuple(HEALTHY.learned[name].value for name in LEARNED[9:])
    assert found.offset_deviation == tuple(HEALTHY.learned[name].deviation for name in LEARNED[9:])
    assert found.arm.get("l2") == record.arm.get("l2")
    assert deviations["c2"] == 0.0


def test_a_record_of_an_arm_that_nobody_watched_says_what_was_identified() -> None:
    record = msgspec.structs.replace(recorded(), healthy=None)
    found = commissioned(record)
    deviations = dict(zip(ARM_NAMES, np.sqrt(np.diag(found.covariance)), strict=True))
    assert (found.arm, found.tails) == (record.arm, {})
    assert deviations["K2"] == pytest.approx(0.01 * record.arm.get("K2"))


def test_a_record_that_lacks_what_was_learned_is_refused(tmp_path: Path) -> None:
    learned = {name: number for name, number in HEALTHY.learned.items() if name != "mu2"}
    path = tmp_path / "record.json"
    healthy = msgspec.structs.replace(HEALTHY, learned=learned)
    write_record(msgspec.structs.replace(recorded(), healthy=healthy), path)
    with pytest.raises(ModelError, match=r"record\.json: healthy\.learned: mu2 is missing"):
        read_record(path)


@pytest.mark.parametrize("wrong", [{"slow": (0.1, -0.1, 0.1)}, {"grip": np.inf}, {"memory": 0.0}])
def test_impossible_torques_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match="expected"):
        Unmodelled(**wrong)


@pytest.mark.usefixtures("fewest_choices")
def test_gaps_and_readings_that_say_nothing_are_no_torques(pushed: tuple[Stream, Belief], learned: Belief) -> None:
    seen, belief = pushed
    sample, measured = seen.sample.copy(), seen.measured.copy()
    sample[900:] += 50
    measured[1500] = math.nan
    torn = replace(seen, sample=sample, measured=measured)
    assert max(calibrated(belief, torn).error.slow) < 1.3 * max(learned.error.slow)


def test_a_statistic_that_never_passes_its_level_has_a_tail_of_nothing() -> None:
    assert tail_of(np.full(2000, 7.0)) == Tail(7.0)


def test_the_tail_of_exponential_peaks_is_theirs() -> None:
    """Of exponential peaks a tenth is above the level, which they pass by their mean."""
    peaks = np.random.default_rng(1).exponential(5.0, 4000)
    tail = tail_of(np.repeat(peaks, 100))
    assert tail.rate == pytest.approx(360.0, rel=0.01)
    assert tail.excess == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize(
    ("name", "value"), [("memory", 0.0), ("misfit", -1.0), ("tails", {"K2": Passed(20.0, -0.1, 5.0)})]
)
def test_a_record_of_impossible_health_is_refused(name: str, value: object, tmp_path: Path) -> None:
    record = msgspec.structs.replace(recorded(), healthy=HEALTHY)
    path = tmp_path / "record.json"
    write_record(msgspec.structs.replace(record, healthy=msgspec.structs.replace(HEALTHY, **{name: value})), path)
    with pytest.raises(ModelError, match=rf"record\.json: .*\$\.healthy\.{name}"):
        read_record(path)


def test_the_excess_of_few_peaks_is_rarely_too_small() -> None:
    """Of logs with few exponential peaks the upper limit covers the true mean in 95 of 100."""
    generator, logs = np.random.default_rng(2), 400
    above = [tail_of(np.repeat(generator.exponential(5.0, 100), 100)).excess >= 5.0 for _ in range(logs)]
    assert 0.92 < np.mean(above) < 0.98

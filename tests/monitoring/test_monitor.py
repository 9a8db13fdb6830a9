"""The monitor as a whole: faults of the emulated cell found, named and sized; and what it must not say."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dtwin.errors import ModelError, ParameterError
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import NOISE_FLOOR, Belief, assumed, identified
from dtwin.monitoring.monitor import BRIDGED, Monitor
from dtwin.monitoring.offline import Stream, stream, watch
from dtwin.monitoring.settings import MonitorSettings
from dtwin.parameters import ArmParameters, every_joint
from evidence.monitoring.trial import FaultTrial, run_trial


def followed(belief: Belief, seen: Stream, stop: int | None = None) -> Monitor:
    monitor = Monitor(belief)
    seen.feed(monitor, 0, len(seen) if stop is None else stop)
    return monitor


@pytest.mark.parametrize(
    ("fault", "largest_error"),
    [
        ("K2*=0.1", 0.1),
        ("K1*=0.8", 0.1),
        ("D1*=2", 0.15),
        ("mu2+=0.01", 0.15),
        ("payload+=0.05", 0.15),
        ("bias3+=0.02", 0.15),
        ("drift2+=0.01", 0.15),
        ("scale2*=1.02", 0.15),
        ("scale3*=0.97", 0.15),
        ("freeze1", None),
        ("lock2", None),
        ("cut3", None),
        ("slip", None),
    ],
)
def test_faults_are_found_named_and_sized(fault: str, largest_error: float | None) -> None:
    outcome = run_trial(FaultTrial(seed=5, fault=fault, noise=0.003, start=11.0))
    assert outcome.detected
    assert outcome.named, f"named {outcome.cause} of {outcome.joint}"
    assert outcome.false_alarms == 0
    assert outcome.motion_latency_s is not None
    assert outcome.motion_latency_s < 2.0
    if largest_error is None:
        assert outcome.size is None
    else:
        assert outcome.size == pytest.approx(outcome.size_true, rel=largest_error)


@pytest.mark.parametrize("step", [0.0025, 0.001, 0.005])
def test_normal_work_raises_no_alarm_however_finely_it_is_emulated(
    step: float, belief: Belief, run_cell: Callable[..., Log]
) -> None:
    monitor = followed(belief, stream(run_cell(60.0, 8, step=step)))
    assert monitor.events == []
    verdict = monitor.verdict()
    assert {unit.state for unit in verdict.units.values()} == {"nominal"}
    assert verdict.missed == 0


@pytest.fixture(scope="module")
def weak(run_cell: Callable[..., Log]) -> Log:
    """A cell whose first motor is weak for seven seconds."""
    return run_cell(30.0, 3, "K1*=0.6@16-23")


@pytest.fixture(scope="module")
def watching(belief: Belief, weak: Log) -> Monitor:
    """What has watched that cell; nobody may feed it any more."""
    return followed(belief, stream(weak))


@pytest.mark.parametrize(
    ("seed", "start", "fault", "named"),
    [
        (1, 72.26, "K2*=0.1", "K2"),  # the first sample since speaks for an onset one sample too early
        (1, 67.76, "K1*=0.1", "K1"),
        (3, 60.54, "D2+=0.2", "D2"),  # what friction slows within a period is far from linear
        (0, 54.9, "D1+=0.4", "D1"),  # more friction than usual steps of the integration can take
    ],
)
def test_the_largest_changes_are_named_too(
    run_cell: Callable[..., Log], seed: int, start: float, fault: str, named: str
) -> None:
    log = run_cell(start + 6.0, seed, f"{fault}@{start}", noise=0.002)
    monitor = followed(assumed(ArmParameters(), (0.0, 0.0, 0.0)), stream(log))
    (finding,) = monitor.history
    assert finding.parameter == named
    assert finding.since == pytest.approx(start, abs=0.05)


def test_a_fault_that_ends_is_struck_out(watching: Monitor) -> None:
    monitor = watching
    kinds = [event.kind for event in monitor.events]
    assert kinds == ["suspected", "failed", "suspected", "recovered"]
    times = [event.time for event in monitor.events]
    assert times[0] == pytest.approx(16.0, abs=0.2)
    assert times[2] == pytest.approx(23.0, abs=0.2)
    assert monitor.findings.current == {}
    assert [finding.parameter for finding in monitor.history] == ["K1"]
    assert {unit.state for unit in monitor.verdict().units.values()} == {"nominal"}


def test_a_frozen_encoder_that_works_again_is_used_again(belief: Belief, run_cell: Callable[..., Log]) -> None:
    monitor = followed(belief, stream(run_cell(20.0, 3, "freeze2@12.5-15.5")))
    assert [event.kind for event in monitor.events] == ["failed", "recovered"]
    assert monitor.events[0].time == pytest.approx(12.53, abs=0.02)
    assert monitor.verdict().units["joint 2"].state == "nominal"


def test_the_size_is_refined_after_the_diagnosis(belief: Belief, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell(60.0, 3, "D2*=2@12.5"))
    monitor = followed(belief, seen)
    (finding,) = monitor.standing()
    (first,) = monitor.history
    assert finding.parameter == first.parameter == "D2"
    assert finding.deviation < first.deviation
    assert finding.size == pytest.approx(0.05, abs=4 * finding.deviation + 1e-3)


def test_the_size_stays_as_it_was_while_the_estimate_is_no_number(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    """Another fault may let the estimate diverge until its diagnosis gives another."""
    monitor = followed(belief, stream(run_cell(30.0, 3, "D2*=2@12.5")))
    (told,) = monitor.findings.current.values()
    for array in (monitor.estimator.x, monitor.estimator.P):
        array[:] = np.nan
    (found,) = monitor.standing()
    assert (found.size, found.deviation) == (told.size, told.deviation)
    assert all(np.isfinite(unit.deviation) for unit in monitor.verdict().units.values())


def test_the_truth_is_not_looked_at(belief: Belief, weak: Log, watching: Monitor) -> None:
    hidden = {f"{name}_{joint}" for name in ("theta", "omega", "target") for joint in (1, 2, 3)} | {"payload_mass"}
    columns = {name: np.zeros_like(c) if name in hidden else c for name, c in weak.columns.items()}
    assert followed(belief, stream(replace(weak, columns=columns))).events == watching.events
    assert watching.events


def test_equal_streams_give_equal_verdicts(belief: Belief, weak: Log, watching: Monitor) -> None:
    again = followed(belief, stream(weak))
    assert again.events == watching.events
    np.testing.assert_array_equal(again.estimator.P, watching.estimator.P)


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_missing_samples_are_counted_and_are_no_fault(
    share: float, belief: Belief, run_cell: Callable[..., Log]
) -> None:
    seen = stream(run_cell())
    monitor, lost = losing(belief, seen, share)
    assert monitor.missed == np.count_nonzero(lost[: monitor.sample])
    assert {event.kind for event in monitor.events} <= {"restart"}


def test_faults_are_named_although_samples_are_missing(belief: Belief, weak: Log) -> None:
    monitor, _ = losing(belief, stream(weak), 0.05)
    assert [finding.parameter for finding in monitor.history] == ["K1"]
    assert monitor.history[0].size == pytest.approx(-0.4, abs=0.04)


def losing(belief: Belief, seen: Stream, share: float) -> tuple[Monitor, np.ndarray]:
    """A monitor that has not received a share of the samples, and which ones."""
    lost = np.random.default_rng(0).random(len(seen)) < share
    monitor = Monitor(belief)
    for row in np.flatnonzero(~lost).tolist():
        seen.feed(monitor, row, row + 1)
    return monitor, lost


def test_long_gaps_start_the_motion_anew_and_keep_what_was_learned(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    seen = stream(run_cell())
    monitor = followed(belief, seen, 2000)
    learned = monitor.estimator.deviation("K1")
    seen.feed(monitor, 2000 + BRIDGED + 1, 3000)
    assert monitor.restarts == 1
    assert monitor.missed == BRIDGED + 1
    assert monitor.estimator.deviation("K1") == pytest.approx(learned, rel=0.5)
    seen.feed(monitor, 1000, 2000)  # the cell started again
    assert monitor.restarts == 2
    assert [event.kind for event in monitor.events] == ["restart", "restart"]
    seen.feed(monitor, 2000, len(seen))
    assert monitor.findings.current == {}


def test_a_fault_during_a_gap_is_found_after_it(belief: Belief, weak: Log) -> None:
    seen = stream(weak)
    monitor = followed(belief, seen, 1590)
    seen.feed(monitor, 1610, 1900)
    assert monitor.verdict().units["joint 1"].state == "failed"


def test_friction_of_an_arm_at_rest_is_said_to_be_unobservable(belief: Belief, run_cell: Callable[..., Log]) -> None:
    log = run_cell()
    seen = stream(log)
    monitor = Monitor(belief)
    hidden = set()
    for row in range(0, len(seen), 100):
        seen.feed(monitor, row, row + 100)
        quiet = np.abs(log.stack("omega")[max(row - 900, 0) : row + 100]).max() < 0.03
        hidden |= set(monitor.unobservable()) if quiet else set()
        if np.abs(log.stack("omega")[row : row + 100]).max() > 1.0 and row > 500:
            assert "friction of joint 2" not in monitor.unobservable()
    assert monitor.findings.current == {}


def test_noise_that_the_model_does_not_tell_of_is_heard(run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    monitor = followed(assumed(ArmParameters(), (0.0, 0.0, 0.0)), seen)
    assert monitor.events == []


def test_impossible_readings_do_not_leave_the_monitor_blind(belief: Belief, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    measured = seen.measured.copy()
    measured[2000:2050] = np.nan
    monitor = Monitor(belief)
    replace(seen, measured=measured).feed(monitor, 0, len(seen))
    assert np.isfinite(monitor.estimator.x).all()
    assert monitor.missed >= 50


def test_the_trace_of_a_log_covers_every_tick(belief: Belief, weak: Log) -> None:
    seen = stream(weak)
    trace = watch(Monitor(belief), seen)
    assert trace.predicted.shape == trace.deviation.shape == (3000, 3)
    residual = np.abs(seen.measured - trace.predicted)[300:1600] / trace.deviation[300:1600]
    assert np.mean(residual < 2.5758) > 0.98
    assert trace.statistic[:1600].max() < trace.threshold
    states = [verdict.units["joint 1"].state for _, verdict in trace.verdicts]
    assert states[0] == "nominal" == states[-1]
    assert "failed" in states


def test_settings_and_beliefs_are_checked() -> None:
    with pytest.raises(ParameterError, match="alarms_per_hour"):
        MonitorSettings(alarms_per_hour=0.0)
    belief = assumed(ArmParameters(), (1e-3, 1e-3, 1e-3))
    with pytest.raises(ParameterError, match="15 x 15"):
        Belief(belief.arm, np.eye(3), belief.noise)
    with pytest.raises(ParameterError, match="noise"):
        Belief(belief.arm, belief.covariance, (-1.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match="empty"):
        stream(RunLog({}).freeze())


def test_an_identified_model_brings_its_uncertainty(belief: Belief) -> None:
    assert belief.arm != ArmParameters()
    deviations = np.sqrt(np.diag(belief.covariance)) / np.maximum([belief.arm.get("K1")], 1e-9)
    assert 1e-4 < deviations[0] < 1e-2
    assert max(np.abs(np.array(belief.offset) - 0.0015)) < 5e-4


def test_models_with_open_parameters_are_refused() -> None:
    from dtwin.controller.excitation import ExcitationController
    from dtwin.identification.estimation.estimate import EstimationSettings, identify
    from dtwin.identification.excitation.plan import Plan
    from dtwin.identification.excitation.rig import Rig
    from dtwin.identification.result import from_estimate

    experiment = Rig(noise=0.001).measure(Plan(payload=0.0), ExcitationController(), np.random.default_rng(0))
    estimate = identify(
        [experiment], EstimationSettings(free=tuple(f"{s}{j}" for s in "KmID" for j in (1, 2, 3)), starts=1)
    )
    with pytest.raises(ModelError, match="open"):
        identified(from_estimate(estimate, np.ones(3), "simulated"))


@pytest.mark.parametrize(("fault", "named"), [("D1*=5@32.2", "D1"), ("D2*=5@31.4", "D2")])
def test_a_large_change_in_mid_motion_that_noiseless_encoders_see_is_named(
    run_cell: Callable[..., Log], fault: str, named: str
) -> None:
    belief = assumed(ArmParameters(), every_joint(NOISE_FLOOR))
    monitor = followed(belief, stream(run_cell(40.0, 3, fault, noise=0.0)))
    assert [found.parameter for found in monitor.history] == [named]
    assert monitor.history[0].size == pytest.approx(0.2, rel=1e-2)

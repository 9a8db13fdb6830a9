from collections.abc import Callable
from functools import cache

import numpy as np
import pytest

from dtwin.errors import IdentificationError, ParameterError
from dtwin.identification.data import Experiment, Start, fingerprint, from_log
from dtwin.identification.estimation.problem import Prior, Problem, initial_speed
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.logs.log import Log
from tests.support.identification import ARM, blocks

KNOWN = Plan(payload=0.2, samples=50).experiment()
WEIGHTS = [np.array([1.0, 2.0, 3.0]), np.linspace(1, 2, 150).reshape(50, 3)]


@cache
def unknown() -> Experiment:
    """A run whose start is not known."""
    plan = Plan(payload=0.1, start=Start(known=False), samples=60)
    return Rig(noise=0.01).measure(plan, blocks(), np.random.default_rng(0))


def two_runs() -> Problem:
    return Problem(
        (unknown(), KNOWN), ("K2", "m1", "I3", "mu1"), ARM, priors={"m1": Prior(0.12, 0.01), "mu1": Prior(0.01, 0.01)}
    )


def test_unknowns_are_named() -> None:
    names = two_runs().names
    assert names[:7] == ("K2", "m1", "I3", "mu1", "offset1", "offset2", "offset3")
    assert names[7:] == tuple(f"{kind}{joint}@1" for kind in ("theta", "omega") for joint in (1, 2, 3))


def test_derivatives_of_the_sum_of_squares() -> None:
    problem = two_runs()
    x = problem.start() + 0.01 * np.random.default_rng(0).standard_normal(13)
    x[3] = 0.7
    normal = problem.normal(x, WEIGHTS)
    assert normal is not None
    assert normal.cost == pytest.approx(problem.cost(x, WEIGHTS), rel=1e-12)
    assert normal.residuals == 3 * 110
    for k in range(len(x)):
        h = 1e-4
        ahead, behind = x.copy(), x.copy()
        ahead[k] += h
        behind[k] -= h
        slope = (problem.cost(ahead, WEIGHTS) - problem.cost(behind, WEIGHTS)) / (2 * h)
        assert 2 * normal.gradient[k] == pytest.approx(slope, rel=1e-4, abs=1e-5 * normal.cost), problem.names[k]


def test_sensitivity_is_the_information_left_after_the_initial_state() -> None:
    problem = two_runs()
    x = problem.start()
    normal = problem.normal(x, WEIGHTS)
    assert normal is not None
    H, shared = normal.hessian, len(problem.shared)
    schur = H[:shared, :shared] - H[:shared, shared:] @ np.linalg.solve(H[shared:, shared:], H[shared:, :shared])
    matrix = problem.sensitivity(x, WEIGHTS)
    assert matrix.T @ matrix == pytest.approx(schur, rel=1e-5, abs=1e-7 * np.abs(schur).max())


def test_diverging_parameters_cost_infinitely() -> None:
    problem = Problem((KNOWN,), ("D1",), ARM)
    wild = np.array([1e5, 0.0, 0.0, 0.0])
    assert problem.cost(wild, [np.ones(3)]) == np.inf
    assert problem.normal(wild, [np.ones(3)]) is None


def test_initial_speed_of_a_parabola_is_exact() -> None:
    time = 0.01 * np.arange(40)
    angles = np.column_stack([0.1 + 2.0 * time - 3.0 * time**2, -time, 0.5 + 0.0 * time])
    assert initial_speed(Experiment(angles, 0 * angles)) == pytest.approx([2.0, -1.0, 0.0], abs=1e-9)


def test_fingerprint_tells_every_difference() -> None:
    base = Experiment(KNOWN.measured, KNOWN.volts, 0.2, KNOWN.start)
    others = [
        Experiment(KNOWN.measured + 1e-15, KNOWN.volts, 0.2, KNOWN.start),
        Experiment(KNOWN.measured, -KNOWN.volts, 0.2, KNOWN.start),
        Experiment(KNOWN.measured, KNOWN.volts, 0.21, KNOWN.start),
        Experiment(KNOWN.measured, KNOWN.volts, 0.2),
        Experiment(KNOWN.measured, KNOWN.volts, 0.2, KNOWN.start, payload_model="weight"),
    ]
    assert len({base.fingerprint, *(other.fingerprint for other in others)}) == 6
    assert fingerprint([base, others[0]]) != fingerprint([others[0], base])
    assert base.fingerprint == Experiment(KNOWN.measured, KNOWN.volts, 0.2, KNOWN.start).fingerprint


def test_shapes_are_checked() -> None:
    with pytest.raises(ParameterError, match=r"measured: expected shape \(N, 3\), got \(4, 2\)"):
        Experiment(np.zeros((4, 2)), np.zeros((4, 2)))
    with pytest.raises(ParameterError, match="as many measured angles as volts"):
        Experiment(np.zeros((4, 3)), np.zeros((5, 3)))
    with pytest.raises(ParameterError, match="payload: expected at least 0 kg"):
        Experiment(np.zeros((4, 3)), np.zeros((4, 3)), -1.0)
    with pytest.raises(ParameterError, match="expected at least one experiment"):
        Problem((), ("K1",))


def test_a_log_becomes_segments() -> None:
    from dtwin.run.cell import Cell
    from dtwin.run.settings import CellSettings

    cell = Cell(CellSettings(duration=15.05, seed=1))
    cell.run()
    log = cell.log.freeze()
    segments = from_log(log, 0.3)
    assert [len(segment) for segment in segments[:-1]] == [100] * 14
    assert sum(map(len, segments)) == 1500
    assert set(np.concatenate([segment.payload for segment in segments])) == {0.0, 0.3}
    # What the twin predicts over a segment from its true start is what the emulation did, grips included.
    theta, omega = log.stack("theta"), log.stack("omega")
    held = np.append(log.columns["payload_mass"][1:], log.columns["payload_mass"][-1:])
    assert held.max() > 0.19
    for number, segment in enumerate(segments[:-1]):
        first = 100 * number
        start = Start(tuple(theta[first]), tuple(omega[first]))
        exact = Experiment(segment.measured, segment.volts, held[first : first + 100], start)
        problem = Problem((exact,), (), ARM, offsets=False)
        assert np.abs(problem.simulate(problem.start())[0] - theta[first : first + 100]).max() < 1e-9
    gripped = log.columns["box_gripped"]
    empty = from_log(log)
    assert not any(segment.payload.any() for segment in empty)
    assert 0 <= np.count_nonzero(~gripped) - sum(map(len, empty)) < 12 * (1 + np.count_nonzero(np.diff(gripped)))
    with pytest.raises(IdentificationError, match="a box was held all the time"):
        from_log(log.part(int(np.argmax(gripped)), int(np.argmax(gripped)) + 120))


def test_no_segment_reaches_over_ticks_that_a_log_lacks(run_cell: Callable[..., Log]) -> None:
    log = run_cell(30.0, 3)
    kept = np.delete(np.arange(len(log)), [150, 151, 1234])
    torn = Log({name: column[kept] for name, column in log.columns.items()})
    readings = {row.tobytes(): tick for tick, row in enumerate(log.stack("measured"))}
    for box_mass in (None, 0.2):
        for segment in from_log(torn, box_mass):
            ticks = [readings[row.tobytes()] for row in segment.measured]
            assert np.diff(ticks).tolist() == [1] * (len(ticks) - 1)

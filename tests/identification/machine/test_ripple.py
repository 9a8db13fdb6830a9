"""Ripple is found where there is any, and nowhere else."""

from dtwin.identification.machine.ripple import fit_with_ripple
from dtwin.identification.machine.sheet import sheet
from dtwin.parameters import ArmParameters
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import MACHINE_NAMES, vector_of
from tests.support.segments import motions

ARM = ArmParameters()
FREE = ("D1", "D2", "D3")


def test_the_ripple_of_two_motors_is_found_with_honest_intervals() -> None:
    wavy = Effects(ripple_sin=(0.006, 0.0, 0.0), ripple_cos=(-0.003, 0.0, 0.006), ripple_periods=(17.3, 20.0, 33.6))
    truth = vector_of(ARM, wavy)
    fit = fit_with_ripple(motions(truth, 24, 1), FREE, vector_of(ARM, NO_EFFECTS), sheet(ARM))
    rippling = [name for name in fit.problem.free if name.startswith("ripple")]
    assert {name[-1] for name in rippling} == {"1", "3"}
    for name in rippling:
        error = fit.values[name] - truth[MACHINE_NAMES.index(name)]
        assert abs(error) < 3 * fit.deviations[name], name
        assert fit.deviations[name] < 0.5 * sheet(ARM)[name].deviation, name


def test_where_nothing_ripples_no_ripple_is_found() -> None:
    smooth = vector_of(ARM, NO_EFFECTS)
    fit = fit_with_ripple(motions(smooth, 12, 2), FREE, smooth, sheet(ARM))
    assert fit.problem.free == FREE

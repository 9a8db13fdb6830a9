"""Hypothesis strategies of the twin's tests: valid arms, states and payloads of any usual size."""

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

from dtwin.parameters import ArmParameters

DEFAULT = ArmParameters()
Array = npt.NDArray[np.float64]


def reals(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def triples(strategy: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(strategy, strategy, strategy)


def vectors(size: int, low: float, high: float) -> st.SearchStrategy[Array]:
    return st.lists(reals(low, high), min_size=size, max_size=size).map(np.array)


arms = st.builds(
    ArmParameters,
    voltage_constant=triples(reals(0.01, 1.0)),
    mass=triples(reals(0.01, 2.0)),
    inertia=triples(reals(1e-5, 1e-2)),
    length=triples(reals(0.05, 0.5)),
    com=triples(reals(0.0, 0.5)),
    damping=triples(reals(0.0, 0.2)),
    coulomb=triples(reals(0.0, 0.05)),
)
angles = vectors(3, -7.0, 7.0)
velocities = vectors(3, -10.0, 10.0)
accelerations = vectors(3, -100.0, 100.0)
payloads = reals(0.0, 0.5)


def vector(parameters: ArmParameters) -> Array:
    return np.array(parameters.vector())

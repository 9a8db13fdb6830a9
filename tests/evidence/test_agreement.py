"""The emulation (MuJoCo) and the analytic twin are two independent physics of one arm."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.plant import Plant
from dtwin.parameters import ArmParameters, JointVector
from dtwin.twin.dynamics import forward_dynamics
from evidence.validation import AGREEMENT, validate
from tests.support.examples import examples

PLANT = Plant()


def triples(low: float, high: float) -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(*[st.floats(low, high)] * 3)


ARMS = st.builds(
    ArmParameters,
    voltage_constant=triples(0.02, 1.0),
    mass=triples(0.02, 0.5),
    inertia=triples(5e-5, 5e-3),
    length=triples(0.05, 0.3),
    com=triples(1e-3, 0.3),  # MuJoCo rounds offsets of nanometres to none
    damping=triples(0.0, 0.1),
    coulomb=triples(0.0, 0.02),
)


@examples(1000)
@given(
    arm=ARMS,
    theta=triples(-math.pi, math.pi),
    omega=triples(-10.0, 10.0),
    volts=triples(-10.0, 10.0),
    payload=st.floats(0.0, 0.5),
)
def test_accelerations_agree(
    arm: ArmParameters, theta: JointVector, omega: JointVector, volts: JointVector, payload: float
) -> None:
    PLANT.set_parameters(arm)
    PLANT.set_payload(payload)
    emulated = np.array(PLANT.acceleration(theta, omega, (*volts, 0.0)))
    twin = forward_dynamics(np.array([*theta, *omega]), np.array(volts), np.array(arm.vector()), payload)
    assert np.abs(emulated - twin).max() <= 1e-9 * max(1.0, np.abs(twin).max())


def test_unpowered_runs() -> None:
    outcomes = validate()
    failed = [(o.case.name, check) for o in outcomes for check in o.checks if not check.passed]
    assert not failed
    drops = [o for o in outcomes if o.case.name.startswith("drop")]
    assert [o.case.payload for o in drops] == [0.0, 0.2]
    assert all(o.difference <= AGREEMENT for o in drops)

"""Every error of a machine's encoders against its equation."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.encoding import Encoding
from dtwin.emulation.machine.sections import Machine, Sensing, Transmission
from dtwin.parameters import PERIOD
from dtwin.signals import Voltages
from tests.emulation.machine.bench import joint

angles = st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4)


def encoding(sensing: Sensing, seed: int = 0) -> Encoding:
    return Encoding(sensing, np.random.default_rng(seed))


@given(angles, st.integers(4, 20))
def test_resolution(true: list[float], bits: int) -> None:
    quantum = math.tau / 2**bits
    found = encoding(Sensing(bits=bits)).read(true)
    for reading, angle in zip(found[:3], true[:3], strict=True):
        assert abs(reading - angle) <= quantum / 2 + 1e-12
        assert reading == quantum * round(reading / quantum)
    assert found[3] == true[3]


@given(angles)
def test_mounting(true: list[float]) -> None:
    sensing = Sensing(eccentricity=(0.01, 0.0, 0.02), eccentricity_phase=(0.5, 0.0, -1.0), scale=(0.0, 0.01, -0.002))
    found = encoding(sensing).read(true)
    assert found[0] == pytest.approx(true[0] + 0.01 * math.sin(true[0] + 0.5))
    assert found[1] == pytest.approx(1.01 * true[1])
    assert found[2] == pytest.approx(0.998 * (true[2] + 0.02 * math.sin(true[2] - 1.0)))


def noise(sensing: Sensing, samples: int = 20_000) -> np.ndarray:
    """What the three joints read at rest, shape (samples, 3)."""
    tested = encoding(sensing, seed=3)
    return np.array([tested.read([0.0] * 4)[:3] for _ in range(samples)])


def test_gaussian_and_uniform_noise() -> None:
    gaussian = noise(Sensing(noise=0.01))
    assert gaussian.std(axis=0) == pytest.approx([0.01] * 3, rel=0.02)  # 4 standard errors of 1 / sqrt(2 n)
    assert gaussian.mean(axis=0) == pytest.approx([0.0] * 3, abs=4 * 0.01 / math.sqrt(20_000))
    uniform = noise(Sensing(noise=0.01, noise_kind="uniform"))
    assert uniform.min() >= 0.0
    assert uniform.max() < 0.01
    assert uniform.mean(axis=0) == pytest.approx([0.005] * 3, abs=4 * 0.01 / math.sqrt(12 * 20_000))


def test_correlated_noise_forgets_exponentially() -> None:
    samples = noise(Sensing(noise=0.01, noise_kind="correlated", noise_time=0.05), 50_000)
    # of 50,000 samples n (1 - rho) / (1 + rho), here 5,000, tell as much as independent ones
    assert samples.std(axis=0) == pytest.approx([0.01] * 3, rel=0.05)
    for lag in (1, 5, 10):
        correlation = (samples[lag:] * samples[:-lag]).mean(axis=0) / samples.var(axis=0)
        assert correlation == pytest.approx([math.exp(-lag * PERIOD / 0.05)] * 3, abs=0.05)


def test_spikes_come_at_their_rate_and_have_their_size() -> None:
    readings = noise(Sensing(spike_rate=2.0, spike=0.3))
    assert set(np.unique(readings)) == {-0.3, 0.0, 0.3}
    share = 2.0 * PERIOD
    spread = math.sqrt(share / readings.size)
    assert (readings != 0).mean() == pytest.approx(share, abs=4 * spread)
    assert (readings > 0).mean() == pytest.approx(share / 2, abs=4 * spread)


def test_a_lost_sample_is_the_last_one_again() -> None:
    tested = encoding(Sensing(loss_rate=10.0))
    readings = [tested.read([float(k)] * 4) for k in range(20_000)]
    lost = [k for k in range(1, 20_000) if readings[k] == readings[k - 1]]
    assert all(readings[k] == [float(k)] * 4 for k in range(20_000) if k not in set(lost))
    assert len(lost) / 20_000 == pytest.approx(0.1, abs=4 * math.sqrt(0.09 / 20_000))


@pytest.mark.parametrize("steps", [1, 3, 4, 9])
def test_a_delayed_sample_is_as_old_as_it_should_be(steps: int) -> None:
    """At the end of tick k the encoders read the angles of a step so many steps before."""
    step = 0.0025
    late = Emulation(machine=Machine("late", sensing=Sensing(delay=steps * step)), theta=(0.2, 0.1, 0.0))
    prompt = Emulation(machine=Machine("prompt", sensing=Sensing(scale=(1e-12,) * 3)), theta=(0.2, 0.1, 0.0))
    history = [prompt.truth().theta]
    for tick in range(12):
        command = Voltages(tick, 0.0, (1.0, -0.5, 0.3 * tick, 0.0), False)
        late.apply(command)
        late.advance(PERIOD)
        prompt.apply(command)
        for _ in range(4):
            prompt.advance(step)
            history.append(prompt.truth().theta)
        assert late.truth().theta == history[-1]
        assert late.read().theta == history[max(4 * (tick + 1) - steps, 0)]


def test_an_encoder_on_the_motor_does_not_see_the_gear() -> None:
    gear = Transmission(rotor_inertia=(0.001,) * 3, stiffness=(50.0,) * 3, backlash=(0.02,) * 3)
    plant = joint(Machine("motor", transmission=gear, sensing=Sensing(motor_side=(0.0, 0.0, 1.0))))
    plant.apply((0.0, 0.0, 2.0, 0.0))
    plant.advance(0.1)
    assert plant.sampled[2] == plant.data.qpos[plant.model.joint("rotor_3").qposadr[0]]
    assert plant.sampled[2] > plant.theta[2] + 0.01
    assert plant.sampled[:2] == list(plant.theta[:2])

"""What readings tell of encoders whose resolution, noise, spikes and losses are known, because they are emulated."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtwin.controller.excitation import ExcitationController
from dtwin.emulation.machine.encoding import Encoding
from dtwin.emulation.machine.sections import Machine, Sensing
from dtwin.errors import IdentificationError
from dtwin.identification.data import Array
from dtwin.identification.excitation.plan import PLAIN, Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.identification.machine.sensors import FEWEST, check_sensors, step_of
from dtwin.logs.log import COLUMNS, Log
from dtwin.parameters import PERIOD
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings

SECONDS = 300.0


def angles() -> Array:
    """Motions like those of work: two seconds each, with rests of as long between them, (N, 3), rad."""
    generator = np.random.default_rng(3)
    share = np.linspace(0.0, 1.0, 201)[1:]
    path = 10 * share**3 - 15 * share**4 + 6 * share**5
    parts, at = [], np.zeros(3)
    for _ in range(round(SECONDS / 4.0)):
        goal = generator.uniform(-2.0, 2.0, 3)
        parts += [at + path[:, None] * (goal - at), np.tile(goal, (200, 1))]
        at = goal
    return np.concatenate(parts)


def log_of(measured: Array, ticks: NDArray[Any] | None = None, volts: Array | None = None) -> Log:
    columns: dict[str, Any] = {name: np.full(len(measured), np.nan) for name in COLUMNS}
    columns["t"] = PERIOD * (np.arange(len(measured)) if ticks is None else ticks)
    columns |= {f"measured_{joint + 1}": measured[:, joint] for joint in range(3)}
    if volts is not None:
        columns |= {f"volts_{joint + 1}": volts[:, joint] for joint in range(3)}
    return Log(columns)


def read(**sensing: Any) -> Log:
    """What the encoders of a machine read of these motions."""
    encoding = Encoding(Sensing(**sensing), np.random.default_rng(1))
    return log_of(np.array([encoding.read([*row, 0.5])[:3] for row in angles().tolist()]))


@pytest.mark.parametrize(("bits", "noise"), [*((n, 5e-4) for n in range(8, 17)), (8, 0.0), (12, 0.0), (16, 0.0)])
def test_the_step_of_an_encoder_is_found(bits: int, noise: float) -> None:
    for encoder in check_sensors(read(bits=bits, noise=noise)).encoders:
        assert encoder.step == pytest.approx(math.tau / 2**bits, rel=1e-9)


def test_the_step_is_found_among_spikes_and_losses() -> None:
    found = check_sensors(read(bits=12, noise=5e-4, spike=0.05, spike_rate=0.2, loss_rate=0.2))
    assert found.encoders[1].step == pytest.approx(math.tau / 4096, rel=1e-9)


@pytest.mark.parametrize("noise", [0.0, 1e-4, 5e-3])
def test_readings_without_steps_have_none(noise: float) -> None:
    assert [encoder.step for encoder in check_sensors(read(noise=noise)).encoders] == [None] * 3


def test_few_readings_have_no_step() -> None:
    assert step_of(np.array([0.0, 0.1])) is None
    assert step_of(np.zeros(1000)) is None


@pytest.mark.parametrize("noise", [1e-4, 5e-4, 5e-3])
def test_noise_without_steps_is_found_in_motion_and_at_rest(noise: float) -> None:
    for encoder in check_sensors(read(noise=noise)).encoders:
        assert encoder.noise == pytest.approx(noise, rel=0.05)
        assert encoder.rest == pytest.approx(noise, rel=0.05)


@pytest.mark.parametrize("bits", [11, 12, 14])
def test_rounding_is_noise_in_motion(bits: int) -> None:
    """A rounded reading has the variance step^2 / 12 beside that of the noise (Sheppard's correction)."""
    step, noise = math.tau / 2**bits, 1e-3
    for encoder in check_sensors(read(bits=bits, noise=noise)).encoders:
        assert encoder.noise == pytest.approx(math.hypot(noise, step / math.sqrt(12.0)), rel=0.1)


def test_an_encoder_whose_noise_is_small_beside_its_step_stands_still_at_rest() -> None:
    for encoder in check_sensors(read(bits=10, noise=1e-6)).encoders:
        assert encoder.rest == pytest.approx(0.0, abs=1e-12)
        assert encoder.noise > 1e-3


def test_repetitions_of_a_reading_are_counted() -> None:
    measured = np.random.default_rng(1).standard_normal((FEWEST, 3))
    measured[100:108, 0], measured[-3:, 1] = 0.1, 0.2
    assert [encoder.repeats for encoder in check_sensors(log_of(measured)).encoders] == [7, 2, 0]


def test_uniform_noise_has_the_standard_deviation_of_uniform_noise() -> None:
    for encoder in check_sensors(read(noise=3e-3, noise_kind="uniform")).encoders:
        assert encoder.noise == pytest.approx(3e-3 / math.sqrt(12.0), rel=0.05)


@pytest.mark.parametrize("rate", [0.05, 0.5])
def test_spikes_are_counted(rate: float) -> None:
    """A share of 4 rate Ts of them has another one within two samples, which may count twice or not at all."""
    log = read(bits=14, noise=3e-4, spike=0.03, spike_rate=rate)
    off = np.abs(log.stack("measured") - angles()) > 0.02
    for encoder, count in zip(check_sensors(log).encoders, off.sum(axis=0).tolist(), strict=True):
        assert count > 0
        assert encoder.spikes * SECONDS / 3600.0 == pytest.approx(count, rel=8.0 * rate * PERIOD)


def test_losses_are_counted() -> None:
    rate = 0.5
    found = check_sensors(read(bits=12, noise=3e-4, loss_rate=rate))
    assert found.told > 0.2 * SECONDS
    assert found.lost == pytest.approx(rate * 3600.0, rel=3.0 / math.sqrt(rate * found.told))
    assert max(encoder.spikes for encoder in found.encoders) < 0.02 * rate * 3600.0


@pytest.mark.parametrize("sensing", [{}, {"bits": 12, "noise": 5e-4}, {"noise": 5e-3}, {"bits": 9, "noise": 1e-3}])
def test_sound_encoders_neither_spike_nor_lose(sensing: dict[str, Any]) -> None:
    found = check_sensors(read(**sensing))
    assert not found.lost
    assert found.missing == 0.0
    assert [encoder.spikes for encoder in found.encoders] == [0.0] * 3


def test_an_arm_that_stands_does_not_tell_losses() -> None:
    found = check_sensors(log_of(np.zeros((1000, 3))))
    assert (found.lost, found.told) == (None, 0.0)
    assert found.encoders[0].rest == 0.0


def test_ticks_that_the_log_lacks_are_counted_and_are_no_spikes() -> None:
    ticks = np.delete(np.arange(len(angles())), np.arange(100, 20_000, 200))
    found = check_sensors(log_of(angles()[ticks], ticks))
    assert found.missing == pytest.approx(100 / SECONDS * 3600.0)
    assert found.encoders[0].spikes == 0.0
    assert found.lost == 0.0


def test_what_a_cell_reads_tells_its_encoders() -> None:
    cell = Cell(CellSettings(30.0, 2, machine=Machine("twelve bits", sensing=Sensing(bits=12, noise=4e-4))))
    cell.run()
    found = check_sensors(cell.log.freeze())
    for encoder in found.encoders:
        assert encoder.step == pytest.approx(math.tau / 4096, rel=1e-9)
        assert encoder.noise == pytest.approx(math.hypot(4e-4, math.tau / 4096 / math.sqrt(12.0)), rel=0.25)
        assert encoder.spikes == 0.0


def test_jolts_of_an_excited_arm_are_no_spikes() -> None:
    """Under a signal of whole volts a light link turns around within a tick, which is as sharp as a spike."""
    machine = Machine("twelve bits", sensing=Sensing(bits=12, noise=4e-4))
    experiment = Rig(machine=machine).measure(Plan(PLAIN), ExcitationController(), np.random.default_rng(1))
    work = read(bits=12, noise=4e-4).stack("measured")
    both, ticks = np.concatenate((work, experiment.measured)), np.arange(len(work) + len(experiment))
    ticks[len(work) :] += 100
    volts = np.concatenate((np.zeros_like(work), experiment.volts))
    blind = check_sensors(log_of(both, ticks))
    seen = check_sensors(log_of(both, ticks, volts))
    counts = [SECONDS / 3600.0 * sum(e.spikes for e in found.encoders) for found in (blind, seen)]
    assert counts[0] > 5.0
    assert counts[1] < 1.5


def test_too_few_samples_and_readings_that_are_none_are_refused() -> None:
    with pytest.raises(
        IdentificationError, match=f"too few samples to judge sensors: 499, expected at least {FEWEST}"
    ):
        check_sensors(log_of(np.zeros((499, 3))))
    torn = np.zeros((1000, 3))
    torn[7, 1] = math.nan
    with pytest.raises(IdentificationError, match="reading of joint 2 in row 7: expected a finite number"):
        check_sensors(log_of(torn))


def test_truth_is_not_looked_at(run_cell: Callable[..., Log]) -> None:
    log = run_cell(30.0, 3)
    blind = Log({**log.columns, **{name: np.full(len(log), np.nan) for name in ("theta_1", "omega_2")}})
    assert check_sensors(blind) == check_sensors(log)

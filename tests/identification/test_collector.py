from collections.abc import Collection, Iterable, Iterator

import numpy as np
import pytest

from dtwin.bus.messages import Acted
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.errors import IdentificationError
from dtwin.identification.collector import SignalCollector, divided
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.excitation.plan import PLAIN, SAMPLES
from dtwin.identification.parsing import free_names, settings_for
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors, Voltages
from tests.support.identification import ARM, clean, measured


def traffic(ticks: int, ask_at: int, lose: Collection[int] = ()) -> Iterator[tuple[Sensors, Voltages]]:
    """Samples and commands of a running cell in which an operator asks for the signal at a tick."""
    emulation, controller = Emulation(seed=3, noise=0.002), EmbeddedController()
    request = controller.resource.server("TWIN.IDENTIFICATION.REQUEST")
    for tick in range(ticks):
        if tick == ask_at:
            request.exchange((True,))
        sensors = emulation.read()
        command = controller.step(sensors)
        if tick not in lose:
            yield sensors, command
        emulation.apply(command)
        emulation.advance(PERIOD)


def collected(pairs: Iterable[tuple[Sensors, Voltages]]) -> SignalCollector:
    collector = SignalCollector(PLAIN, SAMPLES, 0.2)
    for sensors, command in pairs:
        collector.add(sensors)
        collector.add(command)
    return collector


def test_the_signal_is_found_in_a_running_cell_and_identifies_the_arm() -> None:
    collector = collected(traffic(700, ask_at=220))
    assert collector.complete
    experiment = collector.experiment()
    assert np.array_equal(experiment.volts, PLAIN.volts())
    part, rest = divided(experiment)
    assert (len(part), len(rest)) == (280, 70)
    estimate = identify([experiment], settings_for("K2,K3,I,c,D"))
    assert estimate.converged
    assert estimate.whiteness.white
    assert estimate.identifiability.unidentifiable == ()
    for name in estimate.problem.free:
        assert abs(estimate.values[name] - ARM.get(name)) < 4.5 * estimate.standard_errors[name], name


def test_no_signal_is_no_experiment() -> None:
    collector = collected(traffic(300, ask_at=-1))
    assert collector.done == 0
    with pytest.raises(IdentificationError, match="the signal was seen for only 0 of 350 ticks"):
        collector.experiment()


def test_what_acted_counts_where_a_command_is_late_or_missing() -> None:
    """A late bridge leaves a sample without an answer in time: the emulator holds the last command, and says so."""
    collector = SignalCollector(PLAIN, SAMPLES, 0.2)
    emulation, controller = Emulation(seed=3), EmbeddedController()
    controller.resource.server("TWIN.IDENTIFICATION.REQUEST").exchange((True,))
    missing, late = {40, 41, 200}, {90, 91}
    command = Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False)
    for tick in range(SAMPLES + 5):
        sensors = emulation.read()
        collector.add(sensors)
        if tick in missing | late:
            collector.add(Acted(sensors.sequence, sensors.time, command.volts, command.box_gripped))
        if tick not in missing:
            answer = controller.step(sensors)
            collector.add(answer)
            command = command if tick in late else answer
        emulation.apply(command)
        emulation.advance(PERIOD)
    assert collector.complete
    experiment = collector.experiment()
    assert len(experiment) == SAMPLES + 3
    assert np.array_equal(experiment.volts[39:42], experiment.volts[[39, 39, 39]])
    exact = identify([experiment], settings_for("K2,K3,I,c,D"))
    assert max(abs(exact.values[name] / ARM.get(name) - 1) for name in exact.problem.free) < 1e-5


def test_a_lost_sample_is_named() -> None:
    with pytest.raises(IdentificationError, match=r"broke off after 101 of 350 ticks, at 3\.00 s"):
        collected(traffic(700, ask_at=200, lose={300}))


@pytest.mark.parametrize("apart", [3, 300])
def test_order_does_not_matter(apart: int) -> None:
    """Samples and commands come from two senders: each in order, but not one after the other."""
    pairs = list(traffic(420, ask_at=10))
    expected = collected(pairs).experiment()
    collector = SignalCollector(PLAIN, SAMPLES, 0.2)
    for tick in range(len(pairs) + apart):
        for sensors, _ in pairs[tick : tick + 1]:
            collector.add(sensors)
        if tick >= apart and not collector.complete:
            collector.add(pairs[tick - apart][1])
    assert collector.experiment().fingerprint == expected.fingerprint


def test_what_an_operator_types() -> None:
    assert free_names("K, m2 D") == ("K1", "K2", "K3", "m2", "D1", "D2", "D3")
    settings = settings_for("mu,D1", priors=["D1=0.05+-0.01"])
    assert settings.known.coulomb == (0.01, 0.01, 0.01)
    assert settings.priors["D1"].deviation == 0.01
    assert len(measured(samples=60)) == 60
    assert len(clean()) == 350

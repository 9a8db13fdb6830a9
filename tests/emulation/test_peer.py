import mujoco
import numpy as np
import pytest

from dtwin.emulation import peer
from dtwin.emulation.plant import Plant
from dtwin.errors import DtwinError
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.estimation.problem import LOWER, UPPER
from dtwin.parameters import symbol_of
from tests.support.identification import ARM, FREE, SETTINGS, noisy

needs_peer = pytest.mark.skipif(not peer.is_installed(), reason="pip install 'mujoco[sysid]' to run this")


def test_the_peer_gets_the_same_arm() -> None:
    model = peer._spec(ARM, 0.2).compile()
    data = mujoco.MjData(model)
    plant = Plant(ARM)
    plant.reset((0.0, 0.0, 0.0))
    plant.set_weight(0.2)
    data.ctrl[:3] = 1.0, -0.5, 0.3
    plant.apply((1.0, -0.5, 0.3, 0.0))
    for _ in range(200):
        mujoco.mj_step(model, data)
    plant.advance(0.5)
    assert data.qpos[:3] == pytest.approx(plant.theta, abs=1e-6)


@needs_peer
def test_the_peer_finds_the_same_minimum() -> None:
    experiment = noisy(0, 0.005)
    ours = identify([experiment], SETTINGS)
    bounds = {name: (LOWER[symbol_of(name)], UPPER[symbol_of(name)]) for name in FREE}
    found = peer.fit(experiment.measured, experiment.volts, np.zeros(3), 0.2, SETTINGS.known, bounds)
    for name in FREE:
        assert abs(found.values[name] - ours.values[name]) < 6 * ours.standard_errors[name]


def test_a_missing_peer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peer, "is_installed", lambda: False)
    with pytest.raises(DtwinError, match=r"pip install 'mujoco\[sysid\]'"):
        peer.fit(np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3), 0.0, ARM, {})

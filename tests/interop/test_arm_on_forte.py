"""The application of an arm of six joints on a real 4diac FORTE and on the embedded device: equal bits."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dtwin.arm.poses import Poses, drawn_poses, poses_text
from dtwin.cli import main
from dtwin.controller.chain.application import PORT, VERDICT_PORT, Control, inputs, messages
from dtwin.controller.chain.embedded import ChainController
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import machine_of
from dtwin.emulation.chain.plant import ChainPlant
from dtwin.equations.rigid import usual_inertia
from iec61499.deploy.build import deploy, suited
from iec61499.deploy.plan import plan_deployment
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import device_network
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.client import BlockingClient
from tests.support.devices import PATIENCE, embedded
from tests.support.forte import FORTES, forte
from tests.support.ports import free_ports
from tests.support.waiting import connected

SECONDS = 20.0
STOPS = 15.0
"""When the encoder of the second joint stops, s."""


@pytest.mark.parametrize("device", [pytest.param("embedded", id="embedded"), *FORTES])
@pytest.mark.parametrize("name", ["six-axis", "servo-2r"])
def test_an_arm_has_the_same_commands(name: str, device: str, tmp_path: Path) -> None:
    """Also one whose drives take positions; and with an encoder that stops, for which a brake is engaged."""
    arm = arm_of(name)
    poses = Poses(drawn_poses(arm, 4, np.random.default_rng(5)).positions, 0.1, True)
    (tmp_path / "poses.toml").write_text(poses_text(poses))
    assert main(["fb", "make", name, str(tmp_path / "arm.sys"), "--poses", str(tmp_path / "poses.toml")]) == 0
    library = Library([tmp_path])
    network = device_network(library.load_system(tmp_path / "arm.sys"))
    ports = dict(zip((PORT, VERDICT_PORT), free_ports(2), strict=True))
    served = embedded() if device == "embedded" else forte(tmp_path, binary=device)
    with served as management, connected(lambda: ManagementClient(management, PATIENCE)) as client:
        deploy(client, suited(client, partial(plan_deployment, "EMB_RES", network, library, ports)))
        address = Address(LOOPBACK, ports[PORT])
        layouts = messages(len(arm))
        with connected(lambda: BlockingClient(address, *layouts, PATIENCE)) as remote:
            controller = ChainController(len(arm), inputs(arm, usual_inertia(arm), Control(), poses))
            plant = ChainPlant(machine_of("nominal", arm), poses.positions[0])
            positions = plant.read().tolist()
            for tick in range(round(SECONDS / arm.period)):
                stopped, positions = positions[1], plant.read().tolist()
                if tick * arm.period > STOPS:
                    positions[1] = stopped
                command = controller.step(positions)
                answer = (*command, controller.grips, *controller.brakes)
                assert remote.exchange((*positions, 0)) == answer, f"tick {tick}"
                plant.apply(command, controller.brakes)
                plant.advance()
    assert controller.pose > 0
    assert controller.stop > 0
    assert controller.brakes[1] is (arm.joints[1].brake is not None)

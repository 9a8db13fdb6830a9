"""An arm with a device for every joint: the commands of one device, bit by bit.

The devices are `dtwin fb run` with datagrams between them, and FORTEs, if there is one, with acknowledged events.
SPLIT_ARM in the environment is the arm, SPLIT_DURATION the simulated time, s.
"""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
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
from iec61499.distribution import FIRST_PORT
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.mapping import device_network
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.client import BlockingClient
from tests.support.devices import PATIENCE, embedded
from tests.support.forte import FORTE, NO_FORTE, forte
from tests.support.ports import free_ports
from tests.support.waiting import connected

NAME = os.environ.get("SPLIT_ARM", "planar-2r")
SECONDS = float(os.environ.get("SPLIT_DURATION", "4"))


@contextmanager
def one_device_a_joint(folder: Path, joints: int, acknowledged: bool) -> Iterator[Address]:
    """The application on its devices, FORTEs if events are acknowledged; where the arm connects to the first."""
    library = Library([folder])
    system = library.load_system(folder / "arm.sys", acknowledged)
    assert len(system.devices) == joints + 1
    asked = [PORT, VERDICT_PORT, *range(FIRST_PORT, FIRST_PORT + 4 * joints)]
    ports = dict(zip(asked, free_ports(len(asked)), strict=True))
    with ExitStack() as stack:
        for device in reversed(system.devices):  # the first one starts last: it finds the others listening
            (folder / device.name).mkdir()
            address = stack.enter_context(forte(folder / device.name) if acknowledged else embedded())
            client = stack.enter_context(connected(partial(ManagementClient, address, PATIENCE)))
            network = device_network(system, f"{device.name}.EMB_RES")
            deploy(client, suited(client, partial(plan_deployment, "EMB_RES", network, library, ports)))
        yield Address(LOOPBACK, ports[PORT])


@pytest.mark.parametrize(
    "acknowledged",
    [False, pytest.param(True, marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE))],
    ids=["datagrams", "acknowledged on FORTE"],
)
def test_a_device_for_every_joint_gives_the_commands_of_one(acknowledged: bool, tmp_path: Path) -> None:
    arm = arm_of(NAME)
    n = len(arm)
    poses = Poses(drawn_poses(arm, 4, np.random.default_rng(5)).positions, 0.1, True)
    (tmp_path / "poses.toml").write_text(poses_text(poses))
    made = ["fb", "make", NAME, str(tmp_path / "arm.sys"), "--poses", str(tmp_path / "poses.toml")]
    assert main([*made, "--devices", "joints"]) == 0
    controller = ChainController(n, inputs(arm, usual_inertia(arm), Control(), poses))
    plant = ChainPlant(machine_of("nominal", arm), poses.positions[0])
    with (
        one_device_a_joint(tmp_path, n, acknowledged) as address,
        connected(lambda: BlockingClient(address, *messages(n), PATIENCE)) as remote,
    ):
        gone = set()
        for tick in range(round(SECONDS / arm.period)):
            positions = plant.read().tolist()
            command = controller.step(positions)
            assert remote.exchange((*positions, 0)) == (*command, False, *controller.brakes), f"tick {tick}"
            plant.apply(command, controller.brakes)
            plant.advance()
            gone.add(controller.pose)
    assert len(gone) > 1

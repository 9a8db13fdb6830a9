"""A cell of another arm than the thesis's whose blocks run on a 4diac FORTE."""

import json
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from dtwin.arm.model import ArmModel, ArmTuning
from dtwin.bus.chain.messages import JointAdjustment, JointModel, JointSensors
from dtwin.bus.messages import ADJUSTMENT, EVENTS, MODEL, MONITORING
from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.controller.chain.application import inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.controller.chain.model import held_inputs
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import drawn
from dtwin.equations.rigid import usual_inertia
from dtwin.run.arm_cell import ArmCell
from dtwin.services.chain.device import DeviceBlocks
from dtwin.services.runfile import join
from dtwin.signals import Event
from tests.services.test_other_arm import assert_nothing_more_fails
from tests.support.desk import Desk
from tests.support.forte import FORTES, forte
from tests.support.waiting import until


def test_blocks_of_another_arm_are_deployed_to_nothing_but_a_forte(desk: Desk) -> None:
    words = ["--arm", "planar-2r", "--controller", "tcp://127.0.0.1:61499"]
    assert "expected embedded or forte://HOST:PORT" in desk.run("up", *words, status=2)


@pytest.mark.parametrize("binary", FORTES)
def test_a_forte_moves_another_arm_as_the_blocks_in_the_bridge_do(desk: Desk, tmp_path: Path, binary: str) -> None:
    served, headless = tmp_path / "served.parquet", tmp_path / "headless.parquet"
    words = ["--arm", "planar-2r", "--machine", "7", "--seed", "3", "--duration", "9"]
    with forte(tmp_path, binary=binary) as address:
        up = ["--controller", f"forte://{address}", "--pace", "lockstep", "--log", str(served), "--json"]
        assert json.loads(desk.up(*words, *up))["ticks"] == 900
    desk.run("run", *words, "--log", str(headless), "--json")
    found, expected = pq.read_table(served), pq.read_table(headless)
    assert found.schema.names == expected.schema.names
    for name in expected.schema.names:
        kept, told = (np.asarray(table[name]) for table in (expected, found))
        if name.startswith("target"):  # which a FORTE prints with 15 digits
            assert np.allclose(told, kept, rtol=0.0, atol=1e-12), name
        else:
            assert np.array_equal(told, kept), name


@pytest.mark.parametrize("binary", FORTES)
def test_recovery_and_uploads_reach_the_blocks_on_a_forte(desk: Desk, tmp_path: Path, binary: str) -> None:
    words = ["--arm", "planar-2r", "--machine", "7", "--pace", "lockstep", "--monitoring", "--healthy", "30"]
    verdicts: list[MonitoringVerdict] = []
    events: list[Event] = []
    with forte(tmp_path, binary=binary) as address:
        given = ["--recovery", "act", "--fault", "K1*=0.7@45", "--controller", f"forte://{address}"]
        desk.detach(*words, *given)
        with join("cell") as bus:
            bus.subscribe(MONITORING, MonitoringVerdict, verdicts.append)
            bus.subscribe(EVENTS, Event, events.append)
            until(lambda: verdicts and verdicts[-1].units["joint 1"].state == "nominal", "the arm is known", 120.0)
            until(lambda: any(event.kind == "recovery" for event in events), "the fault is answered", 120.0)
            found = bus.ask(ADJUSTMENT, None, JointAdjustment)
            assert found.strength == pytest.approx((0.7, 1.0), abs=0.05)
            assert_nothing_more_fails(verdicts, events, 20.0)  # a minute of it is watched of blocks in the bridge
            arm = arm_of("planar-2r")
            model = JointModel("test", "as it really is", ArmModel.of(drawn(arm, 7)))
            assert bus.ask(MODEL, model, JointModel) == model
        assert desk.run("stop").startswith("standstill")
        assert desk.run("release").startswith("none")
        assert "down" in desk.run("down")


@pytest.mark.parametrize("binary", FORTES)
def test_a_forte_gets_gains_and_speeds_as_blocks_in_this_process_do(tmp_path: Path, binary: str) -> None:
    settings = ArmCell(arm="planar-2r").settings(1.0)
    arm, inertia = settings.arm, usual_inertia(settings.arm)
    given = inputs(arm, inertia, settings.control, settings.poses)
    tuned = held_inputs(arm, inertia, settings.control.tuned(ArmTuning(pole=9.0, observer=60.0, speed=0.5)))
    near = ChainController(len(arm), given)
    with forte(tmp_path, binary=binary) as address:
        far = DeviceBlocks(address, len(arm), lambda: given)
        for k in range(120):
            if k in (40, 80):  # on the way, and back again
                changed = tuned if k == 40 else held_inputs(arm, inertia, settings.control)
                near.reckon_with(changed)
                far.reckon_with(changed)
            where = tuple(float(x) + 1e-4 * k for x in settings.poses.positions[0])
            assert far.step(JointSensors(k, k * arm.period, where)).commands == near.step(where), k

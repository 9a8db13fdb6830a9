"""A cell of another arm than the thesis's on the bus: what it logs, how it is stopped, and what outlives a kill."""

import json
import os
import signal
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from dtwin.arm.file import MODELS
from dtwin.bus.chain.messages import JointSensors
from dtwin.bus.messages import JOINT_SENSORS
from dtwin.services.chain.starting import ENDINGS
from dtwin.services.runfile import join
from tests.run.test_chain_sorting import TASK
from tests.support.desk import Desk
from tests.support.waiting import until

CELL = 'arm = "planar-2r"\nmachine = "7"\nsort = "task.toml"\nlate = 1\n'


def test_all_models_of_arms_are_taken_for_arms() -> None:
    assert set(ENDINGS) == {".toml", *MODELS}


def test_lockstep_over_zenoh_logs_what_a_headless_run_of_the_arm_logs(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "task.toml").write_text(TASK)
    (tmp_path / "cell.toml").write_text(CELL)
    served, headless = tmp_path / "served.parquet", tmp_path / "headless.parquet"
    words = ["--cell-file", str(tmp_path / "cell.toml"), "--seed", "3", "--duration", "9"]
    summary = json.loads(desk.up("--pace", "lockstep", *words, "--log", str(served), "--json"))
    counted = json.loads(desk.run("run", *words, "--log", str(headless), "--json"))["boxes"]
    assert pq.read_table(served).equals(pq.read_table(headless), check_metadata=True)
    assert summary["ticks"] == 900
    assert set(summary["services"]) == {"recorder", "bridge", "emulator"}
    assert counted["delivered"] > 0
    assert summary["boxes"]["delivered"] == counted["delivered"]
    assert not desk.processes()


def test_an_arm_in_real_time_is_watched_stopped_released_and_outlives_its_services(
    desk: Desk, tmp_path: Path
) -> None:
    log = tmp_path / "run.parquet"
    desk.detach("--arm", "planar-2r", "--machine", "nominal", "--log", str(log))
    until(lambda: desk.summary()["ticks"] > 100, "the arm runs in real time")
    (line,) = desk.run("watch", "joints/sensors", "--count", "1").splitlines()
    assert line.startswith("dtwin/cell/planar-2r/joints/sensors sequence=")
    assert "the function blocks run in the bridge" in desk.run("status")
    assert desk.run("stop").startswith("standstill")
    with join("cell") as bus:
        samples: list[JointSensors] = []
        bus.subscribe(JOINT_SENSORS, JointSensors, samples.append)
        until(lambda: len(samples) > 20, "samples come")
        assert max(np.ptp([sample.theta for sample in samples], axis=0)) < 1e-3
    os.kill(desk.find("chain.bridge"), signal.SIGKILL)
    back = {"restarts": 1, "state": "stopped"}.items()
    until(lambda: back <= desk.summary()["services"]["bridge"].items(), "the bridge is back, and so is the stop")
    assert desk.run("release").startswith("none")
    tick = desk.tick()
    until(lambda: desk.tick() > tick + 50, "the arm goes on")
    assert "down" in desk.run("down")
    t = np.asarray(pq.read_table(log)["t"])
    assert np.allclose(np.diff(t), 0.01), "no tick is missing, whatever was killed"

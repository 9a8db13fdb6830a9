"""An arm of a line does what it does alone, and a line does the same wherever its blocks run."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.model import ArmTuning
from dtwin.bus.line.plant import ArmSettings, JointSettings
from dtwin.line.control import Exchange, OneResource
from dtwin.line.file import line_of
from dtwin.line.followed import Followed
from dtwin.line.line import Line
from dtwin.line.records.kept import COURSE, HISTORY, prepare, write
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import FREE, settings_text
from dtwin.line.stations import emulated, replayed
from dtwin.parameters import ROOT, ArmParameters
from tests.support.forte import FORTE, NO_FORTE
from tests.support.lockstep import Lockstep, on_fortes, on_processes

CELLS = ROOT / "lines" / "cells"
PLAN = line_of("default").stations[0]
DURATION = 90.0
FAULTS = (("a1", "K2*=0.6@30"), ("a2", "lock2@60"))
"""One after which an arm works on with other settings, and one that has operations moved elsewhere."""


def joints(count: int) -> str:
    """Settings for an arm of so many joints, the first of which has lost a little torque."""
    adjustment = replace(Adjustment.none(count), strength=(0.9, *(1.0,) * (count - 1)))
    return settings_text(JointSettings(ArmTuning(speed=0.8), adjustment))


@pytest.mark.parametrize(
    ("cell", "settings"),
    [
        (None, settings_text(ArmSettings(2.6, ArmParameters()))),
        ("planar-2r", joints(2)),
        ("six-axis", joints(6)),
    ],
)
def test_the_log_of_an_arm_in_the_line_is_that_of_the_arm_alone(
    cell: str | None, settings: str, tmp_path: Path
) -> None:
    plan = replace(PLAN, cell_file=None if cell is None else str(CELLS / f"{cell}.toml"))
    inside = emulated(plan)
    inside.advance(500)
    inside.give("bring", 0.2, "red")
    inside.give("fault", text="K1*=0.9@7")
    while inside.advance(10).arm != FREE:
        pass
    inside.give("settings", text=settings)
    inside.give("bring", 0.2, "blue")
    for ticks in (10, 10, 30, 7, 200):
        inside.advance(ticks)
    inside.give("failed")
    inside.advance(60)
    inside.give("release")
    inside.advance(100)
    last = inside.inputs[-1].tick + 100
    alone = replayed(plan, inside.inputs, last)
    for name, station in (("inside", inside), ("alone", alone)):
        station.write_log(tmp_path / f"{name}.parquet")
    assert (tmp_path / "inside.parquet").read_bytes() == (tmp_path / "alone.parquet").read_bytes()
    assert pq.read_metadata(tmp_path / "alone.parquet").num_rows == last
    assert alone.inputs == inside.inputs


def of_three_kinds(folder: Path) -> Line:
    """The usual line with another arm in each zone, to which boxes come faster."""
    text = (ROOT / "lines" / "default.toml").read_text().replace("every = 24.0", "every = 14.0")
    for node, cell in (("a2_dock", "planar-2r"), ("b1_dock", "six-axis")):
        text = text.replace(f'node = "{node}"\n', f'node = "{node}"\ncell = "{CELLS / cell}.toml"\nmachine = "4"\n')
    (folder / "three.toml").write_text(text)
    return line_of(str(folder / "three.toml"))


def run_in(folder: Path, line: Line, blocks: Exchange | None = None, devices: bool = False) -> LineRun:
    """A run that is kept in a folder, of blocks elsewhere if any are given."""
    followed = None if blocks is None else Followed(blocks, OneResource(line))
    run = LineRun(line, LineSettings(DURATION, "act", FAULTS, devices), prepare(folder), followed)
    run.run()
    write(run, folder)
    return run


Host = Callable[[Line, Path], AbstractContextManager[Lockstep]]


@pytest.mark.thorough
@pytest.mark.parametrize(
    "host",
    [
        pytest.param(on_processes, id="processes"),
        pytest.param(on_fortes, id="fortes", marks=pytest.mark.skipif(not FORTE, reason=NO_FORTE)),
    ],
)
def test_a_line_with_other_arms_and_a_failing_one_does_the_same_wherever_its_blocks_run(
    host: Host, tmp_path: Path
) -> None:
    line = of_three_kinds(tmp_path)
    here = run_in(tmp_path / "here", line)
    run_in(tmp_path / "devices", line, devices=True)
    (tmp_path / "host").mkdir()
    with host(line, tmp_path / "host") as blocks:
        run_in(tmp_path / "there", line, blocks)
    files = sorted(path.name for path in (tmp_path / "here").iterdir())
    assert files == sorted([COURSE, HISTORY, "a1.parquet", "a2.parquet", "b1.parquet", "b2.parquet"])
    for name in files:
        ours = (tmp_path / "here" / name).read_bytes()
        assert (tmp_path / "devices" / name).read_bytes() == ours, name
        assert (tmp_path / "there" / name).read_bytes() == ours, name
    assert {decision.what for decision in here.course.decisions} >= {"finding", "settings", "set-up"}
    for plan in line.stations:
        alone = replayed(plan, here.emulated[plan.name].inputs, round(100 * DURATION))
        alone.write_log(tmp_path / "alone.parquet")
        assert (tmp_path / "alone.parquet").read_bytes() == (tmp_path / "here" / f"{plan.name}.parquet").read_bytes()

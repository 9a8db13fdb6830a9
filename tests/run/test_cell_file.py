"""Cells as files: the usual one byte by byte, another one that works, and what is refused, by name and reason."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

import dtwin
from dtwin.cli import main
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.errors import DtwinError
from dtwin.options import arguments, parse_options
from dtwin.parameters import HANGING, VOLTAGE_LIMIT, ArmParameters
from dtwin.run.cell_file import FOLDER, CellFile, cell_of, holding, load, names
from dtwin.run.emulate import emulate
from dtwin.run.options import ControlOptions, PlantOptions
from dtwin.run.settings import metadata, sequence_of
from dtwin.task import DEFAULT_TASK, task_of
from dtwin.twin.dynamics import gravity
from dtwin.twin.kinematics import forward


def file(folder: Path, text: str) -> Path:
    path = folder / "cell.toml"
    path.write_text(text)
    return path


def settings_of(name: str) -> dtwin.Cell:
    return dtwin.Cell(cell_file=name)


def test_the_usual_cell_with_its_file_has_the_same_log_byte_by_byte(tmp_path: Path) -> None:
    digests = []
    for number, cell in enumerate((dtwin.Cell(seed=3), dtwin.Cell(seed=3, cell_file="default"))):
        log = tmp_path / f"{number}.parquet"
        cell.run(40.0).save(log)
        digests.append(hashlib.sha256(log.read_bytes()).hexdigest())
    assert digests[0] == digests[1]


def test_the_file_of_the_usual_cell_says_what_holds_without_one() -> None:
    found, usual = cell_of("default"), CellFile()
    assert found.task == DEFAULT_TASK
    assert PlantOptions(cell_file="default").settings() == PlantOptions().settings()
    assert ControlOptions(cell_file="default").control() == ControlOptions().control()
    assert (found.noise, found.noise_kind, found.payload) == (usual.noise, usual.noise_kind, usual.payload)


def test_a_file_alone_makes_a_cell_that_sorts_as_well_as_the_first() -> None:
    first, second = (dtwin.Cell(cell_file=name, seed=1).run(120.0) for name in ("default", "four-colours"))
    assert second.score.boxes.delivered >= 10
    for score in (first.score, second.score):
        assert score.boxes.misplaced == 0
        assert score.boxes.delivered + score.boxes.held == score.boxes.picked
        assert score.placement_error_mm is not None
        assert score.placement_error_mm.max < 0.1
    task = cell_of("four-colours").task
    columns = second.arrays()
    assert set(columns["box_colour"]) <= {"", *task.colours}
    carried = columns["payload_mass"][columns["payload_mass"] > 0]
    assert task.boxes.lightest <= carried.min() <= carried.max() <= task.boxes.heaviest
    assert len(set(np.round(carried, 9))) >= 10


def test_a_log_tells_its_task() -> None:
    for name in names():
        settings = settings_of(name).settings
        assert task_of(metadata(settings)) == settings.task
    assert "task" not in metadata(settings_of("default").settings)


def test_the_blocks_get_the_places_of_the_file() -> None:
    settings = settings_of("four-colours").settings
    controller = EmbeddedController(settings.control, sequence=sequence_of(settings))
    for number, destination in enumerate(settings.task.destinations, 1):
        assert controller.resource.read(f"SEQUENCE.PLACE{number}") == destination.colour
        angles = tuple(controller.resource.read(f"SEQUENCE.PLACE{number}_{joint}") for joint in (1, 2, 3))
        assert angles == destination.place.theta
    assert controller.resource.read("CONTROLLER.PAYLOAD_MASS") == 0.24


@pytest.mark.parametrize("name", names())
def test_angles_lead_to_their_places(name: str) -> None:
    for place in cell_of(name).task.all_places.values():
        x, y, phi = forward(place.theta, ArmParameters())
        assert (x, y) == pytest.approx((place.x, place.y), abs=5e-4)
        assert np.cos(phi) == pytest.approx(1.0, abs=1e-7)


def test_holding_is_the_gravity_of_the_twin_over_the_constants_of_the_motors() -> None:
    arm = ArmParameters()
    for theta in ((0.3, -1.2, 0.7), HANGING, DEFAULT_TASK.pickup.theta):
        torque = gravity(np.array(theta), np.array(arm.vector()), 0.25, False)
        np.testing.assert_allclose(holding(theta, arm, 0.25), torque / np.array(arm.voltage_constant), atol=1e-12)


def test_options_count_more_than_the_file(tmp_path: Path) -> None:
    path = file(
        tmp_path,
        'machine = "servo"\nfaults = ["D1*=2@5"]\n[arm]\nm1 = 0.15\nm2 = 0.12\n[noise]\nmagnitude = 0.01\n'
        "[control]\ntarget_time = 3.0\nkp = [100.0, 100.0, 100.0]\n",
    )
    plant = PlantOptions(cell_file=str(path), machine="ideal", noise=0.0, set=("m1=0.2",), fault=("slip@9",))
    found = plant.settings()
    assert (found.machine.name, found.noise, found.arm.mass[:2]) == ("ideal", 0.0, (0.2, 0.12))
    assert [str(fault) for fault in found.faults] == ["D1*=2@5", "slip@9"]
    assert PlantOptions(cell_file=str(path)).settings().machine.name == "servo"
    control = ControlOptions(cell_file=str(path), target_time=1.0).control()
    assert (control.target_time, control.gains.kp) == (1.0, (100.0, 100.0, 100.0))
    other = ControlOptions(cell_file=str(path), law="computed_torque").control()
    assert other.gains.kp == (200.0, 500.0, 300.0)  # those of the file are for another law


def test_services_get_the_file_wherever_they_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = file(tmp_path, "[noise]\nmagnitude = 0.01\n")
    monkeypatch.chdir(tmp_path)
    words = arguments(PlantOptions(cell_file="cell.toml"), PlantOptions)
    assert words == ["--cell-file", str(path)]
    monkeypatch.chdir("/")
    assert parse_options(PlantOptions, "emulator", words).settings().noise == 0.01


def test_the_machine_of_a_file_lies_beside_it(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text("[drive]\nlag = 0.003\n")
    found = load(file(tmp_path, 'machine = "mine.toml"\n'))
    assert found.machine == str((tmp_path / "mine.toml").resolve())


PLACE = "[places.red]\nx = 0.15\ny = 0.15\n"
REFUSED = {
    "x = [\n": "expected a cell",
    "place = 1\n": "unknown key place: expected",
    "boxes = 3\n": "boxes: expected a section, got 3",
    "[boxes]\ncount = 3\n": "unknown key boxes.count: expected size, mass",
    "[boxes]\nmass = 0.2\n": "boxes.mass: expected `?array`?",
    "[boxes]\nmass = [0.3, 0.2]\n": "boxes.mass: expected 0.3 to 1 kg, got 0.2",
    "[boxes]\nsize = 0.05\n": "boxes.size: expected 0.02 to 0.036 m",
    "[boxes]\nevery = inf\n": "boxes.every: expected",
    "[arm]\nm4 = 1.0\n": "unknown parameter 'm4'",
    '[arm]\nm1 = "x"\n': "arm.m1: expected float, got str",
    'machine = "none"\n': "machine 'none'",
    "machine = true\n": "machine: expected a name, a file or a number",
    'faults = ["K9@1"]\n': "fault",
    "faults = [1]\n": "faults",
    '[control]\nlaw = "pid"\n': "control.law: invalid enum value",
    "[control]\ntarget_time = -1.0\n": "target time: expected",
    "[control]\npayload = 9.0\n": "payload: expected 0 to 1 kg",
    "[noise]\nmagnitude = -1.0\n": "noise",
    "[places]\n": "places: expected 1 to 6, got 0",
    "[places.Red]\nx = 0.15\ny = 0.15\n": "colour 'Red': expected a word of 1 to 24 small letters",
    "[places.pickup]\nx = 0.15\ny = 0.15\n": "colour 'pickup'",
    f'{PLACE}rgb = "red"\n': "places.red.rgb: expected #rrggbb, got 'red'",
    f'{PLACE}elbow = "left"\n': "places.red.elbow: invalid enum value",
    f'{PLACE}elbow = "up"\ntheta = [2.5298, -2.0654, -0.4644]\n': "places.red: expected theta or elbow, got both",
    f"{PLACE}theta = [0.0, 0.0, 0.0]\n": r"places.red.theta: leads to \(0.4511, 0.0000\) m: expected the place at",
    f"{PLACE}theta = [nan, 0.0, 0.0]\n": "places.red.theta: expected angles of at most 12.566 rad",
    "[places.red]\nx = 0.5\ny = 0.15\n": "places.red: the arm does not reach the place: .* the reach is",
    "[places.red]\nx = 0.15\n": "places.red: object missing required field y",
    "[pickup]\nx = 0.44\ny = 0.0\n[boxes]\nmass = [0.5, 0.9]\n": "pickup: joint 1 would need .* V to hold 0.9 kg",
    # what only the shapes tell
    "[places.red]\nx = 0.2\ny = -0.19\n": r"pickup: the arm at .* mm into red_tray: expected 1 mm of room",
    "[places.red]\nx = 0.2\ny = 0.1\n[places.blue]\nx = 0.21\ny = 0.11\n": r"(red|blue): the arm at .* mm into",
    'machine = "contact"\n[places.red]\nx = 0.2\ny = 0.1\n': "places: expected the usual ones on a machine",
    'machine = "contact"\n[boxes]\nsize = 0.03\n': "boxes.size: expected 0.036 m on a machine with contact",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_what_cannot_be_is_refused_by_name_and_reason(text: str, tmp_path: Path) -> None:
    path = file(tmp_path, text)
    with pytest.raises(DtwinError, match=REFUSED[text]):
        dtwin.Cell(cell_file=path).run(0.01)


def test_a_refusal_names_the_file(tmp_path: Path) -> None:
    path = file(tmp_path, "[boxes]\ncount = 3\n")
    with pytest.raises(DtwinError, match=f"^{path}: unknown key"):
        load(path)
    with pytest.raises(DtwinError, match=r"'defalt': expected a file .* default or four-colours"):
        cell_of("defalt")
    with pytest.raises(DtwinError, match="No such file"):
        load(tmp_path / "none.toml")
    (tmp_path / "big.toml").write_text("#" * 70_000)
    with pytest.raises(DtwinError, match="at most 65536 bytes"):
        load(tmp_path / "big.toml")


def test_the_usual_places_pass_the_checks_of_others(tmp_path: Path) -> None:
    """With boxes that differ a little all poses are looked at, which the usual cell does without."""
    path = file(tmp_path, "[boxes]\nmass = [0.1, 0.2]\n")
    cell = emulate(PlantOptions(cell_file=str(path)).settings())
    assert isinstance(cell, Emulation)


def test_a_place_can_be_reached_with_either_elbow(tmp_path: Path) -> None:
    signs = []
    for elbow in ("up", "down"):
        place = load(file(tmp_path, f'{PLACE}elbow = "{elbow}"\n')).task.places["red"]
        assert forward(place.theta, ArmParameters())[:2] == pytest.approx((0.15, 0.15), abs=1e-9)
        assert max(map(abs, holding(place.theta, ArmParameters(), 0.21))) < VOLTAGE_LIMIT
        signs.append(np.sign(np.sin(place.theta[1])))
    assert signs == [-1, 1]


def test_the_folder_of_cells_is_where_the_program_looks() -> None:
    assert sorted(path.stem for path in FOLDER.glob("*.toml")) == names() == ["default", "four-colours"]


def test_the_monitors_and_the_simulation_know_the_places_of_a_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "run.parquet"
    dtwin.Cell(cell_file="four-colours", law="computed_torque").run(30.0).save(log)
    assert main(["monitor", str(log), "--method", "thesis", "--target-time", "2.5"]) == 0
    assert main(["monitor", str(log)]) == 0
    assert main(["simulate", "--cell-file", "four-colours", "--goal", "violet"]) == 0
    capsys.readouterr()
    assert main(["simulate", "--cell-file", "four-colours", "--goal", "blue"]) == 2
    assert "unknown place 'blue': expected pickup, yellow, red, violet, green" in capsys.readouterr().err

"""Machines in files: what is written is read again, what is wrong is told with file, key and choices."""

from pathlib import Path
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.cli import main
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.drawing import draw
from dtwin.emulation.machine.files import FOLDER, load, machine_of, names, toml
from dtwin.emulation.machine.sections import IDEAL, SECTIONS, Machine, Section, declared
from dtwin.errors import DtwinError, ModelError, ParameterError
from dtwin.parameters import JointVector
from dtwin.run.settings import CellSettings, described, metadata


def of_field(kind: Any, allowed: Any) -> st.SearchStrategy[Any]:
    if allowed is None:
        return st.sampled_from(kind.__args__)
    if kind is bool:
        return st.booleans()
    number = st.floats(allowed.low, allowed.high)
    return (
        st.tuples(number, number, number)
        if kind is JointVector
        else number
        if kind is float
        else st.integers(int(allowed.low), int(allowed.high))
    )


def sections(kind: type[Section]) -> st.SearchStrategy[Section]:
    fields = st.fixed_dictionaries({}, optional={name: of_field(*about) for name, about in declared(kind).items()})

    def made(values: dict[str, Any]) -> Section:
        if any(values.get("stiffness", ())):
            values["rotor_inertia"] = (0.01,) * 3
        if any(values.get("backlash", ())):
            values |= {"stiffness": (1.0,) * 3, "rotor_inertia": (0.01,) * 3}
        return kind(**values)

    return fields.map(made)


machines = st.builds(Machine, st.text(), *(sections(kind) for kind in SECTIONS.values()))


@given(machines)
def test_a_machine_that_is_written_is_read_again(tmp_path_factory: pytest.TempPathFactory, machine: Machine) -> None:
    folder = tmp_path_factory.mktemp("machines")
    (folder / "a.toml").write_text(toml(machine), encoding="utf-8")
    (folder / "a.json").write_bytes(msgspec.json.encode(described(machine)))
    assert load(folder / "a.toml") == machine
    assert load(folder / "a.json") == machine


@given(st.integers(0, 2**63 - 1))
def test_every_number_is_a_machine_that_can_be_made(number: int) -> None:
    machine = draw(number)
    assert draw(number) == machine
    assert not machine.ideal
    Emulation(machine=machine)


def test_a_number_is_the_same_machine_everywhere() -> None:
    seventeen = machine_of("17")
    assert seventeen.drive.torque == (1.03399, 0.872731, 1.02885)
    assert seventeen.transmission.coulomb == (0.00895648, 0.00660353, 0.0259937)
    assert seventeen.structure.tilt == 0.00184955
    assert seventeen.sensing.delay == 0.00115458
    assert seventeen != draw(18)


@pytest.mark.parametrize("name", names())
def test_the_named_machines_are_what_they_are_called(name: str) -> None:
    machine = machine_of(name)
    assert machine.name == name
    assert machine.ideal == (name == "ideal")
    Emulation(machine=machine)


def test_shown_and_drawn_machines_can_be_loaded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["machine", "show", "17"]) == 0
    Path("shown.toml").write_text(capsys.readouterr().out)
    assert main(["machine", "show", "17", "--json"]) == 0
    Path("shown.json").write_text(capsys.readouterr().out)
    assert main(["machine", "draw", "17"]) == 0
    assert load(Path("shown.toml")) == load(Path("shown.json")) == load(Path("machine-17.toml")) == draw(17)
    capsys.readouterr()
    assert main(["machine", "list", "--json"]) == 0
    assert [entry["name"] for entry in msgspec.json.decode(capsys.readouterr().out)] == names()
    assert main(["machine", "list"]) == 0


WRONG = {
    "nonsense": "expected a machine",
    "[engine]\n": "unknown section 'engine': expected name, drive, transmission, structure, sensing or contact",
    "drive = 3\n": "drive: expected a section, got 3",
    "name = 3\n": "name: expected a text, got 3",
    "[drive]\nlagg = 1\n": "unknown key drive.lagg: expected torque, lag, ",
    "[drive]\nlag = 'long'\n": "drive.lag: expected a number or three, got 'long'",
    "[drive]\nlag = true\n": "drive.lag: expected a number or three, got True",
    "[drive]\nlag = [1, 2]\n": "drive.lag: expected 3 numbers, one a joint, got 2",
    "[drive]\nlag = [0, 0, '1']\n": "drive.lag: expected a number for each of the 3 joints, got '1'",
    "[drive]\nlag = 0.2\n": "drive.lag: expected a number from 0 to 0.1, got 0.2",
    "[drive]\nlag = nan\n": "drive.lag: expected a number from 0 to 0.1, got nan",
    "[drive]\nbits = 1.5\n": "drive.bits: expected a whole number, got 1.5",
    "[drive]\nsag = [1]\n": "drive.sag: expected a number, got [1]",
    "[sensing]\nnoise_kind = 'pink'\n": "sensing.noise_kind: expected uniform, gaussian or correlated, got 'pink'",
    "[transmission]\nbacklash = 0.01\n": "transmission.backlash: expected a stiffness above 0 at joint 1, got 0",
    "[transmission]\nstiffness = 50\n": "transmission.stiffness: expected a rotor_inertia above 0 at joint 1, got 0",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_wrong_with_a_file_is_told(text: str, tmp_path: Path) -> None:
    file = tmp_path / "wrong.toml"
    file.write_text(text)
    with pytest.raises(DtwinError) as error:
        load(file)
    assert str(error.value).startswith(f"{file}: ")
    assert WRONG[text] in str(error.value)
    assert "\n" not in str(error.value)


def test_what_is_no_machine_is_told(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"machine 'oops': expected a file .*, a number, or ideal, "):
        machine_of("oops")
    with pytest.raises(ModelError, match=r"none\.toml: No such file"):
        machine_of(str(tmp_path / "none.toml"))
    with pytest.raises(ParameterError, match="expected a number from 0"):
        machine_of(str(2**63))
    (tmp_path / "list.json").write_text("[]")
    with pytest.raises(ModelError, match="expected a machine with the sections"):
        machine_of(str(tmp_path / "list.json"))


def test_a_log_names_its_machine_unless_that_is_ideal() -> None:
    assert "machine" not in metadata(CellSettings())
    assert "machine" not in metadata(CellSettings(machine=Machine("my ideal")))
    noted = metadata(CellSettings(machine=machine_of("lag")))["machine"]
    assert noted == {"name": "lag", "drive": {"lag": (0.01, 0.01, 0.01)}}
    assert Machine().sections() == IDEAL.sections()
    assert not (FOLDER / "ideal.toml").exists()  # nothing in a file changes what is ideal

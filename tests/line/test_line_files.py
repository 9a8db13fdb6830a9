"""Line files: what is read, and what is told of a wrong one."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from dtwin.errors import DtwinError
from dtwin.line.file import FOLDER, line_of, load
from dtwin.line.line import block_name
from dtwin.line.system import system
from dtwin.parameters import ROOT
from iec61499.deploy.system_file import system_text

DEFAULT = (FOLDER / "default.toml").read_text()


def test_the_usual_line() -> None:
    line = line_of("default")
    assert [station.name for station in line.stations] == ["a1", "a2", "b1", "b2"]
    assert [len(zone.vehicles) for zone in line.zones] == [2, 2]
    assert line.able("mark") == ("a1", "a2", "b1", "b2")


def test_the_system_file_is_that_of_the_usual_line() -> None:
    assert (ROOT / "fb" / "line" / "line.sys").read_text() == system_text(system(line_of("default")))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('node = "source" ', 'nod = "source" ', "source: object contains unknown field nod: expected node, every"),
        ("seed = 0\n", "seeds = 0\n", "unknown field seeds: expected operations, source, sink, zones"),
        ("every = 24.0", "every = -1", "source.every: expected float > 0.0"),
        ('deburr = "a1"', 'deburr = "b1"', "assignment.deburr: expected a1 or a2, got 'b1'"),
        ('test = "b1"', 'test = "a1"', None),
        ('mark = "a2"', 'mark = "b1"', None),
        ('pack = "b2"', 'pack = "a1"', "assignment.pack: expected b1 or b2, got 'a1'"),
        ('place = "red"', 'place = "pink"', "operations.mark.place, for zones.a.stations.a1: expected"),
        ('node = "a1_dock"', 'node = "a9_dock"', "zones.a.stations.a1.node: expected"),
        (">n8>n1", ">n8", "no way leads from"),
        ("n2 = [2.0, 0.0]", "n2 = [0.1, 0.0]", "nodes n1 and n2: expected them 0.6 m apart"),
        ('"n2<>a1_dock"', '"n2"', "segments: expected nodes with > or <> between them"),
        ("capacity = 3", "capacity = 0", "capacity: expected int >= 1"),
        ("seed = 4\n", 'seed = "x"\n', "zones.b.stations.b2.seed: expected int, got str"),
        ("home2 = [2.0, -3.0]", "home2 = [2.0]", "zones.a.nodes.home2: expected"),
        (
            'home = "home2"\nspeed',
            'home = "home2"\nsped',
            "zones.a.vehicles.a_agv2: object contains unknown field sped: expected home",
        ),
        ("mass = [0.190, 0.210]", "mass = [0.19, 5.0]", "got 5 kg, for which its motors need"),
        ('home = "home1"', 'home = "home2"', "expected a dock of its own"),
        ("seed = 0", "seed = ", "expected a line"),
    ],
)
def test_a_wrong_file_is_told(tmp_path: Path, old: str, new: str, message: str | None) -> None:
    assert old in DEFAULT
    path = tmp_path / "mine.toml"
    path.write_text(DEFAULT.replace(old, new, 1))
    if message is None:
        load(path)
        return
    with pytest.raises(DtwinError) as told:
        load(path)
    assert str(path) in str(told.value)
    assert message in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("name", "other"),
    [("A1", "a1"), ("a-agv1", "a_agv1"), ("b.agv1", "b_agv1"), ("B", "b"), ("Plant", "a part of every line, plant,")],
)
def test_a_name_of_which_the_same_blocks_would_be_named_is_refused(name: str, other: str) -> None:
    line = line_of("default")
    last = line.zones[-1]
    stations = (replace(last.stations[0], name=name), *last.stations[1:])
    with pytest.raises(DtwinError, match="expected a name that nothing else of the line has"):
        replace(line, zones=(*line.zones[:-1], replace(last, stations=stations)))


def test_names_make_identifiers_of_blocks() -> None:
    assert [block_name(name) for name in ("a1", "Cell-2.b", "9")] == ["A1", "CELL_2_B", "_9"]


def test_a_line_that_is_not_there() -> None:
    with pytest.raises(DtwinError, match=r"line 'mine': expected a file \(\*.toml\) or default"):
        line_of("mine")


def test_the_line_of_the_page_is_read(tmp_path: Path) -> None:
    (text,) = re.findall(r"```toml\n(.*?)```", (ROOT / "docs" / "line.md").read_text(), re.DOTALL)
    path = tmp_path / "mine.toml"
    path.write_text(text)
    line = load(path)
    assert [station.name for station in line.stations] == ["left", "right"]
    assert line.stations[1].machine == "coulomb"

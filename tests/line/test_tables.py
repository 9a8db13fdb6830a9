"""Questions in SQL about runs of a line agree with its page, and reach nothing else."""

from pathlib import Path

import pytest

from dtwin.cli import main
from dtwin.errors import DtwinError
from dtwin.line.file import line_of
from dtwin.line.records.drawing import EVERY, Drawing
from dtwin.line.records.kept import Kept, kept, prepare, write
from dtwin.line.records.report import effectiveness
from dtwin.line.records.tables import TABLES, ask, write_tables
from dtwin.line.run import LineRun, LineSettings
from tests.view.test_write import contents

Made = tuple[LineRun, Drawing, Path]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A run in which boxes leave and a station stands, its drawing, and its folder."""
    folder = tmp_path_factory.mktemp("line") / "monday"
    run = LineRun(line_of("default"), LineSettings(150.0, "act", (("b1", "K2*=0.1@60-90"),)), prepare(folder))
    drawing = Drawing(run)
    run.run(look=drawing.look)
    write(run, folder)
    write_tables(kept(run), folder)
    return run, drawing, folder


@pytest.fixture(scope="module")
def found(made: Made) -> Kept:
    return kept(made[0])


def test_tables_hold_what_happened(made: Made, found: Kept) -> None:
    _, _, folder = made
    counts = {name: ask(f"select count(*) from {name}", [folder]).rows[0][0] for name in TABLES}
    assert counts == {
        "events": len(found.events),
        "decisions": len(found.decisions),
        "stations": len(found.samples) * len(found.stations),
        "vehicles": len(found.samples) * len(found.vehicles),
        "boxes": found.entered,
    }
    assert found.left
    assert ask('select "left" from boxes where "left" is not null order by 1', [folder]).rows == [
        (time,) for time in found.left
    ]


def test_what_follows_from_them_is_what_the_page_says(made: Made, found: Kept) -> None:
    _, _, folder = made
    answer = ask("select station, availability, performance, quality, oee from oee order by station", [folder])
    assert answer.columns == ["station", "availability", "performance", "quality", "oee"]
    for name, *shares in answer.rows:
        said = effectiveness(found, name)
        assert shares == pytest.approx([said.availability, said.performance, said.quality, said.overall])
    assert min(row[1] for row in answer.rows) < 1.0
    (seconds,) = ask("select seconds from losses where station = 'b1' and cause = 'stopped'", [folder]).rows[0]
    assert seconds == sum(sample.stations[found.stations.index("b1")] == 2 for sample in found.samples)
    assert ask("select sum(boxes) from throughput", [folder]).rows == [(len(found.left),)]


def test_a_log_can_be_asked_and_several_runs_at_once(made: Made, tmp_path: Path) -> None:
    run, _, folder = made
    other = tmp_path / "tuesday"
    write_tables(kept(run), prepare(other).parent)
    rows = ask("select run, count(*) from events group by run order by run", [folder, other]).rows
    assert rows == [("monday", len(kept(run).events)), ("tuesday", len(kept(run).events))]
    assert ask("SELECT count(*) FROM LOG_A1", [folder]).rows == [(15_000,)]


@pytest.mark.parametrize(
    ("question", "message"),
    [
        ("select * from read_csv('/etc/passwd')", "file system operations are disabled"),
        ("copy events to 'events.csv'", "file system operations are disabled"),
        ("install httpfs", "question: "),
        ("set enable_external_access = true", "question: "),
        ("select nothing from events", "question: Binder Error"),
        ("", "expected SQL"),
    ],
)
def test_a_question_reaches_no_file_and_is_told_what_is_wrong(made: Made, question: str, message: str) -> None:
    with pytest.raises(DtwinError, match=message):
        ask(question, [made[2]])


def test_a_folder_that_is_none_of_a_run_is_told(
    made: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["line", "query", "select 1", str(tmp_path)]) == 2
    said = capsys.readouterr().err
    assert "expected a table of a run of `dtwin line run --out`" in said
    assert "it is not there" in said
    with pytest.raises(DtwinError, match="expected folders of different names"):
        ask("select 1", [made[2], made[2]])
    assert main(["line", "query", "select 0.25 as share", str(made[2]), "--json"]) == 0
    assert capsys.readouterr().out == '{"columns":["share"],"rows":[[0.25]],"more":false}\n'


def test_the_recording_shows_what_the_line_did(made: Made, found: Kept, tmp_path: Path) -> None:
    _, drawing, _ = made
    course = drawing.course()
    assert len(course.times) == round(found.duration / (0.1 * EVERY))
    drawing.write(tmp_path / "line.rrd")
    entities = contents(tmp_path / "line.rrd")
    states = [value[0] for _, _, value in entities["/stations/b1"]["StateChange:state"]]
    assert "stopped" in states
    assert states[0] == "waits"
    times = [sample.time for sample in found.samples]
    drawn = dict(zip(course.times.tolist(), course.rate.tolist(), strict=True))
    for time in times[60::20]:
        assert drawn[time] == pytest.approx(60.0 * sum(time - 60.0 < left <= time for left in found.left))
    boxes = entities["/line/boxes"]["Boxes3D:centers"]
    assert max(len(row) for _, _, row in boxes) == max(len(row.done) for row in course.boxes) > 1
    texts = [text[0] for _, _, text in entities["/events"]["TextLog:text"]]
    assert texts == [f"{d.who}: {d.what}: {d.why}" for d in found.decisions]
    arm = entities["/line/stations/a1/arm"]["LineStrips3D:strips"]
    lengths = {round(sum((a - b) ** 2 for a, b in zip(p, q, strict=True)) ** 0.5, 3) for _, _, ((p, q, *_),) in arm}
    assert len(lengths) == 1

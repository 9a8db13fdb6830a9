"""The commissioning of an arm from a log: interrupted anywhere it goes on, and it says the same in the end."""

import html
import re
from collections import Counter
from contextlib import nullcontext
from pathlib import Path

import msgspec
import pytest

from dtwin.api import commissioning
from dtwin.cli import main
from dtwin.commissioning.stages import Stages
from dtwin.identification.machine.record import read_record
from dtwin.logs.log import Log
from dtwin.logs.reading import read_log

STAGES = ("sensors", "identification", "settings", "load", "monitor")


@pytest.fixture(scope="module")
def whole(short_log: Path, calls: Counter[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a commissioning that nothing interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    assert commissioned(short_log, folder) in (0, 1)
    return folder


def commissioned(log: Path, folder: Path) -> int:
    words = ("commission", str(log), "--out", str(folder / "arm.json"), "--report", str(folder / "arm.html"))
    return main(words)


def test_a_commissioning_leaves_record_and_report_and_nothing_else(whole: Path) -> None:
    assert sorted(path.name for path in whole.iterdir()) == ["arm.html", "arm.json"]
    record = read_record(whole / "arm.json")
    assert record.sensors.encoders[0].step is None
    assert record.healthy is not None


def test_interrupted_after_every_stage_it_goes_on_and_comes_to_the_same(
    whole: Path,
    short_log: Path,
    calls: Counter[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Each run but the last is interrupted after one stage more, and no stage is done twice."""
    told = Stages._done
    calls.clear()
    for number, last in enumerate((*STAGES, "")):

        def interrupted(self: Stages, name: str, digest: str, kept: bool, last: str = last) -> None:
            told(self, name, digest, kept)
            if name == last:
                raise KeyboardInterrupt

        monkeypatch.setattr(Stages, "_done", interrupted)
        capsys.readouterr()
        status = commissioned(short_log, tmp_path)
        assert (status == 130) == bool(last)
        said = capsys.readouterr().err
        assert re.findall(r"(\w+): was done before", said) == list(STAGES[:number])
        assert re.findall(r"(\w+): done", said) == ([last] if last else [])
        assert (tmp_path / "arm.json").exists() == (not last)
    assert calls == {"check_sensors": 1, "identify_machine": 1, "propose": 1, "watched": 1}
    for name in ("arm.json", "arm.html"):
        assert (tmp_path / name).read_bytes() == (whole / name).read_bytes(), name
    assert not (tmp_path / "arm.json.parts").exists()


def test_the_report_needs_nothing_and_shows_foreign_text_as_it_is(whole: Path) -> None:
    page = (whole / "arm.html").read_text()
    assert "work &lt;b&gt;.parquet" in page
    assert "<b>" not in page
    assert not re.search(r"<(script|img|link|iframe|object|embed)\b|\bsrc=|url\((?!#)|@import", page)
    assert all(target.startswith("#") for target in re.findall(r'href="([^"]*)"', page))
    assert "default-src 'none'" in page


def test_the_report_says_what_the_record_says(whole: Path) -> None:
    text = html.unescape(re.sub(r"<[^>]+>", " ", (whole / "arm.html").read_text()))
    record = read_record(whole / "arm.json")
    assert record.healthy is not None
    for name, number in record.numbers.items():
        if number.told:
            assert f"{name}: " in text
            assert f"{number.value:.4g} ± " in text
        else:
            assert name in text.split("What the data do not tell")[1]
    for said in (record.data, record.schema, f"watched for {record.healthy.duration:.0f} s", *record.remarks):
        assert said in text
    assert "none seen" in text


class Cell:
    """A cell whose work is in a log: what is collected are its parts, and each is counted."""

    def __init__(self, log: Path) -> None:
        self._log = read_log(log)
        self.collected: list[float] = []

    def collect(self, bus: object, seconds: float, progress: object) -> Log:
        self.collected.append(seconds)
        return self._log


@pytest.fixture
def cell(short_log: Path, monkeypatch: pytest.MonkeyPatch) -> Cell:
    cell = Cell(short_log)
    monkeypatch.setattr(commissioning, "collect", cell.collect)
    monkeypatch.setattr(commissioning, "join", lambda *_: nullcontext())
    return cell


LIVE = ("commission", "--live", "--motion", "150", "--watch", "60", "--out")


def test_a_live_commissioning_collects_nothing_twice_and_leaves_what_it_collected(
    whole: Path, cell: Cell, calls: Counter[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = Stages._done

    def interrupted(self: Stages, name: str, digest: str, kept: bool) -> None:
        told(self, name, digest, kept)
        if name == "watched":
            raise KeyboardInterrupt

    calls.clear()
    with monkeypatch.context() as patch:
        patch.setattr(Stages, "_done", interrupted)
        assert main((*LIVE, str(tmp_path / "arm.json"))) == 130
    assert main((*LIVE, str(tmp_path / "arm.json"))) in (0, 1)
    assert cell.collected == [150.0, 60.0]
    assert set(calls.values()) == {1}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["arm.json", "arm.json.data"]
    assert sorted(path.name for path in (tmp_path / "arm.json.data").iterdir()) == [
        "motion.parquet",
        "watched.parquet",
    ]
    record, expected = read_record(tmp_path / "arm.json"), read_record(whole / "arm.json")
    assert record.source == "cell cell: 150 s of motion, 60 s watched"
    assert msgspec.structs.replace(record, source=expected.source) == expected


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "expected either a log or --live"),
        (("work.parquet", "--live"), "expected either a log or --live"),
        (("--live",), "--live: expected --out"),
        (("--live", "--out", "arm.json", "--motion", "10"), "--motion: expected at least 120"),
        (("--live", "--out", "arm.json", "--watch", "1"), "--watch: expected at least 30"),
        (("--live", "--out", "arm.json", "--cell", "nowhere"), "cell 'nowhere' is not up on this machine"),
    ],
)
def test_what_cannot_be_commissioned_is_refused(
    words: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(("commission", *words)) == 2
    assert message in capsys.readouterr().err

"""Text of others reaches a terminal as text: no markup, no control characters, no marks of direction."""

import json
import logging
import re
from collections import Counter
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rich.console import Console
from rich.table import Table

from dtwin import cli
from dtwin.bus.codec import encode
from dtwin.bus.messages import ServiceSummary, Summary
from dtwin.bus.twin_messages import Estimated, IdentificationState, MonitoredUnit, MonitoringVerdict
from dtwin.commands.identification import live
from dtwin.commands.live.status import table
from dtwin.commands.live.watch import describe
from dtwin.commands.monitoring import monitor
from dtwin.commands.simulation.history import ShowHistory
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DtwinError
from dtwin.parameters import ROOT
from dtwin.signals import Event
from dtwin.simulation.history import Entry, History
from dtwin.terminal import LineFormatter, RateLimit, as_text, folding, print_json, print_table, printable

MARKUP = ["[/x]", "[red]", "[link=http://example.org]here[/link]", "[bold", "\\[/]", ":boom:"]
CONTROL = ["\x1b[2J", "\x1b]0;title\x07", "\x1b]8;;http://x\x07", "\x9b31m", "\r", "\n", "\t", "\0", "\ud800"]
DIRECTION = ["\u202e", "\u2066", "\u200f", "\u2028"]
HOSTILE = [*MARKUP, *CONTROL, *DIRECTION]
texts = st.lists(st.sampled_from(HOSTILE) | st.text(st.characters(), max_size=5), max_size=4).map("".join)
on_the_wire = texts.filter(lambda text: "\ud800" not in text and text.encode("utf-8", "ignore").decode() == text)


def said(show: Callable[[], object]) -> str:
    """What a function prints where there is no terminal, on lines as long as they come."""
    out = StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(out):
        patch.setenv("COLUMNS", "10000")
        show()
    return out.getvalue()


def check(shown: str, text: str) -> None:
    """The text is there as it is, and nothing but whole printable lines."""
    assert all(line.isprintable() for line in shown.split("\n")), shown
    squeezed = " ".join(printable(text).split())
    assert squeezed in " ".join(shown.split())


@given(texts)
def test_what_is_shown_is_printable_and_tells_all(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert printable(shown) == shown
    if text.isprintable():
        assert shown == text


@given(st.recursive(on_the_wire, lambda inner: st.dictionaries(on_the_wire, inner, max_size=2)))
def test_json_stays_the_same_json(value: object) -> None:
    shown = said(lambda: print_json(value))
    assert json.loads(shown) == value
    assert shown.removesuffix("\n").isprintable()


@given(texts)
def test_rich_takes_nothing_for_markup(text: str) -> None:
    out = StringIO()
    Console(file=out, width=10_000, force_terminal=True, color_system=None).print(as_text(text), soft_wrap=True)
    assert out.getvalue().removesuffix("\n").rstrip() == printable(text).rstrip()


@given(texts)
def test_a_log_record_is_one_printable_line(text: str) -> None:
    record = logging.LogRecord("x", logging.INFO, "", 0, "%s", (text,), None)
    assert LineFormatter("name: %(message)s").format(record) == f"name: {printable(text)}"


@given(texts)
def test_a_table_of_services_shows_what_they_say(text: str) -> None:
    services = {text: ServiceSummary(text, 1.0, 0, text)}
    summary = Summary(services, verdict=text, last_event=Event(0.0, text, text))
    check(said(lambda: Console().print(table(summary))), text)


@given(texts)
def test_a_verdict_shows_what_monitoring_says(text: str) -> None:
    verdict = MonitoringVerdict(1.0, {text: MonitoredUnit("failed", text=text)}, (text,), (text,), 0, 0)
    shown = said(lambda: monitor._print(verdict, [text], [Event(0.0, text, text)], 1.0, Path(text.replace("\0", ""))))
    check(shown, text)


@given(texts)
def test_a_proposed_model_shows_what_identification_says(text: str) -> None:
    state = IdentificationState("proposed", text, parameters={text: Estimated(1.0, 0.1)})
    check(said(lambda: live._print(state)), text)


def test_no_command_prints_a_table_that_could_be_cut() -> None:
    files = [path for room in ("dtwin/commands", "evidence") for path in (ROOT / room).rglob("*.py")]
    modules = [path for path in files if " Table(" in path.read_text()]
    assert len(modules) > 10
    for path in modules:
        assert re.search(r"\b(print_table|folding)\(", path.read_text()), path


@given(st.lists(st.text("abc -_", min_size=1), min_size=1, max_size=5))
def test_a_table_folds_what_is_too_long(cells: list[str]) -> None:
    out = StringIO()
    rows = Table(*(f"head{number}" for number in range(len(cells))))
    rows.add_row(*cells)
    Console(file=out, width=40).print(folding(rows))
    letters = Counter("".join(cells)) + Counter("".join(f"head{number}" for number in range(len(cells))))
    shown = Counter(out.getvalue())
    assert all(shown[letter] == letters[letter] for letter in letters if letter not in " ")


def test_the_list_of_machines_fits_a_narrow_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "80")
        assert cli.main(["machine", "list"]) == 0
    shown = capsys.readouterr().out
    assert max(map(len, shown.splitlines())) <= 80
    for word in ("encoders-12-bit", "transmission", "rotor_inertia", "eccentricity_phase"):
        assert word in shown


@given(on_the_wire)
def test_watch_shows_what_passes(text: str) -> None:
    message = encode(Event(0.0, "x", text))
    for_people, wire = (printable(describe("dtwin/cell/arm/events", message, as_sent)) for as_sent in (False, True))
    assert for_people.isprintable()
    assert wire.isprintable()
    assert json.loads(wire)["text"] == text


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(on_the_wire)
def test_the_history_shows_what_was_said(tmp_path: Path, text: str) -> None:
    file = tmp_path / "history.jsonl"
    file.unlink(missing_ok=True)
    History(file).append(Entry(1, 0.0, "refuse", text[:32], text, "gains", ControlSettings(), text))
    check(said(ShowHistory(file).execute), text)


@given(texts)
def test_an_error_is_one_printable_line(text: str) -> None:
    def fail(arguments: list[str]) -> int:
        raise DtwinError(text)

    err = StringIO()
    with pytest.MonkeyPatch.context() as patch, redirect_stderr(err):
        patch.setattr(cli, "_dispatch", fail)
        assert cli.main([]) == 2
    assert err.getvalue() == f"dtwin: {printable(text)}\n"


def test_many_records_of_one_kind_become_few_with_a_count() -> None:
    handler = logging.StreamHandler(StringIO())
    handler.addFilter(RateLimit(most=3, period=60.0))
    for second in range(150):
        for template in ("bad request %d", "other %d"):
            record = logging.LogRecord("test", logging.WARNING, "", 0, template, (second,), None)
            record.created = 1000.0 + second
            handler.handle(record)
    lines = handler.stream.getvalue().splitlines()
    assert [line for line in lines if line.startswith("bad")] == [
        "bad request 0",
        "bad request 1",
        "bad request 2 (more of these are only counted for 60 s)",
        "bad request 60 (57 more since)",
        "bad request 61",
        "bad request 62 (more of these are only counted for 60 s)",
        "bad request 120 (57 more since)",
        "bad request 121",
        "bad request 122 (more of these are only counted for 60 s)",
    ]
    assert len(lines) == 18


@pytest.mark.parametrize(
    ("words", "columns", "lined"), [(3, "80", True), (25, "80", False), (60, "80", True), (3, "60", False)]
)
def test_a_row_that_has_no_room_between_lines_is_printed_without_them(
    words: int, columns: str, lined: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    table = Table("pose", *map(str, range(8)))
    row = ["x" * words, *["1.234"] * 8]
    table.add_row(*row)
    print_table(table)
    printed = capsys.readouterr().out
    assert ("│" in printed) is lined
    assert lined or row in [line.split() for line in printed.splitlines()]
    assert all(len(line) <= int(columns) for line in printed.splitlines())

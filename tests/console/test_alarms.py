"""Alarm management against the state table of IEC 62682, through restarts, full disks and floods."""

import csv
import io
import tempfile
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dtwin.bus.messages import ServiceSummary
from dtwin.bus.twin_messages import MonitoredUnit, MonitoringVerdict
from dtwin.bus.verdicts.opinion import unknown
from dtwin.console.alarms.alarm_list import (
    BURST,
    BURST_OF_ALL,
    EVERY,
    FLOOD,
    FLOOD_OVER,
    LONGEST_SHELF,
    MOST,
    WINDOW,
    AlarmList,
)
from dtwin.console.alarms.export import COLUMNS, found, to_csv
from dtwin.console.alarms.journal import OLDEST, Journal
from dtwin.console.alarms.sources import EXCITED, FINDING, ON_DELAY, Sources
from dtwin.console.alarms.states import AlarmState
from dtwin.errors import DtwinError, ParameterError, RecordingError
from dtwin.signals import Event, EventKind

N, U, A, R, S, D = AlarmState
REFUSED = None
TABLE = {
    # ISA-18.2-2016, figure of the alarm state model: state and whether the condition holds, then what follows
    # columns: condition comes, condition goes, acknowledge, shelve, unshelve, suppress, unsuppress
    (N, False): (U, N, REFUSED, S, REFUSED, D, N),
    (U, True): (U, R, A, S, REFUSED, D, U),
    (A, True): (A, N, REFUSED, S, REFUSED, D, A),
    (R, False): (U, R, N, S, REFUSED, D, R),
    (S, False): (S, S, REFUSED, S, N, D, S),
    (S, True): (S, S, REFUSED, S, U, D, S),
    (D, False): (D, D, REFUSED, D, REFUSED, D, N),
    (D, True): (D, D, REFUSED, D, REFUSED, D, U),
}
ACTIONS = ("come", "go", "acknowledge", "shelve", "unshelve", "suppress", "unsuppress")


def listed(path: Path | None = None) -> AlarmList:
    alarms = AlarmList(Journal(path))
    alarms.raise_("it", "something", 0.0, 0.0)
    alarms.clear("it", 0.0)
    alarms.acknowledge("it", 0.0, "ann")
    return alarms


def act(alarms: AlarmList, action: str, at: float) -> None:
    match action:
        case "come":
            alarms.raise_("it", "something", at, at)
        case "go":
            alarms.clear("it", at)
        case "acknowledge":
            alarms.acknowledge("it", at, "ann")
        case "shelve":
            alarms.shelve("it", at + 3600.0, at, "ann", "known")
        case "unshelve":
            alarms.unshelve("it", at, "ann")
        case "suppress":
            alarms.suppress("it", "tested", at)
        case "unsuppress":
            alarms.suppress("it", "", at)


@given(st.lists(st.sampled_from(ACTIONS), max_size=30))
@settings(deadline=None)
def test_every_sequence_follows_the_state_table(actions: list[str]) -> None:
    alarms = listed()
    for number, action in enumerate(actions):
        before = alarms.alarm("it")
        expected = TABLE[before.state, before.active][ACTIONS.index(action)]
        # What design suppresses stays so, whatever the operator does; a shelf is remembered.
        if before.state is D and action == "unsuppress" and before.shelved_until is not None:
            expected = S
        if before.state is D and action == "unshelve" and before.shelved_until is not None:
            expected = D
        if expected is REFUSED:
            with pytest.raises(ParameterError, match="it: "):
                act(alarms, action, float(number))
            assert alarms.alarm("it") == before
        else:
            act(alarms, action, float(number))
            assert alarms.alarm("it").state is expected


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(ACTIONS)), max_size=40), st.integers(0, 40))
@settings(deadline=None)
def test_nothing_is_lost_in_a_restart(actions: list[tuple[str, str]], cut: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "alarms.jsonl"
        alarms = AlarmList(Journal(path, longest=7))
        for number, (name, action) in enumerate(actions):
            if number == cut:
                before = alarms.alarms()
                alarms = AlarmList(Journal(path, longest=7))
                assert alarms.alarms() == before
            at = EVERY * number
            try:
                if action == "come":
                    alarms.raise_(name, "something", at, at)
                elif action == "go":
                    alarms.clear(name, at)
                elif action == "acknowledge":
                    alarms.acknowledge(name, at, "ann")
                elif action == "shelve":
                    alarms.shelve(name, at + 5 * EVERY, at, "ann", "known")
                else:
                    alarms.pass_time(at)
            except ParameterError:
                pass
        again = AlarmList(Journal(path, longest=7))
        assert again.alarms() == alarms.alarms()
        assert again.history[-7:] == alarms.history[-7:]


def test_a_shelf_has_an_end_and_a_reason() -> None:
    alarms = listed()
    alarms.raise_("it", "something", 10.0, 10.0)
    for until, why in ((5.0, "known"), (10.0 + LONGEST_SHELF + 1, "known"), (float("nan"), "known"), (20.0, " ")):
        with pytest.raises(ParameterError, match="it: expected"):
            alarms.shelve("it", until, 10.0, "ann", why)
    alarms.shelve("it", 20.0, 10.0, "ann", "known")
    alarms.pass_time(19.9)
    assert alarms.alarm("it").state is S
    alarms.pass_time(20.0)
    assert alarms.alarm("it").state is U


def test_the_first_of_a_burst_is_marked_until_it_is_over() -> None:
    alarms = AlarmList(Journal(None))
    for number, name in enumerate(("one", "two", "three")):
        alarms.raise_(name, name, float(number), 0.0)
    assert [alarm.name for alarm in alarms.alarms() if alarm.first_out] == ["one"]
    alarms.clear("one", 5.0)
    assert alarms.alarm("one").first_out
    alarms.acknowledge("one", 6.0, "ann")
    assert not alarms.alarm("one").first_out


def test_what_grows_more_urgent_is_new_and_what_only_reads_otherwise_is_not() -> None:
    alarms = AlarmList(Journal(None))
    alarms.raise_("it", "10 %", 0.0, 0.0)
    alarms.acknowledge("it", 1.0, "ann")
    alarms.raise_("it", "11 %", 2.0, 2.0)
    assert (alarms.alarm("it").state, alarms.alarm("it").text) == (A, "11 %")
    alarms.raise_("it", "50 %", 3.0, 3.0, priority="high")
    assert alarms.alarm("it").state is U


def test_a_flood_begins_above_ten_and_ends_below_five_in_ten_minutes() -> None:
    alarms = AlarmList(Journal(None))
    for number in range(FLOOD):
        alarms.raise_(f"a{number}", "it", 10.0 * number, 0.0)
    assert not alarms.flood(100.0)
    alarms.raise_("one more", "it", 100.0, 0.0)
    assert alarms.flood(100.0)
    assert alarms.rate(100.0) == FLOOD + 1
    at = WINDOW + 10.0 * (FLOOD - FLOOD_OVER)
    assert alarms.rate(at) == FLOOD_OVER
    assert alarms.flood(at)
    assert not alarms.flood(at + 10.0)


def test_a_condition_that_lasts_is_one_record_whatever_its_words_say(tmp_path: Path) -> None:
    alarms = AlarmList(Journal(tmp_path / "alarms.jsonl"))
    sources = Sources(alarms)
    for second in range(600):
        silent = ServiceSummary("silent", 0.0, 0, f"no status for {second + 3} s; ")
        sources.services({"monitoring": silent}, float(second), 0.0)
        alarms.pass_time(float(second))
    assert alarms.alarm("service/monitoring").text == "monitoring is silent: no status for 602 s; "
    assert [change.action for change in Journal(tmp_path / "alarms.jsonl").changes] == ["raised"]


def test_a_chattering_alarm_is_counted_and_kept_now_and_then(tmp_path: Path) -> None:
    path = tmp_path / "alarms.jsonl"
    alarms = AlarmList(Journal(path))
    for second in range(600):
        alarms.raise_("it", "bang", float(second), 0.0)
        alarms.clear("it", second + 0.5)
        alarms.pass_time(second + 0.5)
    assert alarms.alarm("it").count == 600
    assert alarms.rate(599.5) == 600
    kept = Journal(path).changes
    assert BURST < len(kept) <= BURST + 600 / EVERY
    assert len(kept) + alarms.left_out == 1200 + sum(change.action == "changed" for change in kept)
    alarms.acknowledge("it", 599.6, "ann")
    alarms.pass_time(599.6 + EVERY * BURST)
    kept = Journal(path).changes
    assert (kept[-1].who, kept[-1].alarm) == ("ann", alarms.alarm("it"))
    assert sum(change.left_out for change in kept) == alarms.left_out
    assert AlarmList(Journal(path)).alarms() == alarms.alarms()


def test_a_flood_of_many_alarms_is_counted_and_bounded(tmp_path: Path) -> None:
    path = tmp_path / "alarms.jsonl"
    alarms = AlarmList(Journal(path))
    for number in range(MOST):
        alarms.raise_(f"a{number}", "it", 0.01 * number, 0.0)
    assert alarms.flood(5.0)
    assert alarms.floods == 1
    assert len(Journal(path).changes) <= BURST_OF_ALL + 1
    assert alarms.left_out >= MOST - BURST_OF_ALL - 1
    assert len(alarms.alarms()) == MOST
    alarms.acknowledge("a499", 5.0, "ann")
    assert Journal(path).changes[-1].who == "ann", "what operators do is always kept"
    assert not alarms.flood(5.0 + WINDOW)
    for number in range(FLOOD + 1):
        alarms.raise_(f"b{number}", "it", 10.0 + WINDOW, 0.0)
        alarms.clear(f"a{number}", 10.0 + WINDOW)
    assert alarms.floods == 1, "there is no room for more names"


def test_old_records_go_and_what_stands_stays(tmp_path: Path) -> None:
    path = tmp_path / "alarms.jsonl"
    alarms = AlarmList(Journal(path))
    alarms.raise_("standing", "since long ago", 0.0, 0.0)
    for day in range(400):
        at = 86400.0 * day
        alarms.raise_("it", "bang", at, 0.0)
        alarms.clear("it", at + 1.0)
        alarms.acknowledge("it", at + 2.0, "ann")
    for kept in (alarms, AlarmList(Journal(path))):
        times = [change.at for change in kept.history if change.alarm.name == "it"]
        assert min(times) >= at - 2.1 * OLDEST
        assert max(times) == at + 2.0
        assert kept.alarm("standing").state is U


def test_what_stands_for_long_outlives_any_number_of_changes(tmp_path: Path) -> None:
    path = tmp_path / "alarms.jsonl"
    alarms = AlarmList(Journal(path, longest=20))
    alarms.raise_("standing", "since long ago", 0.0, 0.0)
    for number in range(300):
        alarms.raise_("it", "bang", EVERY * number, 0.0)
        alarms.clear("it", EVERY * number + 1.0)
    assert len(alarms.history) <= 42
    assert AlarmList(Journal(path, longest=20)).alarm("standing").state is U


def test_names_without_end_take_bounded_memory() -> None:
    alarms = AlarmList(Journal(None, longest=100))
    for number in range(2 * MOST):
        alarms.raise_(f"a{number}", "it", 0.0, 0.0)
    assert len(alarms.alarms()) == MOST
    assert len(alarms.history) <= 200


def test_a_journal_that_cannot_be_written_says_so_and_catches_up(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "alarms.jsonl"
    alarms = AlarmList(Journal(path))
    alarms.raise_("it", "something", 0.0, 0.0)
    assert "cannot be written" in alarms.trouble
    path.parent.mkdir()
    alarms.acknowledge("it", 1.0, "ann")
    assert alarms.trouble == ""
    assert [change.action for change in Journal(path).changes] == ["raised", "acknowledged"]


def test_an_unfinished_line_is_cut_and_foreign_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "alarms.jsonl"
    AlarmList(Journal(path)).raise_("it", "something", 0.0, 0.0)
    whole = path.read_bytes()
    path.write_bytes(whole + whole[:-5])
    alarms = AlarmList(Journal(path))
    assert len(alarms.history) == 1
    alarms.clear("it", 1.0)
    assert path.read_bytes().startswith(whole)
    assert len(Journal(path).changes) == 2
    assert path.with_name("alarms.jsonl.damaged").read_bytes() == whole[:-5] + b"\n"
    path.write_bytes(whole + b'{"schema":1}\n')
    with pytest.raises(RecordingError, match=r"alarms\.jsonl:2: expected a change of an alarm"):
        Journal(path)


def test_csv_keeps_commas_and_does_not_calculate() -> None:
    alarms = AlarmList(Journal(None))
    alarms.raise_("it", '=HYPERLINK("x", "y")', 0.0, 1.5)
    alarms.raise_("other", "plain", 1.0, 2.5)
    rows = list(csv.reader(io.StringIO(to_csv(found(alarms.history, "RAISED it")))))
    assert rows[0] == list(COLUMNS)
    assert [row[4] for row in rows[1:]] == ["it"]
    assert rows[1][7] == '\'=HYPERLINK("x", "y")'
    assert rows[1][1] == "1970-01-01T00:00:00.000+00:00"


def verdict(*findings: MonitoredUnit, **units: MonitoredUnit) -> MonitoringVerdict:
    named = {name.replace("_", " "): unit for name, unit in units.items()}
    return MonitoringVerdict(10.0, named, (), (), 0, 0, findings)


def test_a_finding_is_an_alarm_with_an_order_and_goes_when_it_is_gone() -> None:
    alarms = AlarmList(Journal(None))
    sources = Sources(alarms)
    unit = MonitoredUnit("failed", "encoder freeze", "freeze2", text="encoder freeze of joint 2")
    sources.verdict(verdict(joint_2=unit), 1.0)
    (alarm,) = alarms.alarms()
    assert (alarm.name, alarm.priority, alarm.state) == ("finding/joint 2/freeze2", "high", U)
    assert alarm.response == "replace encoder 2, then `dtwin release`"
    sources.verdict(verdict(joint_2=MonitoredUnit("nominal")), 2.0)
    assert alarms.alarm(alarm.name).state is R


def test_a_silent_monitor_is_an_alarm_after_a_while_and_none_before_the_arm_has_begun() -> None:
    alarms = AlarmList(Journal(None))
    sources = Sources(alarms)
    for at in (0.0, 5.0):
        sources.verdict(unknown(0.0), at)
    sources.verdict(unknown(0.1), 5.1)
    sources.verdict(verdict(joint_1=MonitoredUnit("nominal")), 6.0)
    sources.verdict(unknown(12.0), 8.0)
    sources.verdict(unknown(13.9), 8.0 + ON_DELAY - 0.1)
    assert not alarms.alarms()
    sources.verdict(unknown(14.0), 8.0 + ON_DELAY)
    assert alarms.alarm("unwatched").state is U
    sources.verdict(verdict(joint_1=MonitoredUnit("nominal")), 11.0)
    assert alarms.alarm("unwatched").state is R


def test_a_finding_that_another_one_hides_stays_an_alarm() -> None:
    alarms = AlarmList(Journal(None))
    sources = Sources(alarms)
    friction = MonitoredUnit("failed", "friction", "mu2", text="friction of joint 2")
    late = MonitoredUnit("failed", "late commands", "late", text="late commands")
    sources.verdict(verdict(friction, joint_2=friction), 1.0)
    sources.verdict(verdict(late, friction, joint_1=late, joint_2=late, joint_3=late), 2.0)
    names = {alarm.name for alarm in alarms.alarms() if alarm.state is U}
    assert names == {"finding/joint 2/mu2", *(f"finding/joint {joint}/late" for joint in (1, 2, 3))}
    sources.verdict(verdict(MonitoredUnit("failed", parameter="<b>"), joint_1=late), 3.0)
    assert alarms.alarm("finding/joint 2/mu2").state is R


def test_findings_are_suppressed_while_the_arm_is_excited_also_new_ones() -> None:
    alarms = AlarmList(Journal(None))
    sources = Sources(alarms)
    unit = MonitoredUnit("failed", "friction", "D1", text="friction of joint 1")
    sources.identification("measuring", 0.0)
    sources.verdict(verdict(joint_1=unit), 1.0)
    alarm = alarms.alarm(f"{FINDING}joint 1/D1")
    assert (alarm.state, alarm.suppressed) == (D, EXCITED)
    sources.identification("proposed", 2.0)
    assert alarms.alarm(alarm.name).state is U


@pytest.mark.parametrize("kind", [EventKind.COLLISION, EventKind.MISPLACED, EventKind.JOURNAL])
def test_what_is_over_when_it_is_told_stands_until_it_is_acknowledged(kind: EventKind) -> None:
    alarms = AlarmList(Journal(None))
    sources = Sources(alarms)
    for at in (1.0, 2.0):
        sources.event(Event(at, kind, "bang"), at)
        assert alarms.alarm(f"event/{kind}").state is R
    assert alarms.alarm(f"event/{kind}").count == 2
    alarms.acknowledge(f"event/{kind}", 3.0, "ann")
    assert alarms.alarms() == []


def test_services_stops_and_silence_come_and_go() -> None:
    alarms = AlarmList(Journal(None))
    sources = Sources(alarms)
    sources.services({"bridge": ServiceSummary("dead", 0.0, 1, "no <b>port</b>")}, 1.0, 0.0)
    sources.stop("standstill", 1.0, 0.0)
    sources.silence(True, 1.0, 0.0)
    sources.event(Event(1.0, EventKind.DISK, "no room"), 1.0)
    assert {alarm.name for alarm in alarms.alarms()} == {"service/bridge", "stop", "silence", "disk"}
    assert alarms.alarm("service/bridge").text == "bridge is dead: no <b>port</b>"
    sources.services({"bridge": ServiceSummary("running", 100.0, 1, "")}, 2.0, 0.0)
    sources.stop("none", 2.0, 0.0)
    sources.silence(False, 2.0, 0.0)
    sources.event(Event(2.0, EventKind.DISK, "the recording is written again"), 2.0)
    assert {alarm.state for alarm in alarms.alarms()} == {R}


def test_an_unknown_name_is_an_error_of_the_project() -> None:
    with pytest.raises(DtwinError, match="'x' is no alarm of this cell"):
        AlarmList(Journal(None)).acknowledge("x", 0.0, "ann")


def test_forecasts_of_two_joints_are_two_alarms() -> None:
    alarms = AlarmList(Journal(None))
    texts = tuple(f"voltage constant of joint {joint} is -3.0 % and changes by -36 %/h" for joint in (1, 2))
    told = msgspec.structs.replace(verdict(joint_1=MonitoredUnit("may be degrading")), forecasts=texts)
    Sources(alarms).verdict(told, 1.0)
    assert {alarm.text for alarm in alarms.alarms()} >= set(texts)

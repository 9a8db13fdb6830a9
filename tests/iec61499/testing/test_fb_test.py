"""`fb test`: what it finds, how it ends, and what it measures."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.testing import programs, session
from iec61499.testing.coverage import CoveredLibrary, instrumented
from iec61499.testing.sequences import Failed, Inapplicable, read_sequences, run_sequence
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.counter import DRAFT, HOLDS, WRONG, write_counter

PYTHON = """from iec61499.testing import block

def test_resets() -> None:
    counter = block("COUNTER")
    counter.CU(R=True)
    assert counter.CV == 0

def test_the_fixture(block) -> None:
    assert block("COUNTER", PV=7).PV == 7
"""
PROGRAM = """<System Name="checked"><Application Name="A"><SubAppNetwork>
<FB Name="COUNTER" Type="COUNTER"/>
<FB Name="CHECK" Type="TEST_CONDITION"><Parameter Name="check" Value="WANTED"/></FB>
<FB Name="END" Type="STEST_END"/>
<EventConnections><Connection Source="COUNTER.CUO" Destination="CHECK.REQ"/>
<Connection Source="CHECK.CNF" Destination="END.REQ"/></EventConnections></SubAppNetwork></Application>
<Device Name="D" Type="FORTE_PC"><Resource Name="R" Type="EMB_RES"><FBNetwork><EventConnections>
<Connection Source="START.COLD" Destination="A.COUNTER.CU"/></EventConnections></FBNetwork></Resource></Device>
<Mapping From="A.COUNTER" To="D.R"/><Mapping From="A.CHECK" To="D.R"/><Mapping From="A.END" To="D.R"/></System>"""


def fb_test(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "dtwin", "fb", "test", *options, str(folder)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)


def test_all_kinds_of_tests_are_found_and_their_coverage_is_told(tmp_path: Path) -> None:
    write_counter(tmp_path, HOLDS, DRAFT)
    (tmp_path / "test_counter.py").write_text(PYTHON)
    (tmp_path / "checked.sys").write_text(PROGRAM.replace("WANTED", "TRUE"))
    junit, page = tmp_path / "junit.xml", tmp_path / "coverage.html"
    done = fb_test(tmp_path, "--verbose", "--junit", str(junit), "--html", str(page))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 passed, 1 skipped" in done.stdout
    assert "draft: the block has no event input INIT" in done.stdout
    assert "COUNTER.fbt  states 3/3  transitions 4/4  lines 6/6" in done.stdout
    names = {case.get("name") for case in ElementTree.parse(junit).iter("testcase")}
    assert names == {"counts", "draft", "checked", "test_resets", "test_the_fixture"}
    assert "class='yes'" in page.read_text()


def test_a_failure_says_what_came_and_what_was_not_executed(tmp_path: Path) -> None:
    file = write_counter(tmp_path, HOLDS, WRONG)
    done = fb_test(tmp_path, "--coverage")
    assert done.returncode == 1
    lines = file.read_text().split("\n")
    wrong, zero = (1 + [text in line for line in lines].index(True) for text in ("CV:=3", "CV := 0;"))
    assert f"{file}:{wrong}: wrong: after CU expected CUO with CV:=3, got CV:=1" in done.stdout
    assert f"{file}:17: transition START -> RESET by CU[R] not executed" in done.stdout
    assert f"{file}:{zero}: line ZERO not executed" in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_a_folder_without_tests_says_so(tmp_path: Path) -> None:
    write_counter(tmp_path)
    done = fb_test(tmp_path)
    assert done.returncode == 0
    assert "no tests: expected <ServiceSequence>" in done.stdout
    assert fb_test(tmp_path / "..", str(tmp_path / "none")).returncode == 2


def test_sequences_hold_or_say_why_not(tmp_path: Path) -> None:
    file = write_counter(tmp_path, HOLDS, WRONG, DRAFT)
    holds, wrong, draft = read_sequences(file)
    counter = Library([tmp_path]).find("COUNTER")
    run_sequence(holds, counter)
    with pytest.raises(Failed, match="expected CUO with CV:=3, got CV:=1"):
        run_sequence(wrong, counter)
    with pytest.raises(Inapplicable, match="no event input INIT"):
        run_sequence(draft, counter)
    missing = HOLDS.replace('<OutputPrimitive Interface="COUNTER" Event="CUO" Parameters="CV:=2;Q:=TRUE"/>', "")
    with pytest.raises(Failed, match="after CU expected no event, got CUO"):
        run_sequence(read_sequences(write_counter(tmp_path, missing))[0], counter)


def test_timed_outputs_are_waited_for(tmp_path: Path) -> None:
    late = """<ServiceSequence Name="late"><ServiceTransaction>
    <InputPrimitive Interface="E" Event="START" Parameters="DT:=T#90s"/>
    <OutputPrimitive Interface="E" Event="EO"/></ServiceTransaction></ServiceSequence>"""
    sequence = read_sequences(write_counter(tmp_path, late))[0]
    run_sequence(sequence, Library([tmp_path]).find("E_DELAY"))


@pytest.mark.parametrize("runtime", ["embedded", pytest.param("native", marks=needs_compiler)])
@pytest.mark.parametrize(("wanted", "problem"), [("TRUE", ""), ("FALSE", "test failed at CHECK")])
def test_programs_are_tests(
    tmp_path: Path, wanted: str, problem: str, runtime: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "current", session.Session(runtime))
    write_counter(tmp_path)
    file = tmp_path / "checked.sys"
    file.write_text(PROGRAM.replace("WANTED", wanted))
    assert programs.is_test(file)
    if not problem:
        programs.run_program(file)
        return
    with pytest.raises(FunctionBlockError, match=problem):
        programs.run_program(file)


def test_what_is_measured_computes_the_same_and_keeps_its_lines(tmp_path: Path) -> None:
    write_counter(tmp_path)
    plain = Library([tmp_path]).find("COUNTER")
    measured = CoveredLibrary([tmp_path]).find("COUNTER")
    assert isinstance(plain, model.BasicFBType)
    assert isinstance(measured, model.BasicFBType)
    assert instrumented(plain)[0] == measured
    before = [len(algorithm.source.text.split("\n")) for algorithm in plain.algorithms]
    after = [len(algorithm.source.text.split("\n")) for algorithm in measured.algorithms]
    assert after[: len(before)] == before


def test_a_reader_that_goes_away_ends_the_command_quietly(tmp_path: Path) -> None:
    command = f"{sys.executable} -m iec61499.cli --help 2> {tmp_path / 'errors'} | true"
    subprocess.run(command, shell=True, timeout=120, check=True)
    assert (tmp_path / "errors").read_text() == ""

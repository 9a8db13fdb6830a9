"""Structured Text in one layout: what it says, its comments, and a second pass."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given

from dtwin.cli import main
from iec61499.errors import FunctionBlockError
from iec61499.files.layout import formatted
from iec61499.files.rewriting import rewrite
from iec61499.st import ast
from iec61499.st.parser import parse_algorithm
from iec61499.st.printer import print_algorithm
from tests.support.examples import examples
from tests.support.iec61499.counter import write_counter
from tests.support.iec61499.st_programs import programs
from tests.support.iec61499.surveys import formatting

BEFORE = """ALGORITHM a
VAR x,y:INT:=5; z : ARRAY[0..3] of REAL; END_VAR
var constant  k: INT := 3; end_var

// head
if a=1 and (not b) or f( -1,c ) then x:=-y ; (* trailing *) y:=y-1;
  (* own *)

else if q then z[ 1 ]:=p.b[2].%X3; end_if; end_if;


case n of 1,2..4: x:=1; // one
-3: x := 2; y := x +
      z;
else x:=0;end_case
for i:=0 to 10 by 2 do while true do exit; end_while; end_for; repeat x:=x+1; until x>3 end_repeat;
return;
END_ALGORITHM
"""
AFTER = """ALGORITHM a
VAR
  x, y : INT := 5;
  z : ARRAY [0..3] OF REAL;
END_VAR
VAR CONSTANT
  k : INT := 3;
END_VAR

// head
IF a = 1 AND (NOT b) OR f(-1, c) THEN
  x := -y; (* trailing *)
  y := y - 1;
  (* own *)
ELSE
  IF q THEN
    z[1] := p.b[2].%X3;
  END_IF;
END_IF;

CASE n OF
  1, 2..4: x := 1; // one
  -3:
    x := 2;
    y := x +
        z;
  ELSE x := 0;
END_CASE
FOR i := 0 TO 10 BY 2 DO
  WHILE TRUE DO
    EXIT;
  END_WHILE;
END_FOR;
REPEAT
  x := x + 1;
UNTIL x > 3
END_REPEAT;
RETURN;
END_ALGORITHM
"""


def test_one_layout() -> None:
    assert formatted(BEFORE, "  ") == AFTER
    assert formatted(AFTER, "  ") == AFTER


@examples(60, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(tree=programs)
def test_texts_say_the_same_and_a_second_pass_changes_nothing(tree: ast.ParsedAlgorithm) -> None:
    laid = formatted(print_algorithm(tree))
    assert parse_algorithm(laid) == tree
    assert formatted(laid) == laid


@pytest.mark.parametrize(
    "text",
    [
        "A := 1; // last",
        "(* first *) A := 1;",
        "A := (* in *) 1;",
        "A := 1 // in\n+ 2;",
        "IF A THEN (* why *) B := 1; END_IF (* end *);",
        "(* several\n   lines *)\nA := 1;",
        "CASE A OF (* c *) 1: (* l *) B := 1; END_CASE;",
        "{pragma} A := 1;",
        "",
        "// alone",
    ],
)
def test_comments_are_kept(text: str) -> None:
    laid = formatted(text)
    comments = re.compile(r"\(\*.*?\*\)|//[^\n]*|\{.*?\}", re.DOTALL)
    assert comments.findall(laid) == comments.findall(text)
    assert formatted(laid) == laid


def test_what_is_no_text_is_refused() -> None:
    with pytest.raises(FunctionBlockError, match="unexpected"):
        formatted("A := := 1;")


@pytest.mark.parametrize(
    ("inside", "becomes"),
    [
        ("<ST><![CDATA[a:=1;]]></ST>", "<ST><![CDATA[a := 1;]]></ST>"),
        ("<ST>\n  <![CDATA[a:=1;]]>\n</ST>", "<ST>\n  <![CDATA[a := 1;]]>\n</ST>"),
        ("<ST>a:=b&lt;1;</ST>", "<ST>a := b &lt; 1;</ST>"),
        ('<ST Text="a:=1;&#10;b:=&quot;x&quot;;"/>', '<ST Text="a := 1;&#10;b := &quot;x&quot;;"/>'),
        ("<!-- <ST>a:=1;</ST> -->", "<!-- <ST>a:=1;</ST> -->"),
        ("<ST/>", "<ST/>"),
    ],
)
def test_every_other_byte_of_a_file_stays(inside: str, becomes: str) -> None:
    head = "<?xml version='1.0' encoding='ISO-8859-1'?>\r\n<A  x = 'ü'>\r\n"
    data = (head + inside.replace("\n", "\r\n") + "</A>").encode("latin-1")
    expected = (head + becomes.replace("\n", "\r\n") + "</A>").encode("latin-1")
    assert rewrite(data, lambda text, line: formatted(text)) == expected


def test_files_are_formatted_checked_or_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, wrong = tmp_path / "A.fbt", tmp_path / "B.fbt"
    good.write_text("<FBType><ST><![CDATA[a:=1;]]></ST></FBType>")
    wrong.write_text("<FBType>\n<ST><![CDATA[a := := 1;]]></ST></FBType>")
    assert main(["fb", "format", "--check", str(tmp_path)]) == 1
    assert "a:=1" in good.read_text()
    assert main(["fb", "format", "--diff", str(tmp_path)]) == 1
    assert "+<FBType><ST><![CDATA[a := 1;]]></ST></FBType>" in capsys.readouterr().out
    assert main(["fb", "format", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert f"left as it is: {wrong}:2:6: unexpected ':='" in said
    assert "files: 2, changed: 1, left as they are: 1" in said
    assert good.read_text() == "<FBType><ST><![CDATA[a := 1;]]></ST></FBType>"
    assert main(["fb", "format", "--check", str(good)]) == 0


def test_the_survey_counts_what_came_of_foreign_types(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_counter(tmp_path)
    (tmp_path / "wrong.fbt").write_text("<FBType")
    text = (tmp_path / "COUNTER.fbt").read_text().replace("CV := 0;", "cv:=0; IF")
    (tmp_path / "left.fbt").write_text(text)
    monkeypatch.setattr("sys.argv", ["format-survey", str(tmp_path)])
    assert formatting.main() == 0
    said = capsys.readouterr().out
    assert "types: 2" in said
    assert "texts left as they are: 1" in said
    assert "no XML: 1" in said
    assert "wrong: 0" in said

"""`fb check`: formats, levels, settings and suppressions."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dtwin.cli import main
from iec61499.errors import ToolError
from iec61499.lint.settings import read_settings
from tests.iec61499.lint.test_rules import type_with

SPARE = '<VarDeclaration Name="SPARE" Type="INT"/>'


def checked(folder: Path, *options: str) -> int:
    return main(["fb", "check", *options, str(folder)])


def write(folder: Path, **parts: str) -> Path:
    file = folder / "T.fbt"
    file.write_text(type_with(parts))
    return file


def test_findings_of_all_files_have_place_and_rule(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path, INTERNALS=SPARE, CODE="B := A * K;")
    assert checked(tmp_path) == 0
    said = capsys.readouterr().out.splitlines()
    assert said == [f"{file}:6: variable SPARE is never used [unused-variable]", "files: 1, problems: 0, warnings: 1"]
    assert checked(tmp_path, "--level", "info", "--fail-on", "warning") == 1
    assert "remarks: 1" in capsys.readouterr().out


def test_json_and_sarif_are_what_programs_expect(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, INTERNALS=SPARE, CODE="CASE A OF 1: K := 1; 1: K := 2; END_CASE;")
    assert checked(Path(), "--format", "json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [(f["rule"], f["level"], f["line"]) for f in found] == [
        ("unused-variable", "warning", 6),
        ("duplicate-case-label", "warning", 14),
    ]
    assert checked(Path(), "--format", "sarif") == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    rules = [rule["id"] for rule in run["tool"]["driver"]["rules"]]
    for result in run["results"]:
        assert rules[result["ruleIndex"]] == result["ruleId"]
        place = result["locations"][0]["physicalLocation"]
        assert place["artifactLocation"]["uri"] == "T.fbt"
        assert place["region"]["startLine"] > 0


def test_settings_change_levels_and_allow(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, INTERNALS=SPARE)
    settings = tmp_path / "fb.toml"
    settings.write_text('[check.rules]\nunused-variable = "error"\n')
    assert checked(tmp_path) == 1
    settings.write_text('[check.rules]\nunused-variable = "off"\n')
    assert checked(tmp_path) == 0
    settings.write_text('[[check.allow]]\nrule = "unused-variable"\nfile = "T.fbt"\nreason = "for later"\n')
    capsys.readouterr()
    assert checked(tmp_path) == 0
    assert "problems: 0\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ('[check.rules]\nunusd = "off"\n', "unknown rule 'unusd': expected invalid"),
        ('[check.rules]\nunused-variable = "loud"\n', "Invalid enum value 'loud'"),
        ('[[check.allow]]\nrule = "never-read"\nreason = " "\n', "never-read is allowed for no reason"),
        ("[check]\nlevel = 1\n", "unknown field `level`"),
        ("[check\n", "Expected"),
    ],
)
def test_wrong_settings_are_named(tmp_path: Path, text: str, problem: str) -> None:
    file = tmp_path / "fb.toml"
    file.write_text(text)
    with pytest.raises(ToolError, match=problem):
        read_settings(file)


@pytest.mark.parametrize(
    ("comment", "rules"),
    [
        ("<!-- fb: allow unused-variable: kept for later -->", []),
        ("<!-- fb: allow unused-variable -->", ["suppression-without-reason"]),
        ("<!-- fb: allow never-read: why not -->", ["unused-suppression", "unused-variable"]),
    ],
)
def test_a_comment_allows_a_finding_with_a_reason(
    tmp_path: Path, comment: str, rules: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, INTERNALS=SPARE + comment)
    checked(tmp_path, "--format", "json")
    assert sorted(f["rule"] for f in json.loads(capsys.readouterr().out)) == rules


def test_suffixes_count_in_any_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "T.FBT").write_text(type_with({"INTERNALS": SPARE}))
    assert checked(tmp_path) == 0
    assert "files: 1, problems: 0, warnings: 1" in capsys.readouterr().out


def test_the_rules_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fb", "check", "--rules"]) == 0
    assert "endless-chart" in capsys.readouterr().out

"""`dtwin identify`, `dtwin model ...` and `dtwin experiment ...` as a user calls them."""

import json
from pathlib import Path
from typing import Any

import pytest

import dtwin
from dtwin.cli import main
from dtwin.parameters import PARAMETER_NAMES, load_arm
from tests.support.identification import ALL, FREE


@pytest.fixture(autouse=True)
def in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def run_json(capsys: pytest.CaptureFixture[str], *arguments: str, status: int = 0) -> Any:
    assert main([*arguments, "--json"]) == status
    return json.loads(capsys.readouterr().out)


def test_identify(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    report = run_json(capsys, "identify", "--noise", "0.01", "--seed", "3", "--plot", "p.png", "--record", "r.rrd")
    assert report["converged"]
    assert report["residual_white"]
    assert report["rank"] == 12
    assert report["free"] == list(FREE)
    assert report["unidentifiable"] == []
    assert list(report["parameters"]) == list(FREE)
    for entry in report["parameters"].values():
        assert abs(entry["estimate"] - entry["truth"]) < 4.5 * entry["standard_error"]
    assert report["offsets"] == pytest.approx([0.005] * 3, abs=5e-4)
    assert min(report["fit"]) > 0.98
    assert report["model_file"] == "identified/arm/0001.json"
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "r.rrd").read_bytes().startswith(b"RRF")
    assert not list(tmp_path.glob(".*"))


def test_identify_everything_presents_nothing_undetermined(capsys: pytest.CaptureFixture[str]) -> None:
    report = run_json(capsys, "identify", "--free", "all", "--noise", "0")
    assert (report["rank"], report["unidentifiable"], report["parameters"]) == (14, list(ALL), {})
    both = run_json(capsys, "identify", "--free", "all", "--noise", "0", "--payload", "0", "--payload", "0.2")
    assert both["rank"] == 15
    assert list(both["parameters"]) == [name for name in ALL if name[0] in "KlD"]
    assert all(abs(e["estimate"] / e["truth"] - 1) < 1e-6 for e in both["parameters"].values())


def test_identify_chooses_friction(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--friction", "both", "--set", "mu1=0.01", "--set", "mu2=0.01", "--noise", "0.002"]
    report = run_json(capsys, "identify", *arguments, "--save", "None")
    assert report["parameters"]["mu1"]["estimate"] == pytest.approx(0.01, rel=0.1)
    assert report["model_file"] is None


def test_a_model_in_doubt_is_kept_only_if_that_is_wanted(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["identify", "--set", "mu1=0.02", "--noise", "0.002"]
    assert main(words) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "the residuals are not white" in said
    assert "not kept as arm: --anyway keeps it all the same" in said
    assert not (tmp_path / "identified").exists()
    report = run_json(capsys, *words, "--anyway", status=1)
    assert not report["residual_white"]
    assert report["model_file"] == "identified/arm/0001.json"
    assert report["doubts"].startswith("the residuals are not white")
    assert main(["model", "export", "arm", "arm.json"]) == 0
    assert "model arm is in doubt: the residuals are not white" in capsys.readouterr().err


def test_a_model_on_a_bound_is_in_doubt(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    words = ["identify", "--free", "m1", "--set", "m1=0.5", "--noise", "0.002"]
    report = run_json(capsys, *words, status=1)
    assert "on a bound of the search: m1" in report["doubts"]
    assert report["model_file"] is None
    run_json(capsys, *words, "--anyway", status=1)
    kept = json.loads((tmp_path / "identified/arm/0001.json").read_text())
    assert kept["validity"]["at_bound"] == ["m1"]


def test_identify_from_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    run = ["run", "--duration", "12", "--seed", "1", "--noise", "0.002", "--log", "cell.parquet", "--record", "None"]
    assert main([*run, "--json"]) == 0
    capsys.readouterr()
    report = run_json(capsys, "identify", "cell.parquet", "--free", "K,D")
    assert report["residual_white"]
    for entry in report["parameters"].values():
        assert abs(entry["estimate"] - entry["truth"]) < 4.5 * entry["standard_error"]


def test_models(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    for seed in ("0", "1"):
        run_json(capsys, "identify", "--seed", seed)
    listed = run_json(capsys, "model", "list")
    assert [(entry["name"], entry["revision"]) for entry in listed] == [("arm", 1), ("arm", 2)]
    shown = run_json(capsys, "model", "show", "arm@1")
    different = run_json(capsys, "model", "diff", "arm@1", "arm")
    assert set(different) == set(FREE)
    assert different["K1"]["first"] == shown["parameters"]["K1"]
    assert all(0 < entry["standard_errors_apart"] < 5 for entry in different.values())
    assert run_json(capsys, "model", "diff", "arm", "arm@2") == {}
    assert [str(each.entry) for each in dtwin.models()] == ["arm@1", "arm@2"]
    assert dtwin.model("arm@1").parameters == shown["parameters"]
    apart = {name: row.standard_errors_apart for name, row in dtwin.compare_models("arm@1", "arm").items()}
    assert apart == {name: row["standard_errors_apart"] for name, row in different.items()}
    with pytest.raises(dtwin.DtwinError, match=r"ends in \.xml or \.json"):
        dtwin.export_model("arm", "arm.txt")
    assert main(["model", "export", "arm", "arm.txt"]) == 2
    assert "or --format" in capsys.readouterr().err
    assert main(["model", "export", "arm@1", "arm.json"]) == 0
    arm = load_arm(tmp_path / "arm.json")
    assert {name: arm.get(name) for name in PARAMETER_NAMES} == shown["parameters"]
    assert main(["model", "export", "arm", "arm.xml"]) == 0
    for command in (["list"], ["show", "arm"], ["diff", "arm@1", "arm@2"]):
        assert main(["model", *command]) == 0
        assert "K1" in capsys.readouterr().out or command == ["list"]


def test_experiments(capsys: pytest.CaptureFixture[str]) -> None:
    report = run_json(capsys, "experiment", "noise", "--runs", "1", "--workers", "1", "--out", "pages/noise")
    assert [group["runs"] for group in report["groups"]] == [1, 1, 1, 1]
    assert all(group["converged"] == group["second_start_converged"] == 1 for group in report["groups"])
    with open(report["report"]) as page:
        assert "of 4 runs converge from both starts" in page.read()


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (
            ["identify", "--free", "Q"],
            "--free Q: expected all, a symbol of K, m, I, l, c, D, mu, or a name such as m2",
        ),
        (["identify", "--free", ","], "--free: expected at least one parameter"),
        (["identify", "--prior", "m2~1"], "--prior m2~1: expected NAME=MEAN+-DEVIATION, such as m2=0.116+-0.001"),
        (["identify", "--prior", "m2=0.1+-0.01"], "prior for m2: expected a free parameter: K1"),
        (["identify", "--prior", "K1=0.1+-0"], "prior: expected a finite mean and a deviation above 0"),
        (["identify", "--set", "K1"], "'K1': expected NAME=NUMBER, e.g. m1=0.15"),
        (["identify", "--noise", "-1"], "noise: expected a finite magnitude of at least 0 rad, got -1.0"),
        (["identify", "--noise", "3"], "jumps by"),
        (["identify", "--payload", "-1"], "expected a finite mass of at least 0 kg, got -1.0"),
        (["identify", "--seed", "-1"], "--seed: expected a whole number of at least 0, got -1"),
        (["identify", "--save", "a/b"], "model name 'a/b': expected letters"),
        (["identify", "--plot", "no/such/folder.png"], "cannot be written"),
        (["identify", "missing.parquet"], "missing.parquet: cannot be read"),
        (["identify", "--known", "missing.json"], "missing.json: No such file"),
        (["model", "show", "arm"], "no model 'arm' in identified: it is empty"),
        (["model", "show", "x.json"], "x.json: No such file"),
        (["model", "export", "arm", "arm.txt"], "no model 'arm'"),
        (["experiment", "noise", "--runs", "0"], "--runs: expected at least 1, got 0"),
        (["bench", "identify", "--rounds", "0"], "--rounds: expected at least 1, got 0"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    assert main(arguments) == 2
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.strip()]
    assert complaint in lines[-1]
    assert captured.out == ""
    assert not list(tmp_path.iterdir())

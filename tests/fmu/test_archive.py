"""What is in an FMU: a binary that needs no Python, sources that compile by themselves, start values as asked."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from dtwin.cli import main
from dtwin.errors import NativeError
from dtwin.fmu import archive
from dtwin.fmu.archive import write_fmu
from dtwin.fmu.sources import Subject, Version
from dtwin.parameters import HANGING, ArmParameters
from dtwin.twin.rollout import rollout
from iec61499.native import build
from tests.fmu.conftest import Made
from tests.support.iec61499.c_harness import COMPILER, needs_compiler

pytestmark = needs_compiler
STRICT = ("-std=c99", "-ffp-contract=off", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
DRIVER = """
#include <dlfcn.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef void *(*instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *,
                             size_t, void *, void *, void *);
typedef int (*enter)(void *, bool, double, double, bool, double);
typedef int (*leave)(void *);
typedef int (*do_step)(void *, double, double, bool, bool *, bool *, bool *, double *);
typedef int (*get)(void *, const uint32_t *, size_t, double *, size_t);

int main(int count, char **arguments)
{
    void *library = count > 3 ? dlopen(arguments[1], RTLD_NOW) : NULL;
    if (library == NULL) {
        fprintf(stderr, "%s\\n", dlerror());
        return 1;
    }
    const instantiate make = (instantiate)dlsym(library, "fmi3InstantiateCoSimulation");
    void *fmu = make("arm", arguments[2], "", false, false, false, false, NULL, 0, NULL, NULL, NULL);
    uint32_t first = 0;
    int status = fmu == NULL || sscanf(arguments[3], "%u", &first) != 1;
    bool event, end, early;
    double reached, theta[3];
    status = status || ((enter)dlsym(library, "fmi3EnterInitializationMode"))(fmu, false, 0.0, 0.0, false, 0.0);
    status = status || ((leave)dlsym(library, "fmi3ExitInitializationMode"))(fmu);
    for (int k = 0; k < 300 && !status; ++k) {
        status = ((do_step)dlsym(library, "fmi3DoStep"))(fmu, k * 0.01, 0.01, true, &event, &end, &early, &reached);
    }
    const uint32_t references[] = {first, first + 1, first + 2};
    status = status || ((get)dlsym(library, "fmi3GetFloat64"))(fmu, references, 3, theta, 3);
    printf("%.17g %.17g %.17g\\n", theta[0], theta[1], theta[2]);
    return status;
}
"""


def start_values(file: Path) -> dict[str, str]:
    with zipfile.ZipFile(file) as opened:
        root = etree.fromstring(opened.read("modelDescription.xml"))
    return {variable.get("name"): variable.get("start") for variable in root.find("ModelVariables")}


def test_a_process_without_python_simulates(tmp_path: Path) -> None:
    """Its environment is empty, so that it would find no Python; the arm falls as in dtwin's own rollout."""
    assert COMPILER is not None
    write_fmu(tmp_path / "twin.fmu", "twin", "3.0", ArmParameters().with_values({"c2": 0.09}))
    with zipfile.ZipFile(tmp_path / "twin.fmu") as opened:
        opened.extractall(tmp_path)
    root = etree.parse(tmp_path / "modelDescription.xml").getroot()
    references = {v.get("name"): v.get("valueReference") for v in root.find("ModelVariables")}
    (binary,) = (tmp_path / "binaries").glob("*/*")
    (tmp_path / "driver.c").write_text(DRIVER)
    driver = tmp_path / "driver"
    subprocess.run([*COMPILER.command, str(tmp_path / "driver.c"), "-o", str(driver), "-ldl"], check=True)
    arguments = [str(driver), str(binary), root.get("instantiationToken"), references["theta1"]]
    done = subprocess.run(arguments, env={}, cwd="/", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    arm = ArmParameters().with_values({"c2": 0.09})
    expected = rollout(arm, (*HANGING, 0.0, 0.0, 0.0), np.zeros((300, 3)))[-1, :3]
    assert np.abs(np.array(done.stdout.split(), float) - expected).max() <= 1e-12


@pytest.mark.parametrize("version", ["3.0", "2.0"])
@pytest.mark.parametrize("subject", ["twin", "controller", "cell"])
def test_the_sources_compile_without_warnings(made: Made, subject: Subject, version: Version) -> None:
    assert COMPILER is not None
    folder = made(subject, version) / "sources"
    files = [str(file) for file in sorted(folder.glob("*.c"))]
    command = [*COMPILER.command, *STRICT, "-fsyntax-only", *files]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("version", ["3.0", "2.0"])
def test_the_functions_are_those_of_the_standard(made: Made, version: Version, tmp_path: Path) -> None:
    """The standard's own headers, which FMPy carries, declare them as they are defined."""
    fmpy = pytest.importorskip("fmpy", reason="FMPy is not installed: pip install dtwin[test]")
    assert COMPILER is not None
    headers = Path(fmpy.__file__).parent / "c-code"
    file = made("twin", version) / "sources" / f"fmi{version[0]}.c"
    options = ("-std=c99", "-Wall", "-Werror", "-DFMI_STANDARD_HEADERS", f"-I{headers}", "-c")
    done = subprocess.run(
        [*COMPILER.command, *options, "-o", str(tmp_path / "made.o"), str(file)], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_the_command_starts_with_what_was_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "cell.fmu"
    arguments = ["fmu", "cell", str(file), "--set", "D2=0.06", "--target-time", "1.5", "--law", "computed_torque"]
    assert main(arguments) == 0
    assert capsys.readouterr().out == f"{file}\n"
    start = start_values(file)
    assert float(start["arm.D2"]) == 0.06
    assert float(start["CONTROLLER.D2"]) == ArmParameters().get("D2")
    assert (float(start["PLANNER.T"]), start["CONTROLLER.LAW"]) == (1.5, "0")


def test_equal_models_are_equal_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.fmu", "b.fmu"):
        monkeypatch.setenv("DTWIN_CACHE_DIR", str(tmp_path / f"kept for {name}"))  # each is compiled
        write_fmu(tmp_path / name, "twin", "3.0")
    write_fmu(tmp_path / "c.fmu", "twin", "3.0", ArmParameters().with_values({"D1": 0.04}))
    first, second, other = ((tmp_path / name).read_bytes() for name in ("a.fmu", "b.fmu", "c.fmu"))
    assert first == second != other


def test_the_binary_of_an_equal_model_is_not_compiled_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, made: Made
) -> None:
    made("twin", "3.0")

    def refused(*_: object) -> Path:
        raise NativeError("compiled again")

    monkeypatch.setattr(build, "compile_files", refused)
    write_fmu(tmp_path / "twin.fmu", "twin", "3.0")
    with pytest.raises(NativeError, match="compiled again"):
        write_fmu(tmp_path / "other.fmu", "twin", "3.0", ArmParameters().with_values({"D1": 0.0411}))


def test_without_a_compiler_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "compilers", lambda: iter(()))
    with pytest.raises(NativeError, match=r"there is no C compiler.*ziglang"):
        write_fmu(tmp_path / "twin.fmu", "twin", "3.0")
    assert not list(tmp_path.iterdir())


def test_another_cell_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fmu", "cell", str(tmp_path / "cell.fmu"), "--cell-file", "four-colours"]) == 2
    assert "--cell-file four-colours: expected none, as an FMU has the usual places" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())

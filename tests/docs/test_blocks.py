"""Every block of the README and the pages is run or read, by one rule; so are commands inside sentences.

The rule, by the language behind the fence:

- `sh`: each line is a command. One of dtwin is run if RUN has its name, with the words that make it short; if READ
  has it, its options are read, for the reason given there. Any other program must be in PROGRAMS.
- `python`, `toml`, `xml`, `c`: HELD names the test that does with it what the page says.
- `math`: is drawn when the site is built (test_site.py).
- `text`: output, drawings and grammars. HELD names the test that compares it, or says that nothing prints it.

Pages in WALKED are carried out whole, in order, by the test named there. What the rule does not know is a failure:
nothing is skipped silently.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
from pathlib import Path
from typing import Final

import pytest

from dtwin.cli import main
from dtwin.commands.table import COMMANDS
from dtwin.emulation.faults import TARGETS, parse_fault
from dtwin.emulation.machine.files import load
from dtwin.logs.reading import read_log
from dtwin.options import parse_options, parser_of
from dtwin.parameters import ROOT
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from iec61499.native.build import compilers
from iec61499.runtime.kept.folder import kept_folder
from tests.support.pages.blocks import PAGES, Block, blocks, command_of, fences, spoken, words_of

WALKED: Final = {
    "docs/tutorial.md": ("tests/services/test_tutorial.py", {"sh", "text"}),
    "docs/cells.md": ("tests/test_cells_page.py", {"sh", "toml", "xml"}),
    "docs/arms.md": ("tests/test_arms_page.py", {"sh", "toml", "xml", "csv", "text"}),
    "docs/architecture.md": ("tests/test_architecture.py", {"text", "xml", "python"}),
}
"""By page: the test that carries it out, and the languages of the blocks that it knows."""
RUN: Final[dict[str, tuple[str, ...]]] = {
    "run": ("--duration", "2"),
    "validate": (),
    "machine list": (),
    "machine show": (),
    "machine draw": (),
    "line run": ("--duration", "2"),
    "line query": (),
    "line report": (),
    "fb check": (),
    "fb test": (),
    "fb format": (),
    "fb outline": (),
    "fb trace": ("--duration", "2"),
    "fb replay": (),
    "identify": (),
    "model list": (),
    "model show": (),
    "monitor": (),
    "simulate": (),
    "completion": (),
    "doctor": (),
    "sbom": (),
}
"""Commands that are run, with the words that make them short where a page has not given these options itself."""
LIVE: Final = "needs or stays as a live cell: the tutorial is walked, tests/services and tests/console do the rest"
DEVICE: Final = "needs or stays as a device: tests/commands/test_fb_command.py"
MINUTES: Final = "computes for minutes: a test of its own room makes it small"
READ: Final = {
    "show": "opens a viewer: tests/view/test_show.py finds where",
    "film": "renders for minutes: tests/view/test_film.py renders less",
    "up": LIVE,
    "console": LIVE,
    "mcp": LIVE,
    "mcp proposals": LIVE,
    "mcp approve": LIVE,
    "mcp decline": LIVE,
    "log show": "reads a file of another program: tests/commands/test_other_arms.py draws one",
    "log convert": "reads a file of another program: tests/measurements/test_writing.py writes some",
    "health": "reads a data set of another program: tests/commands/test_other_arms.py draws one",
    "status": LIVE,
    "watch": LIVE,
    "gains set": LIVE,
    "target set": LIVE,
    "stop": LIVE,
    "release": LIVE,
    "upload gains": LIVE,
    "upload model": LIVE,
    "history": LIVE,
    "fault inject": LIVE,
    "down": LIVE,
    "upload target": LIVE,
    "upload rollback": LIVE,
    "monitor acknowledge": LIVE,
    "monitor stop": LIVE,
    "console user": "asks for a password: tests/console/test_people.py",
    "fb run": DEVICE,
    "fb deploy": DEVICE,
    "fb diff": DEVICE,
    "fb watch": DEVICE,
    "fb force": DEVICE,
    "fb trigger": DEVICE,
    "fb start": DEVICE,
    "fb stop": DEVICE,
    "fmu twin": "compiles: tests/fmu",
    "fmu controller": "compiles: tests/fmu",
    "fmu cell": "compiles: tests/fmu",
    "reproduce": MINUTES,
    "bench": MINUTES,
    "bench identify": MINUTES,
    "commission": MINUTES,
    "optimise": MINUTES,
    "margins": MINUTES,
    "demo recovery": MINUTES,
    "line demo": MINUTES,
    "line up": LIVE,
    "line status": LIVE,
    "line setup": LIVE,
    "line settle": LIVE,
    "line release": LIVE,
    "line fault": LIVE,
    "experiment line": MINUTES,
    "experiment line-outages": MINUTES,
    "experiment line-scale": MINUTES,
    "experiment accuracy": MINUTES,
    "experiment real": "reads logs that are not here: tests/commands/test_other_arms.py draws some",
    "experiment clearance": MINUTES,
    "experiment faults": MINUTES,
    "experiment line-losses": "tests/line/test_losses.py has such runs",
    "experiment noise": MINUTES,
    "experiment strangers": MINUTES,
}
"""Commands whose options are read only, and why."""
LONG: Final = (
    *("--controller", "--served", "127.0.0.1", "unix:"),
    *("--optimise", "--free all", "--friction auto", "--machine 17", "--machine contact"),
    *("--commissioned", "--tuned", "identify run.parquet", "--arm"),
)
"""What makes a line of a command in RUN one that is read only: a peer, a long search, or a file made in minutes."""
PROGRAMS: Final = {
    "scripts/test": "is what runs this",
    "scripts/docs": "tests/docs/test_site.py builds the site",
    "pip": "installs from an index, which a test does not ask",
    "fmpy": "opens a window; tests/fmu simulates with the same library",
    "babeltrace2": "tests/iec61499/trace reads traces with it where it is installed",
    "(trap": "starts a FORTE: tests/interop do, where there is one",
    "fb": "tests/test_package.py tests a block with the distribution of the blocks alone",
    "git": "tests/iec61499/files/test_outline.py asks git for such a view",
    "cc": "tests/services/test_clients.py compiles it where zenoh-pico is",
    "cmake": "builds zenoh-pico, which is fetched by hand",
    "./client": "tests/services/test_clients.py",
    "python": "tests/services/test_clients.py",
    "dask": "starts a cluster: tests/campaign/test_cluster.py has one",
    "scripts/secured-line": "tests/services/test_secured_line.py writes the same folder",
}
HELD: Final = {
    ("docs/line.md", "toml"): "tests/line/test_line_files.py",
    ("docs/real-logs.md", "toml"): "tests/measurements/test_spoiled.py",
    ("docs/real-logs.md", "python"): "tests/measurements/test_arrays.py",
    ("README.md", "python"): "tests/test_docs.py",
    ("README.md", "text"): "test_the_output_that_the_readme_shows_is_what_is_printed",
    ("docs/clients.md", "python"): "tests/services/test_clients.py",
    ("docs/clients.md", "c"): "tests/services/test_clients.py",
    ("docs/connections.md", "text"): "tests/iec61499/net/test_identifiers.py",
    ("docs/connections.md", "toml"): "tests/iec61499/net/test_identifiers.py",
    ("docs/contact.md", "toml"): "test_files_of_the_pages_are_read",
    ("docs/first-block.md", "xml"): "tests/iec61499/testing/test_pages.py",
    ("docs/first-block.md", "python"): "tests/iec61499/testing/test_pages.py",
    ("docs/block-tools.md", "python"): "tests/iec61499/testing/test_pages.py",
    ("docs/block-tools.md", "toml"): "tests/iec61499/testing/test_pages.py",
    ("docs/block-tools.md", "text"): "tests/iec61499/files/test_outline.py",
    ("docs/machine-code.md", "c"): "test_the_c_of_the_page_compiles",
    ("docs/logs.md", "python"): "test_the_python_of_the_page_of_logs_makes_a_log",
    ("docs/model.md", "text"): "test_the_grammar_of_faults_names_every_word",
    ("docs/ai.md", "json"): "tests/ai/test_cell.py",
    ("docs/blocks.md", "text"): "test_the_drawing_names_blocks_of_the_application",
    ("docs/simulation.md", "text"): "a drawing: nothing prints it",
    ("docs/zenoh.md", "text"): "rules of nftables, which need a machine's firewall",
}
"""By page and language: the test that holds the blocks, or why none does."""
STATUSES: Final = {"fb format": (0, 1), "monitor": (0, 1), "doctor": (0, 1), "identify": (0, 1)}
"""What else than 0 may come of a command: a finding, something missing, a doubt."""
ALL: Final = list(blocks())
LINES: Final = [
    (block, line) for block in ALL if block.language == "sh" and block.page not in WALKED for line in block.lines
]


def test_the_python_of_the_page_of_logs_makes_a_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (block,) = (block for block in ALL if (block.page, block.language) == ("docs/logs.md", "python"))
    exec(compile(block.text, block.page, "exec"), {})
    assert len(read_log(Path("own.parquet"))) == 500


def read(words: list[str]) -> None:
    """Reads the options of a command line as the command does.

    Raises:
        DtwinError: they cannot be read.
    """
    if words == ["--help"]:
        return
    name = command_of(words)
    assert name, f"no command {words[:2]}"
    parse_options(COMMANDS[name].kind, name, words[len(name.split()) :])
    for fault in (words[k + 1] for k, word in enumerate(words) if word == "--fault"):
        fault = fault.rpartition(":")[2]  # a station of a line may stand before it
        parse_fault(fault if "@" in fault else f"{fault}@0")


def is_run(words: list[str], line: str) -> bool:
    return command_of(words) in RUN and not any(part in line for part in LONG)


def test_every_fence_belongs_to_a_block() -> None:
    found = [block.page for block in ALL]
    assert {page: 2 * found.count(page) for page in PAGES} == fences()


def test_every_block_falls_under_the_rule_and_the_rule_has_nothing_else() -> None:
    commands, programs, held = set(), set(), set()
    for block in ALL:
        if block.language in WALKED.get(block.page, ("", set()))[1] or block.language == "math":
            continue
        if block.language != "sh":
            held.add((block.page, block.language))
            continue
        for words in map(words_of, block.lines):
            if words[0] != "dtwin":
                programs.add(words[0])
            elif words != ["dtwin", "--help"]:
                commands.add(command_of(words[1:]) or " ".join(words))
    assert not RUN.keys() & READ.keys()
    assert commands == RUN.keys() | READ.keys()
    assert programs == PROGRAMS.keys()
    assert held == HELD.keys()
    tests = [test for test, _ in WALKED.values()] + [each for each in HELD.values() if each.startswith("test")]
    assert [name for name in tests if not ((ROOT / name).exists() or name in globals())] == []


@pytest.mark.parametrize(("block", "line"), LINES, ids=str)
def test_the_options_of_every_command_can_be_read(block: Block, line: str) -> None:
    words = words_of(line)
    if words[0] == "dtwin":
        read(words[1:])


@pytest.fixture(scope="module")
def given(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log of healthy work, which pages speak of as `run.parquet`."""
    path = tmp_path_factory.mktemp("given") / "run.parquet"
    cell = Cell(CellSettings(duration=24.0, noise=0.002))
    cell.run()
    cell.log.freeze().write_parquet(path)
    return path


@pytest.mark.parametrize("page", [page for page in PAGES if any(block.page == page for block, _ in LINES)])
def test_the_commands_of_a_page_run_in_order(
    page: str, given: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    if page == "README.md":  # what a new user does first works in an empty home, too; machine code is not made again
        monkeypatch.setenv("DTWIN_CACHE_DIR", str(kept_folder()))
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    shutil.copy(given, "run.parquet")
    (tmp_path / "fb").symlink_to(ROOT / "fb")
    for block, line in LINES:
        words = words_of(line)[1:]
        if block.page != page or not line.lstrip().startswith(("scripts/dtwin", "dtwin")) or not is_run(words, line):
            continue
        name = command_of(words)
        short = RUN[name]
        if short and short[0] in words:
            at = words.index(short[0])
            words[at : at + 2] = short
        else:
            words += short
        assert main(words) in STATUSES.get(name, (0,)), f"{block}: {line}\n{capsys.readouterr().err}"


SPOKEN = [
    (page, code)
    for page in PAGES
    for code in spoken(page)
    if re.match(r"(scripts/)?dtwin [a-z]", code) and "..." not in code
]


@pytest.mark.parametrize(("page", "code"), SPOKEN)
def test_commands_inside_sentences_exist_with_their_options(page: str, code: str) -> None:
    words = code.removeprefix("scripts/").split()[1:]
    name = command_of(words)
    if not name:
        assert any(command.startswith(f"{words[0]} ") for command in COMMANDS), words[0]
        return
    known = {text for action in parser_of(COMMANDS[name].kind, name)._actions for text in action.option_strings}
    assert {word for word in words if word.startswith("--")} <= known


MODULES = {(page, name) for page in PAGES for name in re.findall(r"python -m ([\w.]+)", (ROOT / page).read_text())}


@pytest.mark.parametrize(("page", "module"), sorted(MODULES))
def test_modules_that_pages_start_exist(page: str, module: str) -> None:
    assert importlib.util.find_spec(module) is not None


def of(page: str, language: str) -> list[Block]:
    return [block for block in ALL if (block.page, block.language) == (page, language)]


def test_the_output_that_the_readme_shows_is_what_is_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All but the time that it took here, and the path of the command."""
    monkeypatch.chdir(tmp_path)
    assert main(["run"]) == 0
    (shown,) = of("README.md", "text")

    def told(text: str) -> str:
        return re.sub(r"in [\d.]+ s, [\d.]+ x|`\S*dtwin", "", text)

    assert told(capsys.readouterr().out).splitlines() == told(shown.text).splitlines()


def test_files_of_the_pages_are_read(tmp_path: Path) -> None:
    (block,) = of("docs/contact.md", "toml")
    path = tmp_path / "machine.toml"
    path.write_text(block.text)
    contact = load(path).contact
    assert (contact.enabled, contact.pad_friction, contact.friction, contact.belt_speed) == (True, 0.6, 0.6, 0.2)


def test_the_c_of_the_page_compiles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = of("docs/machine-code.md", "c")
    assert main(["fb", "export", "--format", "c", str(tmp_path)]) == 0
    capsys.readouterr()
    given = (
        '#include "dtwin.h"\nstruct dtwin__EMULATOR__request sample;\nstruct dtwin__EMULATOR__answer command;\n'
        "double seconds = 1.0;\n"
    )
    (tmp_path / "main.c").write_text(f"{given}int main(void) {{\n{block.text}return 0;\n}}\n")
    compiler = next(iter(compilers()), None)
    if compiler is None:
        pytest.skip("needs a C compiler: `dtwin doctor` says how to get one")
    command = [*compiler.command, "-std=c99", "-Wall", "-Werror", "-fsyntax-only", "main.c"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_grammar_of_faults_names_every_word() -> None:
    (block,) = of("docs/model.md", "text")
    words = set(re.findall(r'"([a-z]+)"', block.text)) | {"K", "m", "I", "l", "c", "D", "mu"}
    stems = {re.sub(r"\d$", "", target) for target in TARGETS}
    assert words == stems


def test_the_drawing_names_blocks_of_the_application() -> None:
    (block,) = of("docs/blocks.md", "text")
    drawn = re.findall(r"[A-Z]+", block.text.splitlines()[0])
    named = set(re.findall(r'<FB Name="(\w+)"', (ROOT / "fb" / "dtwin.sys").read_text()))
    assert len(drawn) == 10
    assert set(drawn) <= named

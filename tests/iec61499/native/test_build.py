"""Machine code is compiled once, kept for the user alone, and never trusted when it is not what was made."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from dtwin.errors import NativeError
from iec61499.native import build
from iec61499.native.resource import NativeResource
from iec61499.runtime.kept import folder as kept
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.networks import Types, chart, network

pytestmark = needs_compiler
COUNTER = chart(
    "COUNTER",
    "REQ -> CNF(N)",
    "-> N: DINT",
    {"S": [], "UP": [("N := N + 1;", "CNF")]},
    [("S", "REQ", "UP"), ("UP", "REQ", "UP")],
)


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "cache"
    monkeypatch.setenv("DTWIN_CACHE_DIR", str(folder))
    return folder


def count() -> int:
    resource = NativeResource(network("A: COUNTER"), Types(COUNTER))
    resource.trigger("A.REQ")
    resource.trigger("A.REQ")
    value: int = resource.read("A.N")
    return value


def forbid(monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> Path:
        raise NativeError("compiled again")

    monkeypatch.setattr(build, "compile_files", refused)


def test_machine_code_is_kept_for_the_user_alone(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert count() == 2
    assert cache.stat().st_mode & 0o777 == 0o700
    assert [path.suffix for path in cache.iterdir()] == [".so"]
    forbid(monkeypatch)
    assert count() == 2


def test_a_user_without_a_home_keeps_it_among_temporary_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "home").write_text("in the way")
    monkeypatch.delenv("DTWIN_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "home"))
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    assert count() == 2
    (kept,) = tmp_path.rglob("*.so")
    assert kept.parent.stat().st_mode & 0o777 == 0o700
    forbid(monkeypatch)
    assert count() == 2


@pytest.mark.parametrize("damage", ["cut", "changed", "foreign", "link"])
def test_what_is_not_what_was_made_is_made_again(
    cache: Path, damage: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert count() == 2
    (kept,) = cache.iterdir()
    content = kept.read_bytes()
    kept.unlink()
    if damage == "link":
        (tmp_path / "elsewhere").write_bytes(content)
        kept.symlink_to(tmp_path / "elsewhere")
    else:
        kept.write_bytes(
            {
                "cut": content[: len(content) // 2],
                "changed": content[:5000] + bytes([content[5000] ^ 1]) + content[5001:],
                "foreign": build._sealed(content[:-32], "another key"),
            }[damage]
        )
    with monkeypatch.context() as patch:
        forbid(patch)
        with pytest.raises(NativeError, match="compiled again"):
            count()
    assert count() == 2
    assert kept.read_bytes()[-32:] == content[-32:] or not kept.is_symlink()


def test_a_folder_that_others_may_read_keeps_nothing(cache: Path) -> None:
    cache.mkdir()
    os.chmod(cache, 0o755)
    assert count() == 2
    assert not list(cache.iterdir())


def test_another_network_and_another_compiler_have_another_key(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert count() == 2
    found = list(build.compilers())
    other = [build.Compiler(compiler.command, compiler.identity + "'") for compiler in found]
    monkeypatch.setattr(build, "compilers", lambda: iter(other))
    assert count() == 2
    NativeResource(network("A: COUNTER; B: COUNTER"), Types(COUNTER))
    assert len(list(cache.iterdir())) == 3


def test_a_compiler_that_fails_is_followed_by_the_next(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = build.Compiler(("false",), "false")
    found = list(build.compilers())
    monkeypatch.setattr(build, "compilers", lambda: iter([bad, *found]))
    assert count() == 2
    monkeypatch.setattr(build, "compilers", lambda: iter([bad]))
    with pytest.raises(NativeError, match=r"false failed.*expected a C compiler as `cc`, or the package ziglang"):
        NativeResource(network("A: COUNTER; C: COUNTER"), Types(COUNTER))


def run(blocks: str) -> NativeResource:
    resource = NativeResource(network(blocks), Types(COUNTER))
    resource.trigger("A.REQ")
    return resource


def test_what_was_not_used_for_longest_goes_and_hurts_nobody(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = run("A: COUNTER"), run("A: COUNTER; B: COUNTER")
    both = set(cache.iterdir())
    run("A: COUNTER")  # is used again, so that the second one is the older
    (cache / "of-somebody.so").write_bytes(b"else")
    (cache / f"{kept.MAKING}lost").mkdir()
    os.utime(cache / f"{kept.MAKING}lost", (0, 0))
    monkeypatch.setattr(kept, "LIMIT", sum(path.stat().st_size for path in both) * 3 // 2)
    run("A: COUNTER; B: COUNTER; C: COUNTER; D: COUNTER")
    left = set(cache.iterdir())
    assert len(left) == 3
    assert len(left & both) == 1
    assert cache / "of-somebody.so" in left
    for resource in (first, second):
        resource.trigger("A.REQ")
        assert resource.read("A.N") == 2
    forbid(monkeypatch)
    run("A: COUNTER")
    with pytest.raises(NativeError, match="compiled again"):
        run("A: COUNTER; B: COUNTER")


def test_a_file_that_goes_while_it_is_looked_for_is_made_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert count() == 2
    (file,) = cache.iterdir()
    intact = build._is_intact

    def removed(path: Path, key: str) -> bool:
        found = intact(path, key)
        path.unlink()
        return found

    with monkeypatch.context() as patch:
        patch.setattr(build, "_is_intact", removed)
        assert count() == 2
    assert list(cache.iterdir()) == [file]


def test_the_newest_file_stays_whatever_its_size(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "LIMIT", 1)
    assert count() == 2
    run("A: COUNTER; B: COUNTER")
    assert len(list(cache.iterdir())) == 1

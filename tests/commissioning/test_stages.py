"""Stages of a procedure that is interrupted: what is done is not done again, unless what came before has changed."""

from pathlib import Path

import pytest

from dtwin.commissioning.stages import Stages
from dtwin.errors import RecordingError


class Counted:
    """Two stages, the second made of the first, that count how often they are done."""

    def __init__(self, folder: Path | None, inputs: str = "a log") -> None:
        self.made: list[str] = []
        self.told: list[str] = []
        self._stages = Stages(folder, inputs, self.told.append)

    def first(self) -> float:
        def make() -> float:
            self.made.append("first")
            return 0.1 + 0.2

        return self._stages.result("first", float, make)

    def second(self, factor: float) -> list[float]:
        first = self.first()

        def make() -> list[float]:
            self.made.append("second")
            return [factor * first]

        return self._stages.result("second", list[float], make)

    def recorded(self, content: str) -> Path:
        def make(path: Path) -> None:
            self.made.append("recorded")
            path.write_text(content)

        return self._stages.file("recorded.txt", make)


def test_what_is_done_is_kept_and_not_done_again(tmp_path: Path) -> None:
    before = Counted(tmp_path / "arm.parts")
    found = before.second(3.0)
    assert before.told == ["first: done", "second: done"]
    after = Counted(tmp_path / "arm.parts")
    assert after.second(3.0) == found == [3.0 * (0.1 + 0.2)]
    assert after.made == []
    assert after.told == ["first: was done before", "second: was done before"]


def test_an_interrupted_procedure_goes_on_with_what_is_missing(tmp_path: Path) -> None:
    Counted(tmp_path).first()
    after = Counted(tmp_path)
    after.second(1.0)
    assert after.made == ["second"]


def test_other_inputs_are_another_procedure(tmp_path: Path) -> None:
    Counted(tmp_path).second(1.0)
    other = Counted(tmp_path, "another log")
    other.second(1.0)
    assert other.made == ["first", "second"]


def test_what_rests_on_a_result_that_has_changed_is_done_anew(tmp_path: Path) -> None:
    Counted(tmp_path).second(1.0)
    line = (tmp_path / "first.json").read_bytes().split(b"\n")[0]
    (tmp_path / "first.json").write_bytes(line + b"\n7.5")
    other = Counted(tmp_path)
    assert other.second(1.0) == [7.5]
    assert other.made == ["second"]


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"no key\n1.5", b"{"])
def test_a_file_that_cannot_be_read_is_made_anew(tmp_path: Path, content: bytes) -> None:
    Counted(tmp_path).first()
    (tmp_path / "first.json").write_bytes(content)
    after = Counted(tmp_path)
    assert after.first() == 0.1 + 0.2
    assert after.made == ["first"]


def test_files_are_stages_too(tmp_path: Path) -> None:
    before = Counted(tmp_path)
    before.first()
    assert before.recorded("one").read_text() == "one"
    after = Counted(tmp_path)
    after.first()
    assert after.recorded("two").read_text() == "one"
    assert after.made == []
    other = Counted(tmp_path, "another log")
    other.first()
    assert other.recorded("two").read_text() == "two"


def test_a_file_that_was_not_finished_is_made_anew(tmp_path: Path) -> None:
    (tmp_path / "recorded.txt.after").write_text("what came before")
    assert Counted(tmp_path).recorded("two").read_text() == "two"


def test_without_a_folder_nothing_is_kept() -> None:
    counted = Counted(None)
    assert counted.second(2.0) == [2.0 * (0.1 + 0.2)]
    with pytest.raises(RecordingError, match=r"recorded\.txt: expected a folder to keep it in"):
        counted.recorded("one")


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="cannot be made"):
        Stages(tmp_path / "file" / "parts", "", print)

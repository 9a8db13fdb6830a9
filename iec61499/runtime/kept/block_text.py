"""The algorithms and conditions of a block type as Python, kept on disk for every process that comes after.

To parse and check a long text takes several times as long as to load what was made of it. What is kept belongs to one
text, one version of the code that has read it, and one Python. Where nothing can be kept, every process writes it.
"""

from __future__ import annotations

import hashlib
import json
import logging
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from iec61499 import model
from iec61499.runtime.checker import BlockChecker
from iec61499.runtime.kept.folder import MAKING, kept_folder, tidy, used
from iec61499.runtime.publication import late_outputs
from iec61499.st.python.translate import Written, compile_condition, write_algorithm

log = logging.getLogger(__name__)

LEAST: Final = 1000
"""Length of all algorithms of a block, in characters, from which on reading a file takes less than reading them."""
_CODE: Final = Path(__file__).parents[2]
"""Folder of the code, of which all decides what Python is written."""


@dataclass(frozen=True, slots=True)
class BlockText:
    """A basic or simple block as Python.

    Attributes:
        algorithms: what was written, by the names of the algorithms.
        guards: conditions of the transitions that have one, in their order.
        late: outputs that are not published as soon as an algorithm has written them.
    """

    algorithms: Mapping[str, Written]
    guards: tuple[str, ...]
    late: frozenset[str]


def text_of(block: model.BasicFBType | model.SimpleFBType) -> BlockText:
    """The block as Python, kept or written.

    Raises:
        FunctionBlockError: an algorithm or condition is wrong; names file, line and column.
    """
    folder = kept_folder() if sum(len(each.source.text) for each in block.algorithms) >= LEAST else None
    if folder is None:
        return _written(block)
    digest = hashlib.sha256(f"{_code()}\n{block!r}".encode()).hexdigest()
    path = folder / f"{block.header.name}-{digest}.json"
    text = _read(path)
    if text is None:
        text = _written(block)
        _keep(path, text)
    return text


def _written(block: model.BasicFBType | model.SimpleFBType) -> BlockText:
    checker = BlockChecker(block)
    checked = {algorithm.name: checker.algorithm(algorithm) for algorithm in block.algorithms}
    algorithms = {name: write_algorithm(code) for name, code in checked.items()}
    guards = (compile_condition(checker.guard(t)) for t in getattr(block, "transitions", ()) if t.guard)
    return BlockText(algorithms, tuple(guards), frozenset(late_outputs(block, checked)))


@cache
def _code() -> str:
    """What tells one version of the code from another, and one Python."""
    parts = [sys.version]
    for source in sorted(_CODE.rglob("*")):
        if source.suffix in (".py", ".lark"):
            status = source.stat()
            parts.append(f"{source} {status.st_mtime_ns} {status.st_size}")
    return "\n".join(parts)


def _read(path: Path) -> BlockText | None:
    """What a file holds; None if there is none, or a damaged one."""
    try:
        seal, _, body = path.read_text(encoding="utf-8").partition("\n")
        if seal != _seal(body):
            return None
        content = json.loads(body)
        algorithms = {name: _algorithm(**each) for name, each in content["algorithms"].items()}
        text = BlockText(algorithms, tuple(content["guards"]), frozenset(content["late"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    used(path)
    return text


def _algorithm(lines: list[str], uses: list[str], exact_lines: Any, exact_uses: list[str], direct: bool) -> Written:
    exact = None if exact_lines is None else tuple(exact_lines)
    return Written(tuple(lines), tuple(uses), exact, tuple(exact_uses), direct)


def _keep(path: Path, text: BlockText) -> None:
    """Writes a file that is there whole or not at all."""
    algorithms = {name: asdict(each) for name, each in text.algorithms.items()}
    body = json.dumps({"algorithms": algorithms, "guards": text.guards, "late": sorted(text.late)})
    try:
        with TemporaryDirectory(prefix=MAKING, dir=path.parent) as folder:
            made = Path(folder) / path.name
            made.write_text(f"{_seal(body)}\n{body}", encoding="utf-8")
            made.replace(path)
        tidy(path.parent, path)
    except OSError as error:
        log.info("%s: not kept: %s", path, error.strerror)


def _seal(body: str) -> str:
    return hashlib.sha256(body.encode()).hexdigest()

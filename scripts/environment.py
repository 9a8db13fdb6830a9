"""Makes or updates .venv from pyproject.toml with the versions of constraints.txt.

Run by the shell scripts beside it with the system's python3; needs the standard library only. The last thing written
is a stamp for what was asked for, the first thing removed are all stamps: an environment without stamps was left
half made, by Ctrl-C, a kill or a full disk, and is made anew.
"""

from __future__ import annotations

import fcntl
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
TEXT = {"encoding": "utf-8", "errors": "surrogateescape"}
"""How stamps are written, whose first word is a path of any bytes."""
KEPT = 20
"""Lines of pip that are shown when it fails."""


def main(extra: str, stamp: str) -> int:
    if sys.version_info < (3, 11):
        print(f"dtwin needs python 3.11 or newer, this is {sys.version.split()[0]}", file=sys.stderr)
        return 2
    try:
        with (ROOT / ".venv.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            return prepare(extra, stamp, lock.fileno())
    except KeyboardInterrupt:
        print("\ndtwin: interrupted; the next call makes .venv anew", file=sys.stderr)
        return 130
    except subprocess.CalledProcessError as error:
        print(f"\ndtwin: .venv cannot be made; is python3-venv installed? {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"\ndtwin: .venv cannot be made: {error}", file=sys.stderr)
        return 1


def prepare(extra: str, stamp: str, lock: int) -> int:
    """Brings .venv to a stamp, which begins with the path of the checkout: an environment that was moved is none."""
    stamp_file = VENV / f"stamp-{extra or 'run'}"
    python = VENV / "bin" / "python"
    if stamp_file.exists() and stamp_file.read_text(**TEXT) == stamp and python.exists():
        return 0
    show("preparing .venv (once, about a minute)")
    stamps = list(VENV.glob("stamp-*"))
    made = [other.read_text(**TEXT) for other in stamps]
    valid = {other.name for other, text in zip(stamps, made, strict=True) if text == stamp} | {stamp_file.name}
    for other in stamps:
        other.unlink()
    if not (python.exists() and made and all(text.startswith(f"{ROOT} ") for text in made)):
        if VENV.exists():
            shutil.rmtree(VENV)
        venv.create(VENV, with_pip=True)
    status = install(f"{ROOT}[{extra}]" if extra else str(ROOT), lock)
    if not status:
        for name in valid:
            (VENV / name).write_text(stamp, **TEXT)
        show("the environment is ready")
        print(file=sys.stderr)
    return status


def install(target: str, lock: int) -> int:
    """Installs the checkout and what it needs, and tells how far it is; returns pip's exit status.

    pip holds the lock as well: one that outlives this process, which was killed, ends before another one begins.
    """
    command = [str(VENV / "bin" / "python"), "-m", "pip", "install", "--disable-pip-version-check"]
    command += ["--progress-bar", "off", "--constraint", str(ROOT / "constraints.txt")]
    command += ["--editable", str(ROOT / "iec61499"), "--editable", target]
    lines: list[str] = []
    packages = 0
    output = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, **output, text=True, pass_fds=[lock]) as pip:
        assert pip.stdout is not None
        for line in pip.stdout:
            lines = [*lines[1 - KEPT :], line]
            found = re.match(r"\s*(Collecting|Installing collected packages: ) ?([\w.-]+)", line)
            if found and found[1] == "Collecting":
                packages += 1
                show(f"preparing .venv: package {packages}, {found[2]}")
            elif found:
                show(f"preparing .venv: installing {line.count(',') + 1} packages")
    if pip.returncode:
        print(f"\n{''.join(lines)}dtwin: pip could not install the packages named in pyproject.toml", file=sys.stderr)
    return pip.returncode


def show(text: str) -> None:
    """Tells what is being done: on a terminal in one line that changes, elsewhere in lines, without the packages."""
    if sys.stderr.isatty():
        print(f"\r\033[Kdtwin: {text} ...", end="", file=sys.stderr, flush=True)
    elif "package " not in text:
        print(f"dtwin: {text} ...", file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))

"""Makes or updates .venv from pyproject.toml with the versions of constraints.txt.

Run by the shell scripts beside it with the system's python3; needs the standard library only.
"""

from __future__ import annotations

import fcntl
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"


def main(extra: str, stamp: str) -> int:
    if sys.version_info < (3, 11):
        print(f"dtwin needs python 3.11 or newer, this is {sys.version.split()[0]}", file=sys.stderr)
        return 2
    stamp_file = VENV / f"stamp-{extra or 'run'}"
    with (ROOT / ".venv.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if stamp_file.exists() and stamp_file.read_text() == stamp:
            return 0
        print("dtwin: preparing .venv (once, about a minute) ...", file=sys.stderr)
        if not (VENV / "bin" / "python").exists():
            venv.create(VENV, with_pip=True)
        target = f"{ROOT}[{extra}]" if extra else str(ROOT)
        install = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        result = subprocess.run(
            [
                VENV / "bin" / "python",
                *install,
                "--constraint",
                ROOT / "constraints.txt",
                "--editable",
                target,
            ],
            stdout=sys.stderr,
        )
        if result.returncode:
            print("dtwin: pip could not install the packages named in pyproject.toml", file=sys.stderr)
            return result.returncode
        stamp_file.write_text(stamp)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2]))

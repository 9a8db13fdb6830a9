"""What a process that was started can tell of itself, on its standard error; then it ends as its first word says.

A number is its exit status, `wait` waits to be killed, and `raise` raises an error.
"""

import json
import os
import sys
import time
from pathlib import Path


def tell() -> None:
    """One line: what this process is."""
    words = Path("/proc/self/cmdline").read_bytes().decode().rstrip("\0").split("\0")
    told = {
        "pid": os.getpid(),
        "parent": os.getppid(),
        "session": os.getsid(0),
        "folder": os.getcwd(),
        "words": words,
        "options": sys.argv[1:],
        "name": __name__,
        "given": os.environ.get("GIVEN"),
        "forked": "dtwin.services.parts.processes.fork_server" in sys.orig_argv,
    }
    print(json.dumps(told), file=sys.stderr, flush=True)


if __name__ == "__main__":
    tell()
    if sys.argv[1] == "raise":
        raise RuntimeError("as asked")
    if sys.argv[1] == "wait":
        time.sleep(600)
    sys.exit(int(sys.argv[1]))

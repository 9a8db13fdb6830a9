"""Calculations for the page, each in a process of its own with low priority, so that neither cell nor page waits.

A page starts a job, asks how far it is, and takes its result. A job that fails costs nothing but itself.
"""

from __future__ import annotations

import asyncio
import itertools
import os
import sys
from collections import OrderedDict
from collections.abc import Awaitable, Callable
from typing import Final

import msgspec
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from dtwin.console.people.sessions import Session
from dtwin.console.people.users import may
from dtwin.console.web.replies import as_json, body
from dtwin.errors import ParameterError
from dtwin.parameters import ROOT

RUNNING: Final = 2
"""Number of jobs that may run at one time."""
KEPT: Final = 8
"""Number of jobs whose results are kept."""
LONGEST: Final = 600.0
"""Time after which a job is ended, s."""
LINE: Final = 1 << 25
"""Length of the longest line that a job may say, bytes."""
PLACE_LAST: Final = 10
"""Niceness of the processes: they take what nobody else needs."""
Handle = Callable[[Request, Session], Awaitable[Response]]


class Job:
    """A calculation that runs or has run.

    Attributes:
        owner: session that has started it.
        done: number of parts that are done.
        of: number of all parts, 0 while unknown.
        best: least cost so far, for a search.
        result: result as JSON, once there is one.
        error: why it failed, "" if it did not.
        over: whether it has ended.
    """

    def __init__(self, owner: str) -> None:
        self.owner = owner
        self.done = self.of = 0
        self.best: float | None = None
        self.result: msgspec.Raw | None = None
        self.error = ""
        self.over = False
        self.task: asyncio.Task[None] | None = None


class Said(msgspec.Struct):
    """One line that a job says."""

    done: int = 0
    of: int = 0
    best: float | None = None
    result: msgspec.Raw = msgspec.Raw()
    error: str = ""


class Jobs:
    """The jobs of a console.

    Args:
        prepare: makes the request of the process from the kind of the job and the form of the page.
    """

    def __init__(self, prepare: Callable[[str, bytes], bytes]) -> None:
        self._prepare = prepare
        self._jobs: OrderedDict[str, Job] = OrderedDict()
        self._numbers = itertools.count(1)

    def routes(self, known: Callable[[Handle], Callable[[Request], Awaitable[Response]]]) -> list[Route]:
        """The addresses; `known` lets sessions alone in."""
        return [
            Route("/api/job/{kind}", known(self._start), methods=["POST"]),
            Route("/api/job/{number}", known(self._look)),
            Route("/api/job/{number}/end", known(self._end), methods=["POST"]),
        ]

    def close(self) -> None:
        """Ends all jobs."""
        for job in self._jobs.values():
            if job.task is not None:
                job.task.cancel()

    async def _start(self, request: Request, session: Session) -> Response:
        if not may(session.role, "operator"):
            raise ParameterError(f"needs the role operator, {session.user} is {session.role}")
        if sum(not job.over for job in self._jobs.values()) >= RUNNING:
            raise ParameterError("two calculations are under way: wait for one of them, or end it")
        asked = self._prepare(request.path_params["kind"], await body(request))
        job, number = Job(session.key), str(next(self._numbers))
        self._jobs[number] = job
        while len(self._jobs) > KEPT:
            _, oldest = self._jobs.popitem(last=False)
            if oldest.task is not None:
                oldest.task.cancel()
        job.task = asyncio.create_task(_work(job, asked))
        return as_json({"done": True, "text": "", "job": number})

    async def _look(self, request: Request, session: Session) -> Response:
        job = self._job(request, session)
        return as_json(
            {
                "done": job.done,
                "of": job.of,
                "best": job.best,
                "over": job.over,
                "error": job.error,
                "result": job.result,
            }
        )

    async def _end(self, request: Request, session: Session) -> Response:
        job = self._job(request, session)
        if job.task is not None:
            job.task.cancel()
        return as_json({"done": True, "text": "ended"})

    def _job(self, request: Request, session: Session) -> Job:
        job = self._jobs.get(request.path_params["number"])
        if job is None or job.owner != session.key:
            raise ParameterError("there is no such calculation any more")
        return job


async def _work(job: Job, asked: bytes) -> None:
    """Runs the process of a job to its end."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "dtwin.console.calculations.work",
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        limit=LINE,
        preexec_fn=lambda: os.nice(PLACE_LAST),
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        process.stdin.write(asked + b"\n")
        process.stdin.close()
        async with asyncio.timeout(LONGEST):
            while line := await process.stdout.readline():
                _update(job, msgspec.json.decode(line, type=Said))
        if job.result is None and not job.error:
            job.error = "the calculation ended without a result"
    except TimeoutError:
        job.error = f"ended after {LONGEST:g} s"
    except asyncio.CancelledError:
        job.error = "ended"
    except (OSError, ValueError) as error:
        job.error = f"the calculation failed: {error}"
    finally:
        job.over = True
        if process.returncode is None:
            process.kill()
            await process.wait()


def _update(job: Job, said: Said) -> None:
    job.done, job.of = said.done or job.done, said.of or job.of
    job.best = said.best if said.best is not None else job.best
    job.error = said.error or job.error
    if bytes(said.result):
        job.result = said.result.copy()

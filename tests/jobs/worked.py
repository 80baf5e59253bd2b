"""A process that is killed while workers, or programs, run: see tests/jobs/test_ending.py."""

import os
import subprocess
import sys
import time

from wrenchbed.jobs.ending import bound, with_group
from wrenchbed.jobs.workers import workers

SLEEPS_S = 60.0


def rest(_: int) -> None:
    time.sleep(SLEEPS_S)


def work(_: int) -> None:
    until = time.monotonic() + SLEEPS_S
    while time.monotonic() < until:
        pass


def here(_: int) -> int:
    return os.getpid()


def die(how: int) -> None:
    """End without a word: by a signal if negative; 0: rest."""
    if how == 0:
        time.sleep(SLEEPS_S)
    if how < 0:
        os.kill(os.getpid(), -how)
    os._exit(how)


def program(_: int) -> None:
    started = subprocess.Popen(["/bin/sh", "-c", "sleep 60 & sleep 60"], start_new_session=True)
    with with_group(started.pid):
        started.wait()


def main(kind: str, busy: str = "") -> None:
    if kind == "bound":
        with subprocess.Popen(bound(["/bin/sleep", "60"])):
            print("at work")
            time.sleep(SLEEPS_S)
    with workers(2) as pool:
        list(pool.map(here, range(4)))
        pool.submit(program if kind == "program" else work if busy == "True" else rest, 0)
        time.sleep(0.3)
        print("at work")
        time.sleep(SLEEPS_S)


if __name__ == "__main__":
    main(*sys.argv[1:])

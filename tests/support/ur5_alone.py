"""Tests of ur_rtde in a process of their own: it can hang with Python's lock, or crash."""

import functools
import multiprocessing
import os
import traceback

DEADLINE_S = 60.0


def alone(test):
    """Run a test in a forked process that ends without destructors."""

    @functools.wraps(test)
    def run(*args, **kwargs):
        context = multiprocessing.get_context("fork")
        ours, theirs = context.Pipe(duplex=False)

        def child():
            told = ""
            try:
                test(*args, **kwargs)
            except BaseException:
                told = traceback.format_exc()
            theirs.send(told)
            os._exit(0)

        process = context.Process(target=child)
        process.start()
        theirs.close()
        try:
            told = ours.recv() if ours.poll(DEADLINE_S) else f"not done within {DEADLINE_S:g} s"
        except EOFError:
            process.join(5.0)
            told = f"the process died: {process.exitcode}"
        finally:
            process.kill()
            process.join()
            process.close()
            ours.close()
        assert not told, told

    return run

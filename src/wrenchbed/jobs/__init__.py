"""Long work: worker processes, progress, and finished parts on disk so that a stopped run goes on.
Free: the inside of each file (how processes are made); tests/jobs/test_ending.py speaks.
Others rely on: `key`, which names parts of an older version so that they are not reused, and the
settings that `check_folders` compares with those in users' folders.
Never: know what the work is; this room gets a function and its arguments.
Read first: `parts`, then `workers`."""

"""Long work: worker processes, progress, and finished parts on disk so that a stopped run goes on.
Free: the inside of each file (how processes are made); tests/jobs/test_ending.py speaks.
Others rely on: `key`: it must change with the code, or parts of older code are reused; names of
parts' files, and settings for `check_folders`: a change refuses users' unfinished runs.
Never: know what the work is; this room gets a function and its arguments.
Read first: `finished_parts`, then `workers`."""

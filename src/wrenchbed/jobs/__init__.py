"""Long work: worker processes, progress, and finished parts on disk so that a stopped run goes on.
It may import errors and files. Read `parts` first, then `workers`.
Never: know what the work is; it gets a function and its arguments.
Used by: benchmark, campaigns, diagnosis, studies, viewer.
"""

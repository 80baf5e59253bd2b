"""Long work: worker processes, progress, and finished parts on disk so that a stopped run goes on.
It may import errors and files. Read `parts` first, then `workers`.
Used by: benchmark, campaigns, diagnosis, studies, viewer.
"""

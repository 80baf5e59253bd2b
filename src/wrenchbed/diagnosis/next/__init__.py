"""Which experiment would separate the causes that a recording cannot.
Read first: `experiments`, then `actions`; `dry_run` asks before a recording.
Free: the inside of each file (the list of actions and their texts);
tests/diagnosis/test_experiments judges gains and plans.
Others rely on: entries of ``next`` and ``blind``, plans that `record` takes; `blind.DETECTED` and
`blind.LEAST_MINOR`, which docs/contracts.md fixes (``minor``).
Never: change an answer; it looks ahead only.
"""

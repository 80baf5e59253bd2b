"""Which experiment would separate the causes that a recording cannot.
Read first: `experiments`, then `actions`; `dry_run` asks before a recording.
Free: the inside of functions, the list of actions; tests/diagnosis/test_experiments judges gains
and plans, tests/drives `excitation_trajectory`. After a change of text run `scripts/messages`.
Others rely on: entries of ``next`` and ``blind``, plans that `record` takes, `blind.DETECTED` and
`blind.LEAST_MINOR` (``minor``): change docs/contracts.md with them; other constants of `blind` move
its sizes, which test_experiments checks.
Never: change an answer; it looks ahead only.
"""

"""A robot's numbers over time: what changed between two results or in a history, the wrench live.
Free: the inside of each file (wording, tables); tests/monitoring speak.
Others rely on: columns of history.parquet and exit codes of `check` (docs/contracts.md); rules and
priors of `check` and `steps`, which set the rate of false alarms (after a change measure it: pytest
-m study tests/monitoring/test_check.py); constants of `compensation` and `check`: change
docs/how-to/monitoring.md with them.
Never: a diagnosis; this room says what changed, not why.
Read first: `compare`; then `check` (the monthly one), `history` (its file) and `steps` (its numbers
and their scatter), `compensation` and `live`."""

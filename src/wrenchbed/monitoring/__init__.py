"""A robot's numbers over time: what changed between two results or in a history, the wrench live.
Free: the inside of each file (wording, tables); tests/monitoring speak.
Others rely on: columns of history.parquet and exit codes of `check` (docs/contracts.md); thresholds
of `steps`: a change moves the rates of false alarms that tests/monitoring/test_check.py measures;
constants of `compensation` and `check`, which docs/how-to/monitoring.md states.
Never: a diagnosis; this room says what changed, not why.
Read first: `compare`; then `check` (the monthly one), `history` (its file) and `steps` (its numbers
and their scatter), `compensation` and `live`."""

"""What is wrong with a recording before anything is fitted to it, named by its true reason.
Read first: `examine`, which states the order; then `rigid_load` (how well one load under gravity
explains the readings) and `mistakes` (which mistake explains what it does not).
Free: the inside of each file (thresholds and order), judged by tests/calibration/test_checks and
`scripts/corruptions`.
Others rely on: the words of `REASONS` (``wrenchbed list checks``, `scripts/corruptions`), and
`Finding.blocks`, by which a calibration or diagnosis refuses.
Never: fit parameters of a robot, or mend a recording; it says what is wrong."""

"""What is wrong with a recording before anything is fitted to it, named by its true reason.
Read first: `examine`, which states the order; then `rigid_load` (how well one load under gravity
explains the readings) and `mistakes` (which mistake explains what it does not).
Free: the inside of functions. Thresholds, order and what each finding's `blocks` says are tuned:
tests/calibration/test_checks.py and `scripts/corruptions` judge them.
Others rely on: words of `REASONS` (``wrenchbed list checks``): change tests/support/corrupted.py
with them; sentences: run `scripts/messages`. What `blocks` is refused by a diagnosis, too.
Never: fit parameters of a robot, or mend a recording; it says what is wrong."""

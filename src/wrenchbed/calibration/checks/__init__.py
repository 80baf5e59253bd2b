"""What is wrong with a recording before anything is fitted to it, named by its true reason.

May import: simulation (closed form), robots, sensors, data, physics.
Never: fit parameters of a robot, or mend a recording; it says what is wrong.
Read first: `examine`, which states the order; then `rigid_load` (how well one load under gravity
explains the readings) and `mistakes` (which mistake explains what it does not).
Used by: calibration, cli and diagnosis.
"""

"""HTML pages about a recording, a fit or a diagnosis, and the page of the effects.
May import: diagnosis, twin, calibration, pages and the rooms below them.
Never: judge; it words and draws what an answer holds.
Read first: `answer` (the words of a diagnosis) and `wrench_answer`, `diagnosis_page`, `figures`.
Used by: cli and viewer.
"""

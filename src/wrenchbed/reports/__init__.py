"""HTML pages about a recording, a fit or a diagnosis, and the page of the effects.
May import: diagnosis, twin, calibration, pages and the rooms below them.
Read first: `answer` (the words of a diagnosis), `diagnosis_page`, then `sentences` and `figures`.
Used by: cli and viewer.
"""

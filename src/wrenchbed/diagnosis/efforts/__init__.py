"""Diagnosis of joint torques and motor currents: which joint, which effect, how far.

Imports drives, and what `diagnosis` imports: evidence, held-out gaps, sizes that show and the
decision are the common ones. Read first: `diagnose_efforts`, which walks `scene`, `columns`,
`noise`, `dictionary`, `search`, `simulator`, `options`, `signs`, `sizes` and `answer`.
Never: a decision of its own; `decision.decide` has the last word here too.
Used by: benchmark, cli and reports.
"""

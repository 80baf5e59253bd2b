"""Diagnosis of joint torques and motor currents: which joint, which effect, how far.
Read first: `diagnose_efforts`, which walks `scene`, `columns`, `noise`, `dictionary`, `search`,
`fitted_causes`, `options`, `signs`, `sizes` and `json_entries`.
Free: the inside of each file (how columns, commands and fits are computed); tests/diagnosis/efforts
judges the answers. Texts go to docs/reference/messages.txt (`scripts/messages`).
Others rely on: diagnosis.json and drives.json (docs/contracts.md), names of effects; constants,
which move odds and sizes: after a change sealed cases (`wrenchbed blind make --world efforts`).
Never: a decision of its own; `decision.decide` has the last word here too.
"""

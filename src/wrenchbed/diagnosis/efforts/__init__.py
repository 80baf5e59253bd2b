"""Diagnosis of joint torques and motor currents: which joint, which effect, how far.
Read first: `diagnose_efforts`, which walks `scene`, `columns`, `dictionary`, `search`,
`fitted_causes`, `residual_anomalies` and `json_entries`.
Free: the inside of functions (how columns, commands and fits are computed); tests/diagnosis/efforts
judges the answers. After a change of text run `scripts/messages`.
Others rely on: diagnosis.json, drives.json and `KINDS` (change docs/contracts.md with them), names
of effects (docs/how-to/efforts.md, benchmark/efforts). Constants move odds and sizes: after a
change run new sealed cases (`wrenchbed blind make --world efforts`).
Never: a decision of its own; `decision.decide` has the last word here too.
"""

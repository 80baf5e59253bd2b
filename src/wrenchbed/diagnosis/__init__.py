"""Diagnosis of the gap between a simulator and a recording: where, which effect, how far.
Read first: `diagnose`, which walks prepare, evidence, explain, gap, between_rows and next.
Terms: stated numbers are bias, mass and CoG; a background level is the size of all small
imperfections; an element is the joint, link, axis or channel of an effect; what shows between rows
scatters a pose's rows and not their mean; the configured gap is that before any fit.
Free: the inside of each function (search, speed); tests/diagnosis judges the answers.
Others rely on: diagnosis.json, which `result` and `json_entries` write: change
docs/contracts.md with a key (tests/project/test_contracts.py); words of notes: run
`scripts/messages`; fields of `Findings` and `Diagnosis` (reports, cli, viewer). Constants move
odds: after a change run `scripts/learn_reliability` and new sealed cases (docs/how-to/sealed.md).
Never: MuJoCo but through `twin`, nor a name of an effect where `Effect` can be asked.
"""

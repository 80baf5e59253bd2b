"""Diagnosis of the gap between a simulator and a recording: where, which effect, how far.
Read first: `diagnose`, which walks prepare, evidence, explain, gap, between_rows and next.
Terms: stated numbers are bias, mass and CoG; a background level is the size of all small
imperfections; an element is the joint, link, axis or channel of an effect; what shows between rows
scatters a pose's rows and not their mean; the configured gap is that before any fit.
Free: the inside of each file (search, speed); tests/diagnosis and sealed cases judge it.
Others rely on: diagnosis.json (docs/contracts.md). Constants of prepare, evidence, explain, gap and
decision move odds: after a change run `scripts/learn_reliability` and sealed cases; after one of a
note's words `scripts/messages` (docs/reference/messages.txt).
Never: MuJoCo but through `twin`, nor a name of an effect where `Effect` can be asked.
"""

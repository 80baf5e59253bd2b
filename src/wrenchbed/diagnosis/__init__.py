"""Diagnosis of the gap between a simulator and a recording: where, which effect, how far.
Read first: `diagnose`, which walks prepare, evidence, explain, gap, between_rows and next.
Free: the inside of each file (notes, search, speed); tests/diagnosis and sealed cases judge it.
Others rely on: diagnosis.json (docs/contracts.md); `scripts/learn_reliability` after changed odds.
Never: MuJoCo but through `twin`, nor a name of an effect where `Effect` can be asked.
"""

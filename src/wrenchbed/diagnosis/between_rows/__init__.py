"""Effects that no mean shows: noise, coarse counts, repeats, vibration.
Read first: `row_effects`, then `scatter`.
Free: the inside of each file (estimators); tests/diagnosis/test_between_rows checks detections and
sizes. Thresholds decide claims: after a change sealed cases.
Others rely on: `RowFinding`, of which ``which`` and the written twin take effects.
Never: use a mean over rows as evidence; other folders do that.
"""

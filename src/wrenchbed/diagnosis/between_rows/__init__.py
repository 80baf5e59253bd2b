"""Effects that no mean shows: noise, coarse counts, repeats, vibration.
Read first: `row_effects`, then `row_residual_scatter`.
Free: the inside of functions (estimators); tests/diagnosis/test_between_rows checks detections and
sizes. Capital constants are thresholds of claims: after a change run new sealed cases
(docs/how-to/sealed.md).
Others rely on: `RowFinding`: its parameters are keys of ``which`` and effects of the written twin
(change docs/contracts.md with them), its sentences notes (run `scripts/messages`).
Never: use a mean over rows as evidence; other folders do that.
"""

"""How large the gap is, where it lies, and how far the twin closes it on held-out rows."""

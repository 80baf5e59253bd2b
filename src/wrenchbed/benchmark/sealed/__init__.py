"""The sealed benchmark: cases whose truth is committed to, entrants that see them, and a score."""

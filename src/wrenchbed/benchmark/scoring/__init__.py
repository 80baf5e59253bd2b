"""Scores of a diagnosis and of simple baselines on cases whose truth is known."""

"""Identification of parameters from recordings: problem, solver, weights, observability."""

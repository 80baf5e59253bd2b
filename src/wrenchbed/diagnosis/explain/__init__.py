"""Structures of up to three effects, their nonlinear refit, claims, verdict, reliability."""

"""Tests of what a person sees need programs that pip does not bring."""

import os

import pytest


def unless(there: bool, missing: str) -> pytest.MarkDecorator:
    """Skip where a program is missing, by its name; where pictures are required the tests fail."""
    required = "WRENCHBED_PICTURES" in os.environ
    return pytest.mark.skipif(not there and not required, reason=missing)

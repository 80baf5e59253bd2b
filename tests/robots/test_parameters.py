"""Parameters and the registry: names, bounds, selection and errors that help."""

import numpy as np
import pytest

from wrenchbed import registry
from wrenchbed.errors import MissingExtraError, NotFoundError, ParameterError, WrenchbedError
from wrenchbed.simulation.closed_form import Model

UR5 = Model.of(registry.load("robots", "ur5")).parameters


def test_vectors_and_mappings_are_inverse_and_groups_select():
    theta = UR5.vector({"tool.mass": 2.0, "dq3": 0.01})
    assert UR5.mapping(theta)["tool.mass"] == 2.0
    assert np.array_equal(UR5.vector(UR5.mapping(theta)), theta)
    assert UR5.nominal[UR5.index("tool.mass")] == 1.35  # the set itself did not change
    names = lambda *patterns: [UR5.names[i] for i in UR5.select(patterns)]  # noqa: E731
    assert names("tool.cog") == ["tool.cog.x", "tool.cog.y", "tool.cog.z"]
    assert names("dq?", "a1") == ["a1", "dq1", "dq2", "dq3", "dq4", "dq5", "dq6"]
    assert names("tool.mass", "tool.mass") == ["tool.mass"]


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"tool.mas": 1.0}, "did you mean 'tool.mass'"),
        ({"tool.mass": -1.0}, "tool.mass = -1 kg lies outside"),
        ({"tool.mass": float("nan")}, "not a finite number"),
        ({"tool.mass": "1"}, "not a finite number"),
        ({"tool.mass": True}, "not a finite number"),
        ({"dq1": 90.0}, "is it in degrees?"),
        ({"a2": -425.0}, "is it in mm?"),
    ],
)
def test_a_wrong_value_is_named_with_its_remedy(values, words):
    with pytest.raises(ParameterError, match=words.replace("?", r"\?")):
        UR5.vector(values)


def test_unknown_plug_ins_and_extras_are_named(tmp_path, monkeypatch):
    with pytest.raises(NotFoundError, match=r"did you mean 'ur5'.*Known: medrue, oriented, ur5"):
        registry.load("robots", "ur55")
    with pytest.raises(NotFoundError, match=r"there is no robot 'none'\. Known: medrue"):
        registry.load("robots", "none")
    with pytest.raises(NotFoundError, match="no kind 'robot'"):
        registry.names("robot")
    with pytest.raises(MissingExtraError, match=r"pip install -e '\.\[hil\]'  in the clone"):
        registry.require("a_library_that_is_not_here", "hil")
    monkeypatch.setattr(registry, "__file__", str(tmp_path / "wrenchbed" / "registry.py"))
    with pytest.raises(MissingExtraError, match=r"run  pip install 'wrenchbed\[hil\]'$"):
        registry.require("a_library_that_is_not_here", "hil")
    assert registry.require("json", "hil").loads("1") == 1
    import wrenchbed.errors as errors

    every = (e for e in vars(errors).values() if isinstance(e, type))
    own = [e for e in every if e.__module__ == errors.__name__]
    own.remove(errors.WrenchbedWarning)
    assert all(issubclass(e, WrenchbedError) for e in own)

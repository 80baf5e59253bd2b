"""Model files that are endless, or that expand to endless models, are refused at once."""

import os
from pathlib import Path

import pytest

from wrenchbed.errors import ParameterError
from wrenchbed.jobs import bounded
from wrenchbed.robots.model_file import read_arm

ARM = (
    '<mujoco><worldbody><body name="l"><joint name="j"/><geom size="0.1"/>{}'
    '<site name="s"/></body></worldbody></mujoco>'
)
COPIES = '<replicate count="{}" offset="1 0 0">{}</replicate>'
BALL = '<geom size="0.1"/>'
FIELD = '<hfield name="h" nrow="100000" ncol="100000" size="1 1 1 1"/>'


def written(folder, text, name="arm.xml"):
    (folder / name).write_text(text)
    return folder / name


def folder_with_pipe(folder):
    os.mkfifo(folder / "pipe.xml")
    return written(folder, ARM.format('<include file="pipe.xml"/>'))


ENDLESS = {
    "a device": (lambda folder: "/dev/zero", "no regular file"),
    "a pipe": (lambda folder: folder_with_pipe(folder).parent / "pipe.xml", "no regular file"),
    "copies": (lambda f: written(f, ARM.format(COPIES.format(100_000_000, BALL))), "processor|GiB"),
    "a cloth": (
        lambda f: written(f, ARM.format('<flexcomp name="c" count="1000 1000 1" dim="2"/>')),
        "processor|GiB",
    ),
    "many bodies": (lambda f: written(f, ARM.format(f"<body>{BALL}</body>" * 40_000)), "processor"),
    "an endless height field": (
        lambda f: written(
            f, ARM.format("").replace("<worldbody>", f"<asset>{FIELD}</asset><worldbody>")
        ),
        "GiB",
    ),
    "endless user data": (
        lambda f: written(
            f, ARM.format("").replace("<worldbody>", '<size nuser_body="2000000000"/><worldbody>')
        ),
        "GiB",
    ),
}


@pytest.mark.sampled
@pytest.mark.parametrize("what", ENDLESS)
def test_an_endless_model_is_refused_in_one_line_with_a_remedy(what, tmp_path, monkeypatch):
    monkeypatch.setattr(bounded, "_CPU_S", 1)
    make, reason = ENDLESS[what]
    with pytest.raises(ParameterError, match=f"(?s)({reason}).*: (give|leave|state) "):
        read_arm(Path(make(tmp_path)), "s")


def test_a_pipe_that_nobody_writes_to_is_left(tmp_path, monkeypatch):
    monkeypatch.setattr(bounded, "_WALL_S", 0.2)
    pipe = folder_with_pipe(tmp_path)
    with pytest.raises(ParameterError, match="longer than 0.2 s"):
        read_arm(pipe, "s")


def test_few_copies_and_includes_are_read(tmp_path):
    written(tmp_path, f"<mujocoinclude>{BALL}</mujocoinclude>", "parts.xml")
    inside = COPIES.format(20, BALL) + '<include file="parts.xml"/>'
    arm, _, _ = read_arm(written(tmp_path, ARM.format(inside)), "s")
    assert len(arm.links[0].shapes) == 22


def test_a_mesh_whose_name_no_file_can_have_is_missing(tmp_path):
    asset = f'<asset><mesh name="m" file="{"x" * 5000}.stl"/></asset><worldbody>'
    text = ARM.format('<geom type="mesh" mesh="m"/>').replace("<worldbody>", asset)
    arm, _, notes = read_arm(written(tmp_path, text), "s")
    assert len(arm.links[0].shapes) == 1 and "1 meshes are missing" in notes[0]

"""Model files that are endless, or that expand to endless models, are refused at once."""

import os
import re
import subprocess
import sys

import pytest

from wrenchbed.robots.model_file import read_arm

ARM = (
    '<mujoco><worldbody><body name="l"><joint name="j"/><geom size="0.1"/>{}'
    '<site name="s"/></body></worldbody></mujoco>'
)
COPIES = '<replicate count="{}" offset="1 0 0">{}</replicate>'
BALL = '<geom size="0.1"/>'


def written(folder, text, name="arm.xml"):
    (folder / name).write_text(text)
    return folder / name


def folder_with_pipe(folder):
    os.mkfifo(folder / "pipe.xml")
    return written(folder, ARM.format('<include file="pipe.xml"/>'))


def large_include(folder):
    line = "<!-- " + "x" * 1000 + " -->\n"
    written(folder, f"<mujocoinclude>{line * 28_000}</mujocoinclude>", "parts.xml")
    return written(folder, ARM.format('<include file="parts.xml"/>'))


def two_includes(folder):
    """Neither is too large alone."""
    half = "<!-- " + "x" * 9_000_000 + " -->"
    for name in ("a.xml", "b.xml"):
        written(folder, f"<mujocoinclude>{half}</mujocoinclude>", name)
    return written(folder, ARM.format('<include file="a.xml"/><include file="b.xml"/>'))


def copied_include(folder):
    written(folder, f"<mujocoinclude>{BALL * 200}</mujocoinclude>", "parts.xml")
    return written(folder, ARM.format(COPIES.format(100, '<include file="parts.xml"/>')))


def copied_model(folder):
    written(folder, ARM.format(BALL * 200), "part.xml")
    text = ARM.format(COPIES.format(100, '<attach model="p" body="l" prefix="p"/>'))
    asset = '<asset><model name="p" file="part.xml"/></asset>'
    return written(folder, text.replace("<worldbody>", f"{asset}<worldbody>"))


def includes_itself(folder):
    return written(folder, ARM.format('<include file="arm.xml"/>'))


ENDLESS = {
    "a device": (lambda folder: "/dev/zero", "no regular file"),
    "a pipe": (lambda folder: folder_with_pipe(folder).parent / "pipe.xml", "no regular file"),
    "an included pipe": (folder_with_pipe, "pipe.xml: .*no regular file"),
    "a large include": (large_include, "parts.xml.*bytes"),
    "two includes": (two_includes, "b.xml.*bytes"),
    "an include of itself": (includes_itself, "includes.*itself"),
    "copies": (lambda f: written(f, ARM.format(COPIES.format(100_000_000, BALL))), "replicate"),
    "copies of copies": (
        lambda f: written(f, ARM.format(COPIES.format(200, COPIES.format(200, BALL)))),
        "replicate",
    ),
    "a copied include": (copied_include, "elements"),
    "a copied model": (copied_model, "elements"),
    "a cloth": (
        lambda f: written(f, ARM.format('<flexcomp name="c" count="1000 1000 1" dim="2"/>')),
        "holds a <flexcomp>",
    ),
    "many bodies": (lambda f: written(f, ARM.format(f"<body>{BALL}</body>" * 5_000)), "elements"),
}


@pytest.mark.sampled
@pytest.mark.parametrize("what", ENDLESS)
def test_an_endless_model_is_refused_in_one_line_with_a_remedy(what, tmp_path):
    make, reason = ENDLESS[what]
    file = make(tmp_path)
    code = f"from pathlib import Path; from wrenchbed.robots.model_file import read_arm as r; r(Path({str(file)!r}), 's')"  # noqa: E501
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    last = done.stderr.strip().splitlines()[-1]
    assert "Error: " in last
    assert re.search(reason, last), last
    assert ": give " in last or ": leave " in last or ": state " in last


def test_few_copies_and_includes_are_read(tmp_path):
    written(tmp_path, f"<mujocoinclude>{BALL}</mujocoinclude>", "parts.xml")
    inside = COPIES.format(20, BALL) + '<include file="parts.xml"/>'
    arm, _, _ = read_arm(written(tmp_path, ARM.format(inside)), "s")
    assert len(arm.links[0].shapes) == 22

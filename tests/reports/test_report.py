"""The report of a diagnosis: right sentences for each verdict, its numbers, and nothing else."""

import hashlib
import json
import re
from dataclasses import replace
from html import unescape
from importlib.metadata import version
from unittest.mock import patch

import numpy as np
import pytest

import wrenchbed as wb
from consistent import violations
from rrd_file import Rrd
from simulated import driven
from wrenchbed import registry
from wrenchbed.cli import main
from wrenchbed.diagnosis.gap.gap_bootstrap import Interval
from wrenchbed.diagnosis.gap.varies_with import Finding
from wrenchbed.diagnosis.next.blind import BlindSpot, unseen
from wrenchbed.effects.scene import examples
from wrenchbed.errors import MissingExtraError
from wrenchbed.pages import numbers
from wrenchbed.pages.draw import Drawn
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.reports.claim import Claim
from wrenchbed.reports.compared_readings import HeldOutReadings, along
from wrenchbed.reports.diagnosis_page import diagnosis_page
from wrenchbed.reports.robot_scene import blame, wrench_scene
from wrenchbed.reports.wrench_answer import WrenchAnswer
from wrenchbed.viewer.diagnoses import diagnosis_view


def sections_of(html: str) -> dict[str, str]:
    """Text of a page by the id of its section, the whole as ``page``."""
    sections = re.findall(r'<section[^>]*id="(\w+)">(.*?)</section>', html, flags=re.DOTALL)
    return {name: words(text) for name, text in [("page", html), *sections]}


def words(html: str) -> str:
    bare = re.sub(r"<(style|script)\b.*?</\1>|<[^>]+>", " ", html, flags=re.DOTALL)
    return " ".join(unescape(bare).split())


def without_scripts(html: str) -> str:
    """A page without the texts of its scripts."""
    return re.sub(r"<script[ >].*?</script>", "", html, flags=re.DOTALL)


def recorded(folder, samples=10, effects=()):
    """A recording of 24 poses."""
    plan, path = wb.poses(wb.load("robots", "ur5"), 24, 1), folder / "rec.parquet"
    return driven(plan, path, samples, noise="white", seed=1, effects=effects)


def found(folder, *effects):
    return wb.diagnose(recorded(folder, effects=effects))


@pytest.fixture(scope="module")
def springy(tmp_path_factory) -> wb.Findings:
    """Of a compliant joint, without rivals."""
    return found(tmp_path_factory.mktemp("springy"), "joint.compliance:joint=2,stiffness=9000")


@pytest.fixture(scope="module")
def healthy(tmp_path_factory) -> wb.Findings:
    return found(tmp_path_factory.mktemp("healthy"))


def changed(f: wb.Findings, **fields) -> wb.Findings:
    return replace(f, diagnosis=replace(f.diagnosis, **fields))


def without_cause(f: wb.Findings) -> wb.Findings:
    gap = replace(
        f.diagnosis.gap,
        with_effects=None, closed=None, members={},
        per_channel={c: {"before": v["before"]} for c, v in f.diagnosis.gap.per_channel.items()},
    )  # fmt: skip
    p = {"none": 0.0, "unknown": 1.0}
    return changed(f, verdict="unknown", gap=gap, which=[], where=[], probabilities=p)


def rival(name: str) -> dict:
    return {"effect": name, "probability": 0.1, "parameters": {}}


def undrawn(f: wb.Findings) -> str:
    """Its page without what is drawn."""
    with patch("wrenchbed.reports.diagnosis_page.draw", lambda c: Drawn(c, "<svg></svg>")):
        return diagnosis_page(f).html()


def shown(f: wb.Findings) -> dict[str, str]:
    return sections_of(undrawn(f))


def test_the_page_holds_the_numbers_of_the_json(springy):
    assert not violations(springy)
    told, page = springy.diagnosis.to_json(), shown(springy)
    p = told["which"][0]["parameters"]["stiffness"]
    drawn = re.search(r"stiffness ([\d.]+) ± ([\d.]+) N·m/rad", page["which"])
    value, std = map(float, drawn.groups())
    assert value == pytest.approx(p["value"], abs=p["std"])
    assert std == pytest.approx(p["std"], rel=0.35)
    assert f"({told['gap']['held_out_rows']:,} rows)" in page["page"]
    assert "● identified Joint 2 is compliant and deflects under gravity: stif" in page["page"]
    assert page["where"].startswith("Where In joint 2")
    assert words(f"Probability {numbers.chance(told['which'][0]['probability'])}") in page["which"]


@pytest.mark.parametrize("name", registry.names("effects"))
def test_every_effect_states_its_size_as_a_quantity(name):
    """No coefficient without a unit, and no number of where or how it acts, in any headline."""
    robot, effect = registry.load("robots", "ur5"), registry.load("effects", name)
    for scene in examples(robot):
        for variant in effect.variants(scene):
            values = effect.values(robot, dict.fromkeys(variant.free, 1e-3) | dict(variant.at))
            std = dict.fromkeys((*variant.free, *variant.shape), 1e-4)
            quantities = effect.size(scene, variant, values)
            size = {n: {"value": x, "std": 1e-4, "unit": u} for n, (x, u) in quantities.items()}
            parameters = effect.publish(robot, variant, values, std)
            entry = {"effect": name, "probability": 1.0, "size": size, "parameters": parameters}
            for size in Claim(entry).figures:
                bare = re.fullmatch(r"[−+\d.()· ±¹²³⁰-⁹⁻]+", size.value)
                assert not bare or size.name == "waves a turn", size
                assert not re.match(r"anchor|point|normal|way|neutral|place", size.name)


def test_an_ambiguous_cause_is_one_or_the_other(springy):
    (cause,) = springy.diagnosis.which
    either = {**cause, "rivals": [rival("cable.pull")]}
    page = shown(changed(springy, verdict="ambiguous", which=[either]))
    told = WrenchAnswer(changed(springy, verdict="ambiguous", which=[either])).headline
    assert re.search("stiffness .* N·m/rad; or a cable or hose pulls on the tool.$", told)
    assert "In joint 2 or in the cable" in page["where"]
    assert "joint.compliance or cable.pull" in page["which"]
    assert "that it is one of these. If it is joint.compliance:" in page["which"]


def test_a_claim_names_its_elements_and_no_other(springy):
    """Headline, card, map and table name the class and not its first member."""
    size = {"value": -9e-4, "std": 1e-4, "unit": "m"}
    longer, gain, three = size | {"value": 9e-4}, size | {"unit": "1"}, "joint 2, 3 or 4"
    joint = {"joint": {"value": 2, "rivals": [3, 4]}}
    leak = {"x.fz.ty": size | {"unit": "1/m"}, "channel": {"value": "fz"}, "of": {"value": "ty"}}
    wide = {f"x.fx.{c}": size | {"value": 0.1, "std": 0.3, "unit": "1/m"} for c in CHANNELS[3:]}
    wide |= {"x.fx.fz": size | {"value": -0.02, "std": 0.002, "unit": "1"}}
    course = {"size.fx": {"value": -1.8, "std": 0.1, "unit": "N", "over": 412.3}}
    jump = {"time": size} | {f"step.f{axis}": size | {"unit": "N"} for axis in "xyz"}
    heavy = {"mass": {"value": 2.34, "std": 0.02, "unit": "kg", "stated": 2.24}}
    for effect, elements, sizes, sentence, place in (
        ("link.length", ["L21"], {"length.L21": size}, "length L21 −0.90 ± 0.10 mm", "link L21"),
        ("link.length", ["a3"], {"length.a3": longer}, ": length a3 +0.90 ± 0.10 mm", "link 3"),
        ("sensor.gain", ["fx", "fy"], {"gain.fx": gain}, ": fx or fy, gain fx", "the sensor"),
        ("sensor.crosstalk", ["fz"], leak, "ty into fz (−9.0 ± 1.0)·10⁻⁴ N/(N·m)", "the sensor"),
        ("sensor.crosstalk", ["everything"], wide, "fz into fx −2.00 ± 0.20 %", "the sensor"),
        ("sensor.drift", ["fx"], course, "fx −1.80 ± 0.10 N over 412 s", "the sensor"),
        ("sensor.jump", ["fx"], jump, "step fz −0.90 ± 0.10 mN", "the sensor"),
        ("tool.mass", ["mass"], heavy, "(stated 2.24 kg, found 4.580 ± 0.020 kg).", "the tool"),
        ("drive.constant", ["joint 2", "joint 3", "joint 4"], joint, three[1:], three),
        ("joint.compliance", ["joint 2", "joint 3", "joint 4"], joint, three[1:], three),
    ):
        sizes |= {"parameter": {"value": elements[0]}, "form": {"value": "free"}}
        entry = {"effect": effect, "elements": elements, "parameters": sizes}
        words = WrenchAnswer(changed(springy, which=[{**springy.diagnosis.which[0], **entry}]))
        assert sentence in words.headline and words.place == f"In {place}"
        assert "free" not in words.headline
    assert set(blame(words.d.to_json())) == {"joint 2", "joint 3", "joint 4"}
    seen = [Finding("joint 2", 0.2, 1e-3, "Joint 2 is seen.")]
    page = undrawn(replace(changed(springy, which=[words.d.which[0]]), places=seen))
    assert "Joint 2 is seen" not in page and "error of joint 2" not in page
    assert re.search("joint.compliance, joint 2, 3 or 4[^<]*: probability", page)


def test_the_first_screen_says_no_more_than_is_there(springy):
    assert "joint 2; twin.json holds the corrected simulator." in WrenchAnswer(springy).steps[0]
    contact = {**springy.diagnosis.which[0], "effect": "environment.contact"}
    assert "is without the contact" in WrenchAnswer(changed(springy, which=[contact])).steps[0]
    assert re.search("stiffness \\d+\xa0±\xa0\\d+\xa0N·m/rad", undrawn(springy))
    seen = [Finding(f"joint {k}", 0.2, 1e-3, f"Joint {k} is seen.") for k in range(1, 7)]
    small = {"calibrated": Interval(0.1, 0.0, 0.2), "per_channel": {"tx": {"before": 0.1}}}
    tight = changed(springy, gap=replace(springy.diagnosis.gap, **small))
    assert [len(WrenchAnswer(replace(f, places=seen)).where) for f in (springy, tight)] == [3, 1]
    silent = replace(changed(without_cause(springy), verdict="none"), places=seen)
    assert "joint 1, joint 2, joint 3 and 3 more." in WrenchAnswer(silent).where[0]
    each = zip(CHANNELS, (2.7, 41.6, 12.0, 0.1, 0.0, -0.1), strict=True)
    loud = {c: {"before": gap} for c, gap in each}
    lost = without_cause(springy)
    lost = changed(lost, gap=replace(lost.diagnosis.gap, per_channel=loud))
    assert "explains the gap, 74 % in fy" in WrenchAnswer(lost).headline
    hint = {"subsystem": "sensor", "detail": "tx", "share": 0.3, "sentence": "Only a hint."}
    assert WrenchAnswer(changed(silent, where=[hint])).place == "Only a hint: channel tx"


def test_the_picture_has_each_pose_with_what_is_left_before_and_after(springy, tmp_path):
    diagnosis_view(springy, tmp_path / "d.rrd")
    e, rrd = HeldOutReadings(springy), Rrd(tmp_path / "d.rrd")
    curves = ("/residual", "Scalars:scalars")
    scene, rms = wrench_scene(e), [(r**2).mean(axis=1) ** 0.5 for r in e.residuals.values()]
    sensor = f"/world/{scene.frames.shape[1] - 1}"
    for arrow in scene.arrows:
        path = f"{sensor}/{arrow.name.replace(', ', '_').replace(' ', '_')}"
        assert np.allclose(rrd.values(path, "Arrows3D:vectors", "row")[:, 0], arrow.vectors)
    places = rrd.values(sensor, "Transform3D:translation", "row")[:, 0]
    assert np.allclose(places, scene.frames[:, -1, :, 3])
    assert np.allclose(rrd.values(*curves, "row"), np.transpose(rms)) and len(rms) == 2
    assert list(rrd.times(*curves, "row")) == e.ids.tolist() and "/blame" in rrd.entities()


def test_two_causes_are_counted(springy):
    (cause,) = springy.diagnosis.which
    gain = {"gain.fx": {"value": 0.01, "std": 1e-3, "unit": "1"}}
    other = {**cause, "effect": "sensor.gain", "rivals": [rival("tool.mass")], "parameters": gain}
    both = changed(springy, which=[cause, other], verdict="ambiguous")
    told = WrenchAnswer(both).headline
    assert told.startswith("Two causes. Joint 2 is compliant and deflects under gravity. Axes")
    assert ". Axes of the sensor have a gain error; or the tool" in told
    assert len(told) <= 160  # two lines: what an “or” means is said where there is room
    assert WrenchAnswer(both).place == "In joint 2 and in the sensor or in the tool"
    alone = changed(both, which=[{**other, "parameters": {}}])
    assert "does not distinguish" in WrenchAnswer(alone).headline
    assert "the same effect" in WrenchAnswer(changed(alone, verdict="identified")).headline


VERDICTS = {
    "unknown": ({}, "page: No known effect explains the gap; where: the residual follows; "
                "which: Probability that it is something unknown: > 0.99; far: It stays on 24"),
    "unknown, many alike": (
        {"cannot_tell": ["One, two and six explain the gap equally well"], "floor": 0.98},
        "page: More than five effects explain the gap alike; which: One, two and six explain the "
        "gap equally well: no choice; far: 0.98 of it"),
    "none": ({}, "page: No cause found: the residual is within normal imperfections; "
             "which: No cause is named.; far: there is nothing to close"),
    "none beside a gap": ({"calibrated": Interval(1.64, 0.71, 2.6)},
                          "far: Gap 1.64; far: 95 % interval is 0.71 … 2.60"),
    "none of the means' gap": ({"calibrated": Interval(113.0, 112.0, 114.0), "floor": 114.0},
                               "far: 113 of it is how single rows scatter"),
    "springy in part": (
        {"verdict": "partial", "with_effects": Interval(3.0, 2.5, 3.5),
         "closed": Interval(0.3, 0.2, 0.4)},
        "page: Most of the gap has another cause, which is unknown.; where: Mostly not in; "
        "far: 30.0 % closed; far: 20.0 … 40.0 %; which: joint.compliance"),
    "springy and worse": (
        {"with_effects": Interval(90.0, 80.0, 99.0), "closed": Interval(-2.5, -3.0, -2.0)},
        "far: Not closed; far: make the calibrated gap larger"),
}  # fmt: skip
"""Changes of a diagnosis, and texts of its page by their section."""


@pytest.mark.parametrize("case", VERDICTS)
def test_each_verdict_has_its_sentences(case, springy, healthy):
    of = {"unknown": without_cause(springy), "none": healthy, "springy": springy}
    if "alike" in case:
        of["unknown"] = replace(of["unknown"], verdict=replace(springy.verdict, alike=(("", 1),)))
    found, (change, texts) = of[case.split()[0].strip(",")], VERDICTS[case]
    gap = {k: v for k, v in change.items() if isinstance(v, Interval | float)}
    rest = {k: v for k, v in change.items() if k not in gap}
    page = shown(changed(found, gap=replace(found.diagnosis.gap, **gap), **rest))
    for section, text in (x.split(": ", 1) for x in texts.split("; ")):
        assert text in page[section]
    assert ("closed" in page["far"]) == case.startswith("springy")


@pytest.mark.slow
def test_what_scatters_rows_is_no_share_of_the_gap(tmp_path):
    noisy = found(tmp_path, "sensor.noise:" + ",".join(f"std.f{a}=0.2" for a in "xyz"))
    assert [w["effect"] for w in noisy.diagnosis.which] == ["sensor.noise"]
    page = shown(noisy)
    assert noisy.diagnosis.which[0]["probability"] == noisy.diagnosis.probabilities["sensor.noise"]
    std = noisy.diagnosis.which[0]["parameters"]["std.fx"]
    assert std["value"] == pytest.approx(0.2, abs=4 * std["std"])
    row = noisy.diagnosis.which[0]["size"]["row_noise.fx"]
    assert row["value"] ** 2 == pytest.approx(row["stated"] ** 2 + std["value"] ** 2)
    said = f"The sensor is noisier than stated: row noise fx {numbers.quantity('', row)} instead of"
    assert said in page["page"]
    assert "of a row's variance comes from it" in page["where"]
    assert "of the gap lies" not in page["where"]
    assert "scatters single rows; the means have no gap to close" in page["far"]
    moving = replace(noisy.diagnosis.gap, calibrated=Interval(66.0, 65.0, 67.0), floor=67.0)
    figure, text = WrenchAnswer(changed(noisy, gap=moving)).far
    assert figure == "Gap 66.0" and "no gap to close" not in text
    assert text.endswith(
        "66.0 of it is how single rows scatter: the detected cause (sensor.noise)."
    )


@pytest.mark.sampled
@pytest.mark.parametrize("case", ["springy", "healthy"])
def test_the_page_draws_each_channels_gap_and_its_ids_are_unique(case, request):
    findings = request.getfixturevalue(case)
    html = diagnosis_page(findings).html()
    drawn = findings.diagnosis.to_json()["gap"]["per_channel"].values()
    assert all(numbers.gap(x) in words(html) for channel in drawn for x in channel.values())
    html = without_scripts(html)
    assert not re.search(r"https?:|//\w+\.|@import|url\((?!#)", html)
    ids = re.findall(r'\bid="([^"]+)"', html)
    assert len(ids) == len(set(ids))
    used = re.findall(r'(?:url\(#|href="#)([^")]+)', html)
    assert set(used) <= set(ids)


def test_names_and_commands_are_escaped(healthy):
    evil = "<script>alert('$x$ & \"')<br>.parquet"
    html = diagnosis_page(changed(healthy, recording=evil), f"wrenchbed diagnose {evil}").html()
    html = without_scripts(html)
    assert "<script" not in html
    assert "&lt;script&gt;alert(" in html
    page = sections_of(html)
    assert page["page"].count(evil) == 5


@pytest.mark.slow
def test_the_command_line_writes_it_with_its_command(tmp_path, capsys):
    out = tmp_path / "a folder"
    assert main(["diagnose", recorded(tmp_path, 5).name, "--out", str(out), "--seed", "3"]) == 0
    assert "report.html" in capsys.readouterr().out
    digest = hashlib.sha256((tmp_path / "rec.parquet").read_bytes()).hexdigest()
    told = Rrd(out / "diagnosis.rrd").values("/report", "TextDocument:text")[0, 0]
    page = sections_of((out / "report.html").read_text(encoding="utf-8"))["page"]
    for shown in (told, page):
        assert f"SHA-256 of rec.parquet {digest}" in shown.replace(":", "")
        assert f"UTC by wrenchbed {version('wrenchbed')}" in shown
        assert "seed 3" in shown.replace(":", "") and f"--out '{out}' --seed 3" in shown
    verdict = json.loads((out / "diagnosis.json").read_text(encoding="utf-8"))["verdict"]
    assert told.startswith(f"# {verdict}: ") and "\n- calibrated " in told
    text = (out / "report.html").read_text(encoding="utf-8")
    assert f"--out &#39;{out}&#39; --seed 3" in text


@pytest.mark.sampled
@pytest.mark.parametrize("library", ["jinja2", "matplotlib"])
def test_without_its_extra_a_diagnosis_warns_and_goes_on(
    library, springy, tmp_path, capsys, monkeypatch
):
    require = registry.require

    def missing(name, extra):
        if name in (library, "rerun"):  # what is written beside it takes seconds
            raise MissingExtraError(
                f"{name} is not installed: run  pip install 'wrenchbed[{extra}]'"
            )
        return require(name, extra)

    monkeypatch.setattr(registry, "require", missing)
    monkeypatch.setattr("wrenchbed.diagnosis.diagnose.diagnose", lambda *_, **__: springy)
    assert main(["diagnose", springy.diagnosis.recording, "--out", str(tmp_path / "d")]) == 0
    told = capsys.readouterr()
    assert "no report.html" in told.err and "wrenchbed[report]" in told.err
    assert "report.html" not in told.out
    assert (tmp_path / "d" / "diagnosis.json").exists()
    assert not (tmp_path / "d" / "report.html").exists()


def test_poses_have_their_recordings_numbers_and_blind_spots_two_lines(springy):
    """As in diagnosis.json, whose outliers name the recording's segments."""
    p = springy.analysis.prepared
    own = np.unique(p.recording.columns["segment"])
    numbers_of, axis = along(p)
    assert list(numbers_of) == list(own) and axis.text == "number of the pose"
    later = dict(p.recording.columns) | {"segment": p.recording.columns["segment"] + 7}
    moved = replace(p, recording=replace(p.recording, columns=later))
    assert list(along(moved)[0]) == list(own + 7)
    spots = [BlindSpot(f"joint.{name}", "joint 1", None, "") for name in "abcdefgh"]
    spots += [BlindSpot("joint.offset", f"joint {k}", None, "") for k in (2, 3)]
    assert unseen(spots, 60) == "joint.offset of joints 2 and 3; 8 other effects"
    assert unseen(spots[:8], 45) == "joint.a of joint 1; 7 other effects"
    assert unseen(spots[:2], 60) == "joint.a and joint.b of joint 1"

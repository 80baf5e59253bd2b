"""The efforts' referee: its physics by published and general laws, its truth apart, its score."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.integrate import cumulative_simpson, solve_ivp

from wrenchbed import registry
from wrenchbed.benchmark.efforts import case, drives
from wrenchbed.benchmark.efforts.arm import Path as Motion
from wrenchbed.benchmark.efforts.arm import TrueArm, draw, of_values
from wrenchbed.benchmark.efforts.case import FAMILIES, OUTSIDE
from wrenchbed.benchmark.efforts.drives import bouc_wen, lugre
from wrenchbed.benchmark.sealed import commitments, make, score
from wrenchbed.benchmark.sealed.make import EffortFamily
from wrenchbed.benchmark.sealed.run import CLAIM
from wrenchbed.data.recording import Recording
from wrenchbed.physics.wrench import CHANNELS

UR5 = registry.load("robots", "ur5")


def setting_of(number: int) -> drives.EffortSetting:
    return drives.draw_setting(UR5, np.random.default_rng([77, number]))


def test_lugre_settles_on_the_published_curve_and_agrees_with_a_general_integrator():
    """Canudas de Wit 1995, Table I and Eq. 6: Fc 1 N, Fs 1.5 N, vs 0.001 m/s, σ₀ 1e5, σ₁ √1e5."""
    speeds = np.array([1e-4, 5e-4, 1e-3, 2e-3, 5e-3, -1e-3])
    step, rows = 1e-4, 40000
    v = np.tile(speeds, (rows, 1))
    level = 1.0 + 0.5 * np.exp(-((v / 0.001) ** 2))
    found = lugre(v, step, level, np.full(6, 1e5), np.full(6, np.sqrt(1e5)))[-1]
    hand = [1.4950249, 1.3894004, 1.1839397, 1.0091578, 1.0, -1.1839397]
    assert found == pytest.approx(hand, abs=1e-6)
    step = 1e-4
    t = np.arange(4000) * step
    v = 0.05 * np.cos(2.0 * np.pi * 3.0 * t)
    stiffness, coulomb = 5e3, 4.0
    told = solve_ivp(
        lambda s, z: [0.05 * np.cos(6.0 * np.pi * s)
                      - stiffness * abs(0.05 * np.cos(6.0 * np.pi * s)) * z[0] / coulomb],
        (0.0, t[-1]), [0.0], t_eval=t, rtol=1e-9, atol=1e-14, max_step=1e-3,
    ).y[0]  # fmt: skip
    level = np.full((len(t), 1), coulomb)
    ours = lugre(v[:, None], step, level, np.array([stiffness]), np.zeros(1))[:, 0]
    assert np.abs(ours - stiffness * told).max() < 0.01 * coulomb


def test_bouc_wen_yields_at_one_and_encloses_an_area():
    step = 1e-3
    t = np.arange(8000) * step
    q = 0.5 * np.sin(2.0 * np.pi * 0.5 * t)
    z = bouc_wen(np.gradient(q, step), step, 0.05)
    assert np.abs(z).max() == pytest.approx(1.0, abs=0.01)
    turn = slice(4000, 6000)
    # a rigid-plastic loop of ±1 over ±0.5 rad is 2 rad; the elastic ends take a part of it
    assert 1.6 < float(np.trapezoid(z[turn], q[turn])) < 2.0


@pytest.mark.parametrize("number", [1, 2])
def test_links_keep_the_balance_of_energy(number):
    setting = setting_of(number)
    path = setting.path
    short = slice(0, 6000)
    part = Motion(path.rate, *(x[short] for x in (path.t, path.q, path.qd, path.qdd)))
    arm = TrueArm(UR5, setting.theta, setting.edits)
    power = (arm.inverse(part)[0] * part.qd).sum(axis=1)
    work = cumulative_simpson(power, x=part.t, initial=0.0)
    model = arm.bodies.model
    model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_ENERGY
    data, energy = mujoco.MjData(model), np.empty(len(part.t))
    for k, place in enumerate(UR5.qpos(part.q, setting.theta)):
        data.qpos[:], data.qvel[:] = place, part.qd[k]
        mujoco.mj_forward(model, data)
        energy[k] = data.energy.sum()
    assert np.ptp(energy) > 5.0
    assert np.abs(work - (energy - energy[0])).max() < 1e-3 * np.ptp(energy)


@pytest.mark.parametrize("number", range(4))
def test_motions_stay_within_limits(number):
    path = draw(UR5, np.random.default_rng(number))
    lower, upper = (np.array([getattr(j, k) for j in UR5.joints]) for k in ("lower", "upper"))
    assert ((path.q >= lower) & (path.q <= upper)).all()
    assert (np.abs(path.qd) <= 1.01 * np.array([j.speed for j in UR5.joints])).all()
    assert 30.0 <= path.t[-1] + path.step <= 60.1


@pytest.mark.sampled
@pytest.mark.parametrize("name", [*FAMILIES, *OUTSIDE])
def test_every_family_changes_the_effort_of_its_joint(name):
    setting = setting_of(3)
    if name == "drive.temperature":
        warmth = drives.warming(setting.path, np.random.default_rng(0), 12.0)
        setting = replace(setting, temperature=warmth)
    fault = (FAMILIES | OUTSIDE)[name](setting, 2, np.random.default_rng(4))
    added = drives.simulate(setting, fault) - setting.healthy
    sizes = np.sqrt((added**2).mean(axis=0))
    assert np.isfinite(added).all() and sizes.max() > 0.0
    if name.startswith("drive."):
        assert fault.joint == 2 and np.flatnonzero(sizes).tolist() == [2]


@pytest.mark.slow
def test_an_asymmetry_without_reversal_is_like_an_offset_and_a_coulomb_fault_is_not():
    """Decided from signatures: with reversals Coulomb friction is told from an offset."""
    setting = setting_of(5)
    fault = FAMILIES["drive.coulomb"](setting, 1, np.random.default_rng(6))
    added = drives.simulate(setting, fault) - setting.healthy
    rest = case.remaining(setting, fault, added)
    assert rest["drive.coulomb.2"] < 0.1 * rest["drive.offset.2"]
    path = setting.path
    q = path.q.copy()
    q[:, 1] = q[0, 1] + np.cumsum(np.abs(path.qd[:, 1]) + 0.05) * path.step * 0.05
    oneway = replace(setting, path=of_values(path.rate, path.t, q))
    added = drives.simulate(oneway, fault) - oneway.healthy
    size, rest = case.gap_of(oneway, added), case.remaining(oneway, fault, added)
    assert "drive.offset.2" in case.classed(fault, size, rest)


def family(seed, cases, **options):
    return EffortFamily("ur5,ur5", "dynamic", cases, seed, **options)


@pytest.mark.slow
def test_a_seed_makes_the_same_case_again():
    (first, one), (second, two), (other, _) = (family(5, 4).found(n) for n in (2, 2, 3))
    assert first == second and first.causes != other.causes
    for name, column in one.columns.items():
        assert np.array_equal(column, two.columns[name]), name


@pytest.mark.sampled
@pytest.mark.parametrize("number", [0, 1, 4])
def test_the_recording_holds_no_truth(number, tmp_path):
    cases = family(6, 5, wrench=number == 4)
    make.open_family(cases, tmp_path / "c", tmp_path / "a")
    make.make_case(cases, tmp_path / "c", tmp_path / "a", number)
    name = cases.names()[number]
    again = Recording.read(commitments.recording_of(tmp_path / "c", name))
    truth = commitments.read_answer(commitments.answer_of(tmp_path / "a", name))
    assert truth.kind == cases.kinds()[number]
    assert all(c.gap >= 1.0 for c in truth.causes)
    told = json.dumps(again.metadata.to_json())
    assert not [n for n in (*OUTSIDE, "family", "alike", "gap") if f'"{n}"' in told]
    for value in (v for c in truth.causes for v in c.true.values()):
        assert repr(float(value)) not in told
    allowed = {"t", *CHANNELS} | {f"{p}{j}" for p in ("q", "tau", "i", "joint_temperature")
                                  for j in range(1, 8)}  # fmt: skip
    assert set(again.columns) <= allowed
    assert again.has_wrench == (number == 4)


def test_causes_of_drives_are_claimed_with_their_joint(tmp_path):
    raw = {"verdict": "ambiguous", "probabilities": {"drive.load": 0.9, "unknown": 0.1},
           "which": [{"effect": "drive.load", "probability": 0.8, "rivals": ["drive.coulomb"],
                      "parameters": {"joint": {"value": 4, "rivals": [5]}}},
                     {"effect": "tool.mass", "probability": 0.6, "parameters": {}}]}  # fmt: skip
    (tmp_path / CLAIM).write_text(json.dumps(raw))
    found = score.read(tmp_path)
    assert found.error == ""
    assert found.causes == (
        ("drive.load.4", "drive.load.5", "drive.coulomb.4", "drive.coulomb.5"), ("tool.mass",),
    )  # fmt: skip
    assert found.presence == (0.8, 0.6)

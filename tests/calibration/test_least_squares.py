"""The parts of a calibration on problems that a hand can solve: steps, weights, noise, drift."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import integrate, special
from scipy.signal import lfilter

from wrenchbed.calibration import weighting
from wrenchbed.calibration.fit_problem import Problem, _robust_weight
from wrenchbed.calibration.least_squares import MAX_STEPS, Solution, solve
from wrenchbed.calibration.observability import Observability, null_space
from wrenchbed.calibration.observations import Observations
from wrenchbed.calibration.touch_points import Agreement, Touches
from wrenchbed.errors import CalibrationError
from wrenchbed.physics.taylor_jets import Jet


def test_a_step_has_least_norm_in_units_of_tolerances():
    """x + y = 3 with tolerances 1 and 2: along (1, 2) scaled, so (0.6, 2.4)."""
    scale = np.array([1.0, 2.0])
    told = solve(lambda x: np.array([3.0 - x.sum()]), lambda _: np.ones((1, 2)), np.zeros(2), scale)
    assert told.x == pytest.approx([0.6, 2.4])
    assert told.covariance == pytest.approx(np.array([[1.0, 4.0], [4.0, 16.0]]) / 25.0)
    assert told.blind == pytest.approx(np.sqrt([0.8, 0.2]))
    assert (told.rank, told.converged) == (1, True)
    assert told.steps <= 2
    assert told.residual == pytest.approx([0.0])
    assert told.jacobian[0] == pytest.approx([1.0, 2.0])


def test_a_step_that_raises_the_cost_is_halved():
    """From 3 a full step on arctan x leads to −9.5 and away for ever."""
    told = solve(
        lambda x: -np.arctan(x),
        lambda x: 1.0 / (1.0 + x[:, None] ** 2),
        np.array([3.0]),
        np.ones(1),
    )
    assert told.converged
    assert told.x == pytest.approx([0.0], abs=1e-9)


def test_an_iteration_ends_where_nothing_is_better_and_after_fifty_steps():
    told = solve(
        lambda x: np.array([1.0]) if x[0] == 2.0 else np.array([np.nan]),
        lambda _: np.ones((1, 1)), np.array([2.0]), np.ones(1),
    )  # fmt: skip
    assert (told.x[0], told.steps, told.converged) == (2.0, 1, True)
    # Slopes ten times too steep: a tenth of the way is left out at each step.
    told = solve(lambda x: -x, lambda _: np.full((1, 1), 10.0), np.ones(1), np.ones(1))
    assert (told.steps, told.converged) == (MAX_STEPS, False) == (50, False)
    assert told.x == pytest.approx([0.9**50])


class Linear:
    """A model whose wrench is linear in its parameters: design (M, 6, K)."""

    def __init__(self, design, tolerance):
        self.design, self.gravity = design, (0.0, 0.0, -9.81)
        seen = np.random.default_rng(9).standard_normal((len(design), 3))
        self.robot = SimpleNamespace(
            robot_theta=lambda theta: theta, gravity_seen=lambda q, theta, gravity: seen
        )
        self.parameters = SimpleNamespace(tolerance=np.asarray(tolerance, dtype=float))

    def predict(self, q, theta):
        return self.design @ theta

    def jacobian(self, q, theta, free):
        return self.design[..., list(free)]


def problem(y, design, *, covariance=None, count=1, source="stated", q=None, t=None, **options):
    """A fit of all parameters but the last; dof of the noise is infinite."""
    m, _, k = design.shape
    data = Observations(
        np.zeros((m, 1)) if q is None else q, y, np.full(m, count),
        np.zeros((6, 6)) if covariance is None else covariance, np.inf, source,
        np.arange(float(m)) if t is None else t, np.ones(m, dtype=bool),
    )  # fmt: skip
    model = Linear(design, options.pop("tolerance", np.ones(k)))
    return Problem(model, data, np.zeros(k), tuple(range(k - 1)), np.zeros(k - 1), **options)


def designed(m=40, k=4, seed=0):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((m, 6, k)), rng


def test_variance_is_shared_out_over_channels_and_robust_with_a_robust_loss():
    design, _ = designed(10, 4)
    p = problem(np.ones((10, 6)), design)
    assert p.dof == pytest.approx(10 - 3 / 6)
    assert problem(np.ones((10, 6)), design, prior=True).dof == 10.0
    assert problem(np.ones((1, 6)), designed(1, 9)[0]).dof == 1.0
    design, _ = designed(9, 1)
    y = np.outer([1.0, -2, 3, -4, 5, -6, 7, -8, 90], np.ones(6))
    plain = problem(y, design).residual_variance(np.zeros(0))
    assert plain == pytest.approx((y**2).sum(axis=0) / 9)
    robust = problem(y, design, loss="huber").residual_variance(np.zeros(0))
    assert robust == pytest.approx(np.full(6, (1.4826 * 5.0) ** 2))
    scale = 1.4826 * 1.345
    residual = np.array([0.0, 0.5, 1.345, 2.69, -13.45])
    expected = np.minimum(1.0, 1.345 / np.maximum(np.abs(residual) / scale, 1e-9))
    assert _robust_weight(residual) == pytest.approx(expected)
    small = np.array([0.1, -0.2, 0.1, 3.0, 0.1])  # typical ones below 1 stay in their unit
    assert _robust_weight(small) == pytest.approx([1, 1, 1, 1.345 / 3.0, 1])


def test_a_prior_draws_to_its_centre_by_its_tolerance():
    design, rng = designed()
    y = rng.standard_normal((40, 6))
    p = problem(y, design, tolerance=[0.1, 0.2, 0.3, 1.0], prior=True)
    p = Problem(p.model, p.data, p.theta, p.free, np.array([1.0, 2.0, 3.0]), True)
    flat, weight = design[..., :3].reshape(-1, 3), np.diag(1.0 / np.array([0.1, 0.2, 0.3]) ** 2)
    normal = flat.T @ flat + weight
    expected = np.linalg.solve(normal, flat.T @ y.ravel() + weight @ [1.0, 2.0, 3.0])
    told = p.solve(lambda r: r, p.start)
    assert told.x == pytest.approx(expected)
    assert told.covariance == pytest.approx(np.linalg.inv(normal))


def covariance(seed=2):
    a = np.random.default_rng(seed).standard_normal((6, 6))
    return a @ a.T + np.eye(6)


def test_means_of_more_rows_weigh_more():
    c, count = covariance(), np.array([1.0, 4.0, 9.0])
    whiten = weighting._rows(c, count)
    turned = whiten(np.tile(np.eye(6), (3, 1, 1)))  # (M, 6, K): K unit wrenches
    for m, n in enumerate(count):
        assert turned[m].T @ turned[m] == pytest.approx(n * np.linalg.inv(c))
    rows = np.random.default_rng(0).standard_normal((3, 6))
    assert whiten(rows) == pytest.approx(np.einsum("mij,mj->mi", turned, rows))


def noisy(times, seed=3, m=60, count=4):
    """A problem whose means scatter ``times`` as much as the noise of their rows explains."""
    design, rng = designed(m, 4, seed)
    c = covariance()
    noise = rng.standard_normal((m, 6)) @ np.linalg.cholesky(c).T / np.sqrt(count)
    return problem(design @ [1.0, 2.0, 3.0, 0.0] + times * noise, design, covariance=c, count=count)


def test_noise_that_explains_the_residual_gives_the_weights():
    p = noisy(1.0)
    told = weighting.fit(p)
    flat = np.einsum("ij,mjk->mik", np.linalg.inv(np.linalg.cholesky(covariance())), p.model.design)
    flat = 2.0 * flat[..., :3].reshape(-1, 3)
    assert told.covariance == pytest.approx(np.linalg.inv(flat.T @ flat))
    assert (told.dof, told.noise.inflated, told.noise.source) == (np.inf, False, "stated")
    assert told.noise.row == pytest.approx(np.sqrt(np.diagonal(covariance())))
    assert told.noise.expected == pytest.approx(told.noise.row / 2.0)
    assert told.noise.effective == pytest.approx(np.full(6, 240.0))
    assert told.noise.rows == 4.0


def test_a_residual_that_noise_does_not_explain_widens_the_uncertainties():
    plain, wide = weighting.fit(noisy(1.0)), weighting.fit(noisy(5.0))
    assert wide.noise.inflated
    assert wide.dof == pytest.approx(60 - 0.5)
    ratio = np.sqrt(np.diagonal(wide.covariance) / np.diagonal(plain.covariance))
    assert ratio == pytest.approx(np.full(3, 5.0), rel=0.2)
    assert wide.noise.effective.max() < 240.0 / 10.0
    few = weighting.fit(noisy(5.0, m=20))  # too few to tell wander: 20 poses and 3 parameters
    assert few.noise.inflated
    worth = 80.0 / (few.noise.scatter / few.noise.expected) ** 2
    assert few.noise.effective == pytest.approx(worth, rel=1e-3)


def test_without_any_noise_known_forces_and_torques_have_one_level_each():
    design, rng = designed(80, 4)
    size = np.array([1.0, 1.0, 1.0, 0.1, 0.1, 0.1])
    y = design @ [1.0, 2.0, 3.0, 0.0] + size * rng.standard_normal((80, 6))
    told = weighting.fit(problem(y, design, source="residual", count=3))
    weighed = design[..., :3] / size[:, None]
    flat = weighed.reshape(-1, 3)
    expected = np.sqrt(np.diagonal(np.linalg.inv(flat.T @ flat)))
    assert np.sqrt(np.diagonal(told.covariance)) == pytest.approx(expected, rel=0.12)
    assert told.noise.scatter == pytest.approx(size, rel=0.25)
    assert told.noise.row == pytest.approx(told.noise.scatter * np.sqrt(3))
    assert told.noise.effective == pytest.approx(240.0)
    assert (told.noise.source, told.noise.inflated) == ("residual", False)
    assert told.dof == pytest.approx(79.5)


def test_an_exact_fit_is_known_as_such():
    design, _ = designed(20, 4)
    told = weighting.fit(problem(design @ [1.0, 2.0, 3.0, 0.0], design, source="residual"))
    assert told.solution.x == pytest.approx([1.0, 2.0, 3.0])
    assert np.diagonal(told.covariance).max() < 1e-20
    data = SimpleNamespace(wrench=np.array([[-8.0, 2.0]]))
    assert weighting._exact(np.full(6, (7e-12) ** 2), data)
    assert not weighting._exact(np.full(6, (9e-12) ** 2), data)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.8])
def test_the_correlation_time_of_a_motion_is_that_of_its_residual(rho):
    """(1 + ρ) / (1 − ρ) samples: 1, 3 and 9."""
    rng = np.random.default_rng(4)
    y = lfilter([1.0], [1.0, -rho], rng.standard_normal((20000, 6)), axis=0) + 7.0
    design = np.zeros((20000, 6, 1))
    zero = np.zeros((20000, 1))
    p = problem(y, design, q=Jet(zero, zero, zero))
    expected = (1 + rho) / (1 - rho)
    told = weighting._correlation_time(p, np.zeros(0))
    assert np.median(told) == pytest.approx(expected, rel=0.25)
    assert told.min() >= 1.0
    assert weighting._correlation_time(problem(y, design), np.zeros(0)) == pytest.approx(np.ones(6))


def test_batch_means_show_what_is_slow():
    """Twenty levels, each held for 50 rows: the scatter of means is all there is."""
    level = np.random.default_rng(5).standard_normal((20, 6))
    r = np.repeat(level, 50, axis=0)
    expected = 50 * level.var(axis=0, ddof=1) / level.var(axis=0)
    assert weighting._batch_time(r) == pytest.approx(expected)
    longer = np.concatenate([r, 9.0 * r[:7]])
    want = 50 * level.var(axis=0, ddof=1) / longer.var(axis=0)
    assert weighting._batch_time(longer) == pytest.approx(want)


def test_the_kernel_is_the_integral_of_a_band_of_1_f_noise():
    t = np.array([0.0, 3.0, 10.0, 20.0])
    told = weighting.kernel(t)
    low, high = 0.1 / 20.0, 4.0 / 20.0
    for i, a in enumerate(t):
        for j, b in enumerate(t):
            value, _ = integrate.quad(lambda f, s=a - b: np.cos(2 * np.pi * f * s) / f, low, high)
            assert told[i, j] == pytest.approx(value, abs=1e-9)


def slow(n=30, seed=6):
    t = np.sort(np.random.default_rng(seed).uniform(0.0, 100.0, n))
    return t, weighting.kernel(t), np.random.default_rng(seed)


def test_whitened_rows_have_unit_variance_and_the_mean_its_best_estimate():
    _, K, _ = slow()
    spread, basis = np.linalg.eigh(K)
    w = weighting.Wander(np.full(6, 2.0), np.array([0.0, 1, 2, 3, 4, 5]), basis, spread)
    for c in range(6):
        turn = w.whiten(np.tile(np.eye(30)[:, None], (1, 6, 1)))[:, c]
        whole = 2.0 * np.eye(30) + c * K
        assert turn @ whole @ turn.T == pytest.approx(np.eye(30), abs=1e-9)
        best = 1.0 / (np.ones(30) @ np.linalg.inv(whole) @ np.ones(30))
        white = w.whiten(np.ones((30, 6)))[:, c]
        assert 1.0 / (white @ white) == pytest.approx(best)


def test_restricted_likelihood_is_that_of_the_dense_matrices():
    _, K, rng = slow()
    x, r = np.linalg.qr(rng.standard_normal((30, 3)))[0], rng.standard_normal(30)
    spread, basis = np.linalg.eigh(K)
    cost, square = weighting._restricted(basis.T @ r, basis.T @ x, 1.0 / (1.0 + 0.7 * spread))
    V = np.eye(30) + 0.7 * K
    inverse = np.linalg.inv(V)
    gram = x.T @ inverse @ x
    P = inverse - inverse @ x @ np.linalg.solve(gram, x.T @ inverse)
    assert square == pytest.approx(r @ P @ r / 27)
    expected = 27 * np.log(square) + np.linalg.slogdet(V)[1] + np.linalg.slogdet(gram)[1]
    assert cost == pytest.approx(expected / 2)


def test_both_levels_are_found_and_the_independent_one_is_at_least_what_is_known():
    t = np.arange(300.0) * 5.0
    K = weighting.kernel(t)
    rng = np.random.default_rng(7)
    spread, basis = np.linalg.eigh(K)
    moving = (basis * np.sqrt(np.maximum(spread, 0.0))) @ rng.standard_normal((300, 6))
    residual = rng.standard_normal((300, 6)) + np.array([0, 0, 0, 0.7, 0.7, 0.7]) * moving
    design = np.ones((300, 6, 1))
    modes = weighting.modes(t)
    told = weighting.estimate(modes, residual, design, np.full(6, 0.01))
    assert told.independent[:3] == pytest.approx(np.ones(3), rel=0.2)
    assert told.level[:3].max() < 0.2
    white = 2.0  # what a band up to one cycle a pose has in all directions
    both = (told.independent + white * told.level)[3:]
    assert both == pytest.approx(np.full(3, 1.0 + white * 0.49), rel=0.3)
    assert told.level[3:] == pytest.approx(np.full(3, 0.49), rel=0.7)
    floored = weighting.estimate(modes, residual, design, np.full(6, 3.0))
    assert floored.independent == pytest.approx(np.full(6, 3.0))
    assert floored.level == pytest.approx(told.level)


def test_a_touch_is_judged_by_a_fit_of_all_the_others():
    rng = np.random.default_rng(8)
    J, y = rng.standard_normal((6 + 12, 3)), rng.standard_normal(18)
    y[9:12] += 6.0
    x = np.linalg.lstsq(J, y, rcond=None)[0]
    solution = Solution(x, y - J @ x, J, np.eye(3), np.zeros(3), 3, 1, True)
    told = Touches(np.zeros((4, 1)), np.zeros((4, 3)), 0.01).agreement(solution, 6)
    square = []
    for k in range(4):
        own = np.arange(6 + 3 * k, 9 + 3 * k)
        others = np.delete(np.arange(18), own)
        fitted = np.linalg.lstsq(J[others], y[others], rcond=None)[0]
        spread = np.eye(3) + J[own] @ np.linalg.inv(J[others].T @ J[others]) @ J[own].T
        away = y[own] - J[own] @ fitted
        square.append(away @ np.linalg.inv(spread) @ away)
    assert told.worst == int(np.argmax(square)) == 1
    assert told.distance == pytest.approx(np.sqrt(max(square)))
    assert told.p_value == pytest.approx(min(1.0, 4 * special.chdtrc(3, max(square))))
    assert (told.count, told.std) == (4, 0.01)
    assert Agreement(3, 1e-4, 0, 5.0, 0.0009).doubtful
    assert not Agreement(3, 1e-4, 0, 4.0, 0.0011).doubtful


@pytest.mark.parametrize("std", [0.0, -1.0, np.inf])
def test_an_impossible_deviation_of_touches_is_refused(std):
    recording = SimpleNamespace(name="r", columns={"px": 0, "py": 0, "pz": 0}, joints=("q1",))
    with pytest.raises(CalibrationError, match="must be above 0"):
        Touches.of(recording, std)
    recording.columns.pop("py")
    with pytest.raises(CalibrationError, match="no columns px py pz"):
        Touches.of(recording, 1e-4)


def test_what_data_cannot_tell_is_named():
    rng = np.random.default_rng(9)
    a, b, c = rng.standard_normal((3, 30))
    J = np.stack([a, a, b, -b, c, np.zeros(30), 2 * a + b], axis=1)
    told = Observability(J, list("stuvwxy"), np.ones(7))
    assert told.rank == 3
    assert told.no_effect == ("x",)
    sentences = [r.sentence for r in told.redundancies]
    assert "s and t enter only as their sum s + t" in sentences
    assert "u and v enter only as their difference v − u" in sentences
    assert len(sentences) == 3
    assert [len(r.names) for r in told.redundancies] == [2, 2, 3]
    for r in told.redundancies:
        direction = np.zeros(7)
        direction[["stuvwxy".index(n) for n in r.names]] = r.direction
        assert J @ direction == pytest.approx(np.zeros(30), abs=1e-9)


def test_directions_are_in_the_parameters_own_units_and_symmetries_keep_their_name():
    a = np.random.default_rng(10).standard_normal(30)
    J = np.stack([a, 5.0 * a], axis=1)
    told = Observability(J, ["s", "t"], np.array([2.0, 0.1]))
    (one,) = told.redundancies
    assert np.array(one.direction) == pytest.approx(np.array([1.0, -0.2]))
    named = Observability(J, ["s", "t"], np.ones(2), {"a shift": {"s": -5.0, "t": 1.0}})
    assert named.redundancies[0].sentence == "a shift changes no reading (s, t)"
    wrong = Observability(J, ["s", "t"], np.ones(2), {"a shift": {"s": 1.0, "t": 1.0}})
    assert "a shift" not in wrong.redundancies[0].sentence


def test_rank_and_null_space_of_few_and_of_no_rows():
    rank, s, basis = null_space(np.array([[1.0, 1.0, 0.0]]))
    assert (rank, basis.shape) == (1, (3, 2))
    assert s == pytest.approx([np.sqrt(2.0)])
    assert np.array([1.0, 1.0, 0.0]) @ basis == pytest.approx([0.0, 0.0])
    assert null_space(np.zeros((4, 2)))[0] == 0
    assert null_space(np.array([[1e-3, 1e-3, 0.0]]))[0] == 1
    assert null_space(np.diag([1.0, 1e-9, 1e-11]))[0] == 2

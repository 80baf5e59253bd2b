"""Time derivatives and parameter derivatives of formulas, against hand-computed ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchbed.physics import time_derivatives as td
from wrenchbed.physics.rotations import (
    euler,
    euler_rates,
    exp,
    matrix,
    quaternion,
    rot_x,
    rot_y,
    rot_z,
)
from wrenchbed.physics.time_derivatives import Jet

finite = st.floats(-3.0, 3.0, allow_nan=False)
positive = st.floats(0.3, 3.0, allow_nan=False)


def jet(v: float, d: float, dd: float) -> Jet:
    return Jet(np.array(v), np.array(d), np.array(dd))


def close(found: Jet, wanted: tuple[float, float, float]) -> bool:
    return np.allclose([found.v, found.d, found.dd], wanted, rtol=1e-11, atol=1e-11)


@given(finite, finite, finite)
def test_a_jet_of_sine_cosine_and_root(v, d, dd):
    s, c = np.sin(v), np.cos(v)
    assert close(td.sin(jet(v, d, dd)), (s, c * d, c * dd - s * d * d))
    assert close(td.cos(jet(v, d, dd)), (c, -s * d, -s * dd - c * d * d))
    x = 4.0 + v
    root = np.sqrt(x)
    wanted = (root, d / (2 * root), dd / (2 * root) - d * d / (4 * root**3))
    assert close(td.jet_sqrt(jet(x, d, dd)), wanted)


@given(positive, finite, finite, positive, finite, finite)
def test_a_quotient_times_its_divisor_is_the_dividend(a, da, dda, b, db, ddb):
    x, y = jet(a, da, dda), jet(b, db, ddb)
    assert close((x / y) * y, (a, da, dda))
    assert close((1.0 / y) * y, (1.0, 0.0, 0.0))
    assert close(x - y + y, (a, da, dda))
    assert close((2.0 - x) + x, (2.0, 0.0, 0.0))


@given(finite, finite, finite, positive, finite)
def test_the_angle_of_a_vector_that_turns_and_grows(angle, rate, acceleration, radius, growth):
    turning, length = jet(angle, rate, acceleration), jet(radius, growth, 0.0)
    found = td.atan2(length * td.sin(turning), length * td.cos(turning))
    assert np.allclose([found.d, found.dd], [rate, acceleration], atol=1e-9)
    assert np.isclose(np.cos(found.v - angle), 1.0)


def test_matrix_products_follow_the_product_rule():
    rng = np.random.default_rng(0)
    a, b = (Jet(*rng.normal(size=(3, 4, 3, 3))) for _ in range(2))
    product = a @ b
    assert np.allclose(product.d, a.d @ b.v + a.v @ b.d)
    assert np.allclose(product.dd, a.dd @ b.v + 2 * a.d @ b.d + a.v @ b.dd)
    fixed = rng.normal(size=(3, 3))
    assert np.allclose((fixed @ a).dd, fixed @ a.dd)
    assert np.allclose((a @ fixed).d, a.d @ fixed)
    assert np.allclose((fixed * a).v, fixed * a.v)


@given(finite, finite, finite)
def test_rotations_are_orthonormal_and_quaternions_return(x, y, z):
    for rotation in (euler(x, y, z), exp(np.array(x), np.array(y), np.array(z))):
        assert np.allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
        assert np.isclose(np.linalg.det(rotation), 1.0)
        q = quaternion(rotation)
        of_scipy = Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True)
        assert q[0] >= 0 and np.allclose(q, of_scipy, rtol=0, atol=1e-15)
        assert np.allclose(matrix(q), rotation, atol=1e-12)


def test_elementary_rotations_have_the_hand():
    half = np.pi / 2
    assert np.allclose(rot_x(half) @ [0, 1, 0], [0, 0, 1])
    assert np.allclose(rot_y(half) @ [0, 0, 1], [1, 0, 0])
    assert np.allclose(rot_z(half) @ [1, 0, 0], [0, 1, 0])
    assert np.allclose(exp(0.0, 0.0, half), rot_z(half), atol=1e-15)
    assert np.allclose(euler(0.1, 0.2, 0.3), rot_x(0.3) @ rot_y(0.2) @ rot_z(0.1))


def test_euler_rates_give_the_angular_velocity_in_turned_axes():
    angles = np.array([0.3, -0.4, 0.7])
    for k in range(3):
        rate = np.zeros(3)
        rate[k] = 1.0
        turning = [
            Jet(np.array(a), np.array(r), np.array(0.0)) for a, r in zip(angles, rate, strict=True)
        ]
        rotation = euler(*turning)
        spin = rotation.v.T @ rotation.d
        omega = [spin[2, 1], spin[0, 2], spin[1, 0]]
        assert np.allclose(omega, euler_rates(*angles)[:, k])

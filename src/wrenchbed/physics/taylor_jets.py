"""Second-order Taylor arithmetic in time: exact velocities and accelerations of any formula.

A `Jet` carries a value and its first and second time derivative. Formulas written with the
functions of this module accept plain arrays, complex arrays (for the complex-step derivative with
respect to a parameter; Squire & Trapp 1998, doi 10.1137/S003614459631241X) and jets, so one
closed-form expression gives pose, velocity, acceleration and their parameter Jacobians.
Griewank & Walther, Evaluating Derivatives, 2nd ed., ch. 13.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Value = Any
"""A real or complex array, a number, or a `Jet`."""
STEP = 1e-30
"""Imaginary step of the complex-step derivative; exact to rounding however small."""


@dataclass(frozen=True, eq=False)
class Jet:
    """An array ``v`` with its exact time derivatives ``d`` [1/s] and ``dd`` [1/s²]."""

    v: np.ndarray
    d: np.ndarray
    dd: np.ndarray

    __array_ufunc__ = None  # let `array * jet` call Jet.__rmul__

    def __add__(self, other: Value) -> "Jet":
        if isinstance(other, Jet):
            return Jet(self.v + other.v, self.d + other.d, self.dd + other.dd)
        return Jet(self.v + other, self.d, self.dd)

    __radd__ = __add__

    def __neg__(self) -> "Jet":
        return Jet(-self.v, -self.d, -self.dd)

    def __sub__(self, other: Value) -> "Jet":
        return self + (-other)

    def __rsub__(self, other: Value) -> "Jet":
        return -self + other

    def __mul__(self, other: Value) -> "Jet":
        return _product(self, other, np.multiply)

    def __rmul__(self, other: Value) -> "Jet":
        return Jet(other * self.v, other * self.d, other * self.dd)

    def __matmul__(self, other: Value) -> "Jet":
        return _product(self, other, np.matmul)

    def __rmatmul__(self, other: Value) -> "Jet":
        return Jet(other @ self.v, other @ self.d, other @ self.dd)

    def __truediv__(self, other: Value) -> "Jet":
        if isinstance(other, Jet):
            r = 1.0 / other.v
            return self * other._chain(r, -(r**2), 2.0 * r**3)
        return self * (1.0 / other)

    def __rtruediv__(self, other: Value) -> "Jet":
        r = 1.0 / self.v
        return other * self._chain(r, -(r**2), 2.0 * r**3)

    def __getitem__(self, key: Any) -> "Jet":
        return Jet(self.v[key], self.d[key], self.dd[key])

    def _chain(self, f: np.ndarray, f1: np.ndarray, f2: np.ndarray) -> "Jet":
        """Chain rule: the jet of f(self), from ``f``, ``f1``, ``f2``: f and its first and second
        derivative at the value of self."""
        return Jet(f, f1 * self.d, f1 * self.dd + f2 * self.d**2)


def _product(a: Jet, b: Value, op: Callable[..., Any]) -> Jet:
    if isinstance(b, Jet):
        return Jet(
            op(a.v, b.v),
            op(a.d, b.v) + op(a.v, b.d),
            op(a.dd, b.v) + 2.0 * op(a.d, b.d) + op(a.v, b.dd),
        )
    return Jet(op(a.v, b), op(a.d, b), op(a.dd, b))


def sin(x: Value) -> Value:
    if isinstance(x, Jet):
        s, c = np.sin(x.v), np.cos(x.v)
        return x._chain(s, c, -s)
    return np.sin(x)


def cos(x: Value) -> Value:
    if isinstance(x, Jet):
        s, c = np.sin(x.v), np.cos(x.v)
        return x._chain(c, -s, -c)
    return np.cos(x)


def jet_sqrt(x: Value) -> Value:
    if isinstance(x, Jet):
        r = np.sqrt(x.v)
        return x._chain(r, 0.5 / r, -0.25 / (r * x.v))
    return np.sqrt(x)


def atan2(y: Value, x: Value) -> Value:
    """Angle of (x, y) [rad], also of `Jet`s: d atan2 = (x dy − y dx)/(x² + y²). Values are real."""
    if not isinstance(y, Jet) and not isinstance(x, Jet):
        return np.arctan2(y, x)
    jy, jx = _as_jet(y), _as_jet(x)
    r2 = jx.v**2 + jy.v**2
    cross = jx.v * jy.d - jy.v * jx.d
    d = cross / r2
    dd = (jx.v * jy.dd - jy.v * jx.dd) / r2 - 2.0 * d * (jx.v * jx.d + jy.v * jy.d) / r2
    return Jet(np.arctan2(jy.v, jx.v), d, dd)


def stack_jets(parts: Sequence[Value]) -> Value:
    """Stack arrays or `Jet`s (…) (with time derivatives) along a new last axis; they broadcast."""
    if any(isinstance(p, Jet) for p in parts):
        jets = [_as_jet(p) for p in parts]
        return Jet(
            stack_jets([j.v for j in jets]),
            stack_jets([j.d for j in jets]),
            stack_jets([j.dd for j in jets]),
        )
    shapes = {getattr(p, "shape", ()) for p in parts}  # np.shape would make arrays of numbers
    if shapes == {()}:
        return np.array(parts)
    result = np.empty((*np.broadcast_shapes(*shapes), len(parts)), np.result_type(*parts))
    for k, part in enumerate(parts):
        result[..., k] = part
    return result


def reshape_matrix(rows: Value) -> Value:
    """Matrices (…, 3, 3) from arrays or `Jet`s with time derivatives (…, 9), in row order."""
    if isinstance(rows, Jet):
        return Jet(reshape_matrix(rows.v), reshape_matrix(rows.d), reshape_matrix(rows.dd))
    return rows.reshape(*rows.shape[:-1], 3, 3)


def transposed(x: Value) -> Value:
    """Transpose of arrays or `Jet`s with time derivatives: (…, m, n) → (…, n, m)."""
    if isinstance(x, Jet):
        return Jet(transposed(x.v), transposed(x.d), transposed(x.dd))
    return np.swapaxes(x, -1, -2)


def value(x: Value) -> np.ndarray:
    """Value of a `Jet` without its time derivatives; arrays unchanged."""
    return x.v if isinstance(x, Jet) else np.asarray(x)


def _as_jet(x: Value) -> Jet:
    if isinstance(x, Jet):
        return x
    zero = np.zeros_like(np.asarray(x, dtype=complex if np.iscomplexobj(x) else float))
    return Jet(np.asarray(x), zero, zero)

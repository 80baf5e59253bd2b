"""Forms of drift, creep, hysteresis and nonlinearity that are no formula of the library.

Whoever knows only formulas misses them; whoever knows the kind of an effect whatever its curve
names them. Sizes follow from the gap that a form has to add. Ranges of the draws are estimates.
"""

from collections.abc import Callable

import numpy as np

from wrenchbed.benchmark.referee.case import (
    FaultyRobot,
    RefereeCase,
    TrueCause,
    as_case,
    measured,
    robot_with_minor,
)
from wrenchbed.benchmark.referee.fault import RefereeFault, Rng, named, sign, touched
from wrenchbed.benchmark.referee.forward_dynamics import Ride
from wrenchbed.benchmark.referee.memory import (
    after,
    bouc_wen,
    by_convolution,
    dahl,
    play,
    preisach,
    two_speeds,
)
from wrenchbed.benchmark.referee.scenario import RefereeSetting
from wrenchbed.benchmark.referee.sensor import BEND, CREEP, LOOP, ZERO

Form = Callable[[RefereeSetting, Rng, float], RefereeFault]
FORMS: dict[str, dict[str, Form]] = {}
"""By effect, then by name."""
GAPS = (4.0, 60.0)
"""Gap that a form adds to a case, drawn log-uniformly."""
LEAST = 3.0
"""Gap that it adds at least, once its size is set."""
_SIZINGS = 4
"""Times that a size is set anew: some forms are not linear in it."""
_TRIES = 12
"""Forms that are drawn before giving up."""


def _form(effect: str) -> Callable[[Form], Form]:
    def register(draw: Form) -> Form:
        FORMS.setdefault(effect, {})[draw.__name__] = named(effect, draw)
        return draw

    return register


def make_form(robot: str, mode: str, effect: str, form: str, seed: int) -> RefereeCase:
    """A case with one form as its only cause, beside minor imperfections.

    Raises:
        ParameterError: the robot exists in no simulator.
        ValueError: no draw of the form adds enough.
    """
    place = [list(FORMS).index(effect), list(FORMS[effect]).index(form)]
    rng = np.random.default_rng([seed, *place, 7])
    world, minor = robot_with_minor(robot, mode, (seed, *place), rng)
    for _ in range(_TRIES):
        cause = _sized(world, FORMS[effect][form], rng)
        if cause is not None:
            return as_case("single", world, [cause], minor, rng)
    raise ValueError(f"{effect} as {form}: no draw adds a gap of {LEAST:g}")


def _sized(world: FaultyRobot, form: Form, rng: Rng) -> TrueCause | None:
    """A draw at the size that adds the gap that it should."""
    wanted = float(np.exp(rng.uniform(*np.log(GAPS))))
    seed, size = int(rng.integers(2**62)), 1.0
    cause = None
    for _ in range(_SIZINGS):
        cause = measured(world, form(world.setting, np.random.default_rng(seed), size))
        size *= float(np.sqrt(wanted / max(cause.gap, 1e-9)))
    return cause if cause is not None and cause.gap >= LEAST else None


# ---- drift: what the zero, or the span, does in time -----------------------------------------


def _share(setting: RefereeSetting) -> np.ndarray:
    t = setting.path.t
    return np.asarray(np.clip((t - t[0]) / (t[-1] - t[0]), 0.0, 1.0))


def _drifting(setting: RefereeSetting, rng: Rng, size: float, curve: np.ndarray) -> RefereeFault:
    """A zero that follows a curve (T,), about 0.3 % of full scale high."""
    height = 3e-3 * size * setting.full_scale * touched(rng)
    shift = np.outer(curve / max(float(np.ptp(curve)), 1e-9), height)
    return RefereeFault(gauge=lambda ride, y: y + shift, stage=ZERO)


@_form("sensor.drift")
def warm_up(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Exponential, of one time constant."""
    return _drifting(setting, rng, size, -np.expm1(-_share(setting) / rng.uniform(0.05, 0.5)))


@_form("sensor.drift")
def random_walk(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Steps of 1/f² noise."""
    knots = np.append(0.0, np.cumsum(rng.standard_normal(60)))
    curve = np.interp(_share(setting), np.linspace(0.0, 1.0, len(knots)), knots)
    return _drifting(setting, rng, size, curve)


@_form("sensor.drift")
def daily_wave(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A part of a sine, or up to two periods."""
    phase = 2.0 * np.pi * (rng.uniform(0.4, 2.0) * _share(setting) + rng.uniform())
    return _drifting(setting, rng, size, np.sin(phase))


@_form("sensor.drift")
def square_root(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Diffusion of heat or moisture."""
    return _drifting(setting, rng, size, np.sqrt(_share(setting)))


@_form("sensor.drift")
def two_ramps(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Two ramps with rests between."""
    at = np.sort(rng.uniform(0.05, 0.95, 4))
    height = rng.uniform(0.2, 0.8) * rng.choice([-1.0, 1.0])
    curve = np.interp(_share(setting), at, [0.0, height, height, 1.0])
    return _drifting(setting, rng, size, curve)


@_form("sensor.drift")
def logistic(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """An S, from one level to another."""
    middle, width = rng.uniform(0.3, 0.7), rng.uniform(0.06, 0.15)
    return _drifting(setting, rng, size, 1.0 / (1.0 + np.exp((middle - _share(setting)) / width)))


@_form("sensor.drift")
def thermal_bump(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A shock that passes: it rises and decays."""
    s = np.maximum(_share(setting) - rng.uniform(0.0, 0.4), 0.0)
    return _drifting(setting, rng, size, s * np.exp(-s / rng.uniform(0.08, 0.3)))


@_form("sensor.drift")
def fading_span(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A supply that sags: the span of all channels falls."""
    fall = 0.01 * size * sign(rng) * -np.expm1(-_share(setting) / rng.uniform(0.1, 0.8))
    return RefereeFault(gauge=lambda ride, y: y * (1.0 + fall[:, None]), stage=ZERO)


# ---- creep: what comes late of a change of load ------------------------------------------------

_AT = 100.0
"""Time at which laws without an end have come to 1 [s]."""


def _creeping(
    setting: RefereeSetting, rng: Rng, size: float, law: Callable[[np.ndarray], np.ndarray]
) -> RefereeFault:
    """About 0.8 % of a load that comes late, as a law of the time since it changed says.

    Either the reading is right at first, or as it will be at the end of the run.
    """
    t = setting.path.t
    part = 8e-3 * size * np.abs(touched(rng))
    end = float(law(np.array([t[-1] - t[0]]))[0]) if rng.uniform() < 0.5 else 0.0

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        return y + part * (by_convolution(t, y, law) - end * (y - y[0]))

    return RefereeFault(gauge=gauge, stage=CREEP)


@_form("sensor.creep")
def power_law(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Andrade's: tⁿ."""
    n = rng.uniform(0.15, 0.4)
    return _creeping(setting, rng, size, lambda t: (t / _AT) ** n)


@_form("sensor.creep")
def logarithm(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """log(1 + t/t₀)."""
    first = rng.uniform(0.5, 5.0)
    return _creeping(setting, rng, size, lambda t: np.log1p(t / first) / np.log1p(_AT / first))


@_form("sensor.creep")
def stretched(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Kohlrausch's: 1 − exp(−(t/τ)^β)."""
    tau, beta = np.exp(rng.uniform(*np.log((5.0, 100.0)))), rng.uniform(0.35, 0.7)
    return _creeping(setting, rng, size, lambda t: -np.expm1(-((t / tau) ** beta)))


@_form("sensor.creep")
def two_exponentials(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Two relaxations far apart."""
    fast, slow, part = rng.uniform(2.0, 10.0), rng.uniform(60.0, 200.0), rng.uniform(0.3, 0.7)

    def law(t: np.ndarray) -> np.ndarray:
        return -part * np.expm1(-t / fast) - (1.0 - part) * np.expm1(-t / slow)

    return _creeping(setting, rng, size, law)


@_form("sensor.creep")
def second_order(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """t/(t + t₀), kinetics of second order."""
    half = float(np.exp(rng.uniform(*np.log((5.0, 60.0)))))
    return _creeping(setting, rng, size, lambda t: t / (t + half))


@_form("sensor.creep")
def rise_and_return(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """The glue creeps one way, the spring the other."""
    fast, slow = rng.uniform(3.0, 12.0), rng.uniform(40.0, 150.0)
    return _creeping(setting, rng, size, lambda t: np.exp(-t / slow) - np.exp(-t / fast))


@_form("sensor.creep")
def loading_unloading(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Another time constant where the load's magnitude falls."""
    fast, slow = rng.uniform(3.0, 15.0), rng.uniform(30.0, 120.0)
    part = 8e-3 * size * np.abs(touched(rng))
    up, down = (fast, slow) if rng.uniform() < 0.5 else (slow, fast)
    t = setting.path.t
    return RefereeFault(
        gauge=lambda ride, y: y + part * (two_speeds(t, y, up, down) - y), stage=CREEP
    )


@_form("sensor.creep")
def more_at_large_loads(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A share that grows with the load."""
    tau = float(np.exp(rng.uniform(*np.log((8.0, 80.0)))))
    part = 8e-3 * size * np.abs(touched(rng))
    t, swing = setting.path.t, setting.swing

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        bent = y * np.abs(y / swing) ** 0.7
        return y + part * (after(t, bent, tau) - bent)

    return RefereeFault(gauge=gauge, stage=CREEP)


# ---- hysteresis: what the way to a load leaves -------------------------------------------------


def _looping(
    setting: RefereeSetting, rng: Rng, size: float, loop: Callable[[np.ndarray], np.ndarray]
) -> RefereeFault:
    """A lag of about 0.15 % of full scale, by a loop (T, k) of the load (T, k) over its swing."""
    width = 1.5e-3 * size * setting.full_scale * np.abs(touched(rng))
    used = np.flatnonzero(width)
    swing = setting.swing[used]

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        lag = np.zeros_like(y)
        lag[:, used] = width[used] * loop(y[:, used] / swing)
        return y - lag

    return RefereeFault(gauge=gauge, stage=LOOP)


def _each_dahl(x: np.ndarray, reach: float) -> np.ndarray:
    return np.stack([dahl(c, reach) for c in x.T], axis=1)


@_form("sensor.hysteresis")
def bouc_wen_tapered(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Bouc and Wen's loop, narrower at small loads."""
    reach, shape = rng.uniform(0.06, 0.3), float(rng.uniform(0.55, 0.9))
    return _looping(
        setting, rng, size, lambda x: bouc_wen(x / reach, shape) * (0.3 + 0.7 * np.abs(x))
    )


@_form("sensor.hysteresis")
def duhem(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Coleman and Hodgdon's: a loop about a curve that saturates."""
    reach, steep = rng.uniform(0.1, 0.4), rng.uniform(0.8, 2.0)
    return _looping(setting, rng, size, lambda x: _each_dahl(np.tanh(steep * x) / steep, reach))


@_form("sensor.hysteresis")
def preisach_hump(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Preisach's relays, most of them in the middle of the load and narrow."""
    spread, narrow = rng.uniform(0.25, 0.6), rng.uniform(0.15, 0.5)
    return _looping(setting, rng, size, lambda x: preisach(x, spread, narrow))


@_form("sensor.hysteresis")
def dahl_friction(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Dahl's dry friction."""
    reach = rng.uniform(0.05, 0.3)
    return _looping(setting, rng, size, lambda x: _each_dahl(x, reach))


@_form("sensor.hysteresis")
def minor_loops(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Loops in a part of the range only."""
    middle, half = rng.uniform(-0.4, 0.4), rng.uniform(0.25, 0.5)
    width = half * rng.uniform(0.2, 0.5)

    def loop(x: np.ndarray) -> np.ndarray:
        inside = np.clip(x - middle, -half, half)
        return (inside - play(inside, width)) / width

    return _looping(setting, rng, size, loop)


@_form("sensor.hysteresis")
def soft_backlash(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Backlash with soft edges."""
    width, soft = rng.uniform(0.08, 0.4), rng.uniform(1.5, 4.0)
    return _looping(
        setting, rng, size, lambda x: np.tanh(soft * (x - play(x, width)) / width) / np.tanh(soft)
    )


@_form("sensor.hysteresis")
def one_sided(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Loops under pull, none under push."""
    reach, side = rng.uniform(0.08, 0.3), sign(rng)
    return _looping(
        setting, rng, size, lambda x: _each_dahl(x, reach) * np.clip(0.5 + side * x, 0.0, 1.0)
    )


@_form("sensor.hysteresis")
def turning_points(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A lag that grows with the root of the way since the load turned (Rayleigh's loops)."""
    power, top = rng.uniform(0.4, 0.9), rng.uniform(0.3, 1.0)

    def loop(x: np.ndarray) -> np.ndarray:
        z = x - play(x, top)
        return np.sign(z) * np.abs(z / top) ** power

    return _looping(setting, rng, size, loop)


# ---- nonlinearity: what bends -------------------------------------------------------------------


def _bending(
    setting: RefereeSetting, rng: Rng, size: float, bow: Callable[[np.ndarray], np.ndarray]
) -> RefereeFault:
    """About 0.2 % of full scale, by a bow (T, 6) of the load (T, 6) over its swing.

    Less its best straight line over the stated loads, as nonlinearity is defined: that is a gain.
    """
    bend, swing = 2e-3 * size * setting.full_scale * touched(rng), setting.swing
    usual = setting.nominal / swing
    lines = np.stack([np.polyfit(u, b, 1) for u, b in zip(usual.T, bow(usual).T, strict=True)])

    def gauge(ride: Ride, y: np.ndarray) -> np.ndarray:
        u = y / swing
        return y + bend * (bow(u) - lines[:, 0] * u - lines[:, 1])

    return RefereeFault(gauge=gauge, stage=BEND)


@_form("sensor.nonlinearity")
def dead_zone(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Small loads do not show fully."""
    width = rng.uniform(0.15, 0.5)
    return _bending(setting, rng, size, lambda u: u * np.exp(-((u / width) ** 2)))


@_form("sensor.nonlinearity")
def tanh_saturation(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Large loads show less."""
    steep = rng.uniform(1.0, 3.0)
    return _bending(setting, rng, size, lambda u: np.tanh(steep * u) - np.tanh(steep) * u)


@_form("sensor.nonlinearity")
def exponential(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """It grows towards one end."""
    steep = sign(rng) * rng.uniform(1.0, 4.0)
    return _bending(setting, rng, size, lambda u: np.expm1(steep * u) / np.expm1(abs(steep)))


@_form("sensor.nonlinearity")
def kink_off_zero(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Another slope from a load on that is not zero."""
    at, soft = rng.uniform(-0.5, 0.5), rng.uniform(0.03, 0.15)
    return _bending(setting, rng, size, lambda u: soft * np.logaddexp(0.0, (u - at) / soft))


@_form("sensor.nonlinearity")
def s_shape(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """One and a half waves at most over the range."""
    waves = rng.uniform(0.8, 1.5)
    return _bending(setting, rng, size, lambda u: np.sin(np.pi * waves * u))


@_form("sensor.nonlinearity")
def piecewise(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A table of five points with straight lines between."""
    table = rng.uniform(-1.0, 1.0, 5)
    at = np.linspace(-1.0, 1.0, len(table))
    return _bending(setting, rng, size, lambda u: np.interp(u, at, table))


@_form("sensor.nonlinearity")
def wave(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """A converter's integral nonlinearity: waves of any phase."""
    turns, phase = rng.uniform(2.5, 6.0), rng.uniform(0.0, 2.0 * np.pi)
    return _bending(setting, rng, size, lambda u: np.sin(turns * u + phase))


@_form("sensor.nonlinearity")
def hump(setting: RefereeSetting, rng: Rng, size: float) -> RefereeFault:
    """Wrong near one load only."""
    at, width = rng.uniform(-0.6, 0.6), rng.uniform(0.2, 0.4)
    return _bending(setting, rng, size, lambda u: np.exp(-(((u - at) / width) ** 2)))

"""Order of the checks of a recording: rows, then the load; causes before their effects."""

from dataclasses import replace

import numpy as np

from wrenchbed.calibration.checks import rows
from wrenchbed.calibration.checks.finding import Finding
from wrenchbed.calibration.checks.mistakes import (
    CLEAN,
    TORQUES,
    TORQUES_TURNED,
    TURNED,
    best_turn,
    channel_mistake,
    mistake,
    part,
    thinned,
)
from wrenchbed.calibration.checks.rigid_load import Load, Observed
from wrenchbed.calibration.checks.stretches import changed, touched
from wrenchbed.data.recording import Recording
from wrenchbed.pages.numbers import minus
from wrenchbed.physics.wrench import CHANNELS, UNITS

REFUTED = 0.1
"""Part of the readings' swing (of squares) that no load explains, from which the load is refuted.
The imperfections of a robot leave less: gains, tilts and cables of the library a hundredth."""
SURE = 5.0
"""Least load over its standard uncertainty that counts as present: at 2 chance
makes one in one recording of twenty, at 20 a light tool on a noisy sensor counts as missing."""
LEAST_WEIGHT, LITTLE = 0.01, 0.05
"""Least measured over stated weight at which a load counts as present and not subtracted."""
LEAST_SPREAD = 0.05
"""Least spread of gravity's direction, in sensor axes, along its second principal axis."""
PUSHED = 0.5
"""Least change of forces, over the weight, that is a contact while gravity hardly turns."""
LARGEST_KG, LARGEST_M = 50.0, 2.0
"""Largest plausible load [kg] and lever arm [m]; larger ones are given in another unit."""
BEYOND = 2.5
"""Largest difference of two forces, in weights, that a load explains: a half turn makes two."""
FROZEN, FEW = 1e-3, 8
"""Least residual over swing with a column that may be frozen, and fewest observations that judge
the rest of the recording."""
CLEAR = 6.0
"""Least load on a channel, over the channel's noise, whose absence counts."""
APART = 3.0
"""Least load on a channel over what the residual of the other channels may make of it: 3 σ."""
LONG = 0.5
"""Longest lever [m] by which torques may be in another unit: tools' CoGs are nearer."""
DEAD = 0.1
"""Largest measured over expected variation of a channel that counts as dead."""
CONTRADICTED = 0.25
"""Least residual of a channel in a fit of all channels, over the load that the other channels show
on it, if it contradicts them: turned about one axis, the others show loads of many kinds."""
FOLLOWED = 0.5
"""Least fraction that a fitted load leaves of the forces of one weight turned at random."""
ROUND = 0.05
"""Least spread of forces, over the radius, along any axis, for a sphere through them to be seen."""
SPHERE = 0.1
"""Largest relative scatter of the forces' distances from their middle at which they are one weight
turned about: less finds none with gain errors, more finds one in pushes by hand."""
MIRRORED = 0.1
"""A CoG that comes out at minus the stated one, within this share, is a wrong sign of torques."""
STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²], by definition."""
SAME_UNIT, NEAR_UNIT, EXACT_UNIT = 0.03, 0.05, 0.01
"""Largest relative differences from the ratio of two units: of torques, whose arms are stated to
some mm; for a unit to be possible; and to explain forces, which sensors know to 1 %."""
COUNTS, SUBTRACTED = 20.0, 0.5
"""Least ratio of forces to the stated weight that means counts, and largest that means a payload
subtracted by a controller: nobody states a tool twice as heavy as it is."""
_LARGEST_GAIN = 0.5
"""Largest error of a sensor's gain beside which a unit is not the only answer; estimate."""
_UNITS = {
    "kgf": 1.0 / 9.80665, "lbf": 1.0 / 4.4482216, "mN": 1e3, "kN": 1e-3, "gf": 101.97162,
}  # fmt: skip
"""Readings of 1 N in other units; exact by definition."""


def of_load(recording: Recording, seen: Observed) -> Finding | None:
    """Finding if no rigid load under gravity explains the observations ``seen``; else None."""
    finding = _one_orientation(seen)
    if finding is not None:
        return finding
    some = _as_mounted(thinned(seen))
    load = some.moments.fit()
    finding = _frozen(recording, seen, load)
    if finding is None and load.share > CLEAN:
        finding = _refuted(some, load)
    if finding is not None or load.share > REFUTED:
        return finding
    findings = (check(some, load) for check in (_units, _dead, channel_mistake, _weight))
    return next(filter(None, findings), None)


def _as_mounted(seen: Observed) -> Observed:
    """Rotate the readings to the stated mount's axes if a rotation by more than `TURNED` makes one
    rigid load fit; else return ``seen`` unchanged."""
    turn = best_turn(-seen.seen.origin.T, seen.y[:, :3]) if seen.turns else None
    if turn is None or np.trace(turn) > 1.0 + 2.0 * np.cos(TURNED):
        return seen  # of an imperfect mount, what channels show is clearer in their own axes
    turned = replace(seen, y=seen.y @ np.kron(np.eye(2), turn).T)
    return turned if thinned(turned).moments.fit().share < CLEAN else seen


def _refuted(seen: Observed, load: Load) -> Finding | None:
    """Finding on why no load fits; None if imperfections of the robot may explain the residual."""
    finding = _overcompensated(seen) or mistake(seen) or changed(seen) or touched(seen)
    if finding is not None or load.share < REFUTED:
        return finding
    checks = (_one_channel, _other_robot, _beyond, _weight, _nothing)
    return next(filter(None, (check(seen, load) for check in checks)), None)


def _one_orientation(seen: Observed) -> Finding | None:
    down = -seen.seen.origin
    down = down / np.linalg.norm(seen.gravity)
    spread = np.linalg.eigvalsh(np.cov(down)) if len(seen) > 1 else np.zeros(3)
    if spread[1] >= LEAST_SPREAD**2:
        return None
    turned = np.rad2deg(np.sqrt(max(float(spread[2]), 0.0)))
    force = float(np.linalg.norm(seen.y[:, :3].std(axis=0)))
    weight = seen.mass * float(np.linalg.norm(seen.gravity))
    due = weight * float(np.sqrt(max(float(spread.sum()), 0.0)))
    if force > due + max(PUSHED * weight, SURE * float(seen.noise[:3].max(initial=0.0))):
        radius, off = sphere(seen.y[:, :3])
        if off < SPHERE and abs(np.log(radius / weight)) < np.log(2.0):
            return Finding(
                "frozen joint",
                f"the forces are those of a weight of {radius:.3g} N turned about, while q1… turn "
                f"the tool by {turned:.1f}° rms: the joints are frozen, or of another time",
            )
        return Finding(
            "contact",
            f"{_pushed(seen)[1]} while the tool turns by {turned:.1f}° rms, which makes {due:.2g} "
            "N. Record without touching the tool, and turn it about",
        )
    return Finding(
        "one orientation",
        f"all poses have nearly the same orientation (gravity turns by {turned:.1f}° rms): weight, "
        "bias and every other cause look the same. Turn the tool about",
    )


def _pushed(seen: Observed) -> tuple[float, str]:
    """Largest distance of a force from the median force [N], and the clause that states it as one
    of a contact, with its row and time."""
    away = np.linalg.norm(seen.y[:, :3] - np.median(seen.y[:, :3], axis=0), axis=1)
    far, most = int(away.argmax()), float(away.max())
    where = f"(row {seen.row[far]}, {seen.t[far]:.1f} s)"
    return most, f"contact or a hand: forces change by up to {most:.3g} N {where}"


def _frozen(recording: Recording, seen: Observed, load: Load) -> Finding | None:
    """Finding if a joint column is constant while other joints and readings change; else None."""
    for name, row, count in rows.frozen_joints(recording):
        inside = (seen.row >= row) & (seen.row < row + count)
        if inside.all():  # or it was planned to stand, and a mistake explains the readings
            frozen = load.share > REFUTED and mistake(seen) is None
        else:
            rest = part(seen, ~inside)
            frozen = (
                len(rest) >= FEW
                and load.share > FROZEN
                and thinned(rest).moments.fit().share < load.share / 3.0
            )
        if frozen:
            where = "in every row" if inside.all() else f"for {count} rows from row {row} on"
            what = (
                "all joints stay where they are" if name == rows.ALL else f"column {name!r} stays"
            )
            value = "" if name == rows.ALL else f" at {recording.columns[name][row]:g}"
            return Finding(
                "frozen joint",
                f"{what}{value} {where} while the readings move on as a turning weight makes them: "
                "frozen. Repair the log, or leave these rows out",
            )
    return None


def _beyond(seen: Observed, load: Load) -> Finding | None:
    """Finding if forces differ by more than the stated weight can cause in any pose; else None."""
    weight, (most, change) = seen.mass * float(np.linalg.norm(seen.gravity)), _pushed(seen)
    if not seen.stated or most < BEYOND * weight:
        return None
    return Finding(
        "contact",
        f"{change}, a weight of {weight:.3g} N turned about by no more than twice that, during "
        "much of the recording. Record without touching the tool",
        blocks=False,
    )


def _weight(seen: Observed, load: Load) -> Finding | None:
    mass = float(load.phi[0])
    unit = float(np.sqrt(((seen.seen.origin.T - seen.seen.origin.mean(axis=1)) ** 2).sum()))
    force_std = max(float(load.left[:3].max(initial=0.0)), float(seen.noise[:3].max(initial=0.0)))
    std = force_std / max(unit, 1e-300)
    least = (LITTLE if seen.stated or load.share > REFUTED else LEAST_WEIGHT) * seen.mass
    if abs(mass) >= max(SURE * std, least):
        return None
    words = f"no weight shows: the forces are those of {mass:.2g} ± {std:.1g} kg"
    words += f", stated {seen.mass:.3g} kg. " if seen.stated else ". "
    if float(np.linalg.norm(seen.y[:, :3].mean(axis=0))) < LITTLE * seen.mass * STANDARD_GRAVITY:
        return Finding(
            "compensated",
            words + "All forces are near zero: the controller has subtracted weight and zero "
            "already, or no tool is mounted: mount the tool, record the sensor's own wrench",
        )
    return Finding(
        "no weight",
        words + "Without a load no cause can be distinguished: mount the tool, or check that its "
        "weight was not subtracted (compensated) and that fx fy fz hold forces in N",
    )


def _dead(seen: Observed, load: Load) -> Finding | None:
    """Finding if a channel varies far less than the load that the others show; else None.

    What no load explains of the others (a tilt, a turned mount) moves that load. So a channel is
    judged only where its part of the load is larger: a CoG on the sensor's axis hardly loads tz.
    """
    measured = seen.y.std(axis=0)
    for k, others in enumerate(seen.moments.without_each()):
        if others.share > CLEAN:
            continue
        swing = seen.moments.swing(others.phi)
        due, alike = float(swing[k]), swing[:3] if k < 3 else swing[3:]
        sure = max(CLEAR * float(seen.noise[k]), APART * np.sqrt(others.share) * alike.max())
        contradicted = float(load.left[k]) > CONTRADICTED * due  # else few poses leave it open
        if due > sure and measured[k] < DEAD * due and contradicted:
            return _bad_channel(k, float(measured[k]), due)
    return None


def _one_channel(seen: Observed, load: Load) -> Finding | None:
    """Finding if one load explains all channels but one, dead or wrongly scaled; else None."""
    fits = seen.moments.without_each()
    k = int(np.argmin([f.share for f in fits]))
    if fits[k].share > min(CLEAN, 0.2 * load.share):
        return None
    due = float((seen.design[:, k] @ fits[k].phi).std())
    measured = float(seen.y[:, k].std())
    return None if due / 2.0 < measured < 2.0 * due else _bad_channel(k, measured, due)


def _bad_channel(k: int, measured: float, due: float) -> Finding:
    unit = UNITS[k]
    return Finding(
        "dead channel",
        f"column {CHANNELS[k]!r} does not follow its load: it varies by {measured:.2g} {unit} rms "
        f"where {due:.2g} {unit} is due: a dead channel, a wrong unit or a wrong column. Repair "
        "it, or check the column map",
    )


def _other_robot(seen: Observed, load: Load) -> Finding | None:
    """Finding if forces are a constant weight, but not turned as the joints turn; else None."""
    radius, off = sphere(seen.y[:, :3])
    noise = float(seen.noise[:3].max(initial=0.0))
    if load.share < FOLLOWED or off > SPHERE or radius < CLEAR * noise:
        return None
    name = seen.robot.name
    return Finding(
        "another robot",
        f"the forces are those of one weight of {radius:.3g} N turned about, but not as the "
        f"joints turn {name!r}, which explains {100 * (1 - load.share):.0f} % of them: check "
        "metadata robot, the order and units of q1…, and sensor.pose_flange",
    )


def _nothing(seen: Observed, load: Load) -> Finding:
    force = np.linalg.norm(seen.y[:, :3] - np.median(seen.y[:, :3], axis=0), axis=1)
    return Finding(
        "not one load",
        f"no rigid load under gravity explains the readings: {100 * load.share:.0f} % of their "
        f"swing is left (the largest force is near row {seen.row[int(force.argmax())]}). Look for "
        "contact, a frozen or wrong column, another robot's joints or wrong units",
        blocks=False,
    )


def sphere(force: np.ndarray) -> tuple[float, float]:
    """Radius [N] of the sphere that best fits forces (M, 3), and their relative distance from it,
    infinite for forces in a plane, which lie on spheres of any size."""
    centred = force - force.mean(axis=0)
    squares = (centred**2).sum(axis=1)
    design = np.column_stack([2.0 * centred, np.ones(len(force))])
    centre = np.linalg.lstsq(design, squares, rcond=1e-6)[0]
    far = np.linalg.norm(centred - centre[:3], axis=1)
    radius = float(far.mean())
    least = float(np.sqrt(max(float(np.linalg.eigvalsh(np.cov(centred.T))[0]), 0.0)))
    if np.linalg.norm(centre[:3]) > radius or least < ROUND * radius:
        return radius, np.inf
    return radius, float(far.std()) / max(radius, 1e-300)


def _units(seen: Observed, load: Load) -> Finding | None:
    finding = _unlike_stated(seen, load) if seen.stated else None
    if finding is not None:
        return finding
    mass = float(load.phi[0])
    lever = np.abs(load.phi[1:4]) / max(abs(mass), 1e-300)
    if abs(mass) > LARGEST_KG:
        text = f"the forces are those of {mass:.3g} kg: state fx fy fz in N (are they in mN, "
        return Finding("units", f"{text}or counts?)")
    longer = _longer(seen, load)
    torques = {unit: factor for (force, unit), factor in TORQUES.items() if force == "N"}
    for unit, factor in torques.items():
        if longer is not None and abs(longer / factor - 1.0) < SAME_UNIT:
            text = f"the torques are those of a load {longer:.3g} times as far from the sensor as "
            text += f"is stated: are they in {unit}? State that unit with tx ty tz"
            if abs(longer - 1.0) < _LARGEST_GAIN:
                gain = minus(f"{100 * (longer - 1.0):+.0f}")
                text += f", or per = {longer:.3g} if their gain is off by {gain} %"
            return Finding("units", text)
    if lever.max() > LARGEST_M:
        near = (u for u, factor in torques.items() if 1e-3 < lever.max() / factor < LONG)
        return Finding(
            "units",
            f"the torques are those of a load {lever.max():.3g} m from the sensor: state their "
            f"unit with tx ty tz (are they in {' or '.join(near) or 'counts'}?)",
        )
    if seen.cog is not None and np.linalg.norm(load.phi[1:4] / mass + seen.cog) < MIRRORED * float(
        np.linalg.norm(seen.cog)
    ):
        return Finding("wrong sign", TORQUES_TURNED)
    return None


def _longer(seen: Observed, load: Load) -> float | None:
    """Ratio of fitted to stated distance of the CoG; None if unstated or in another direction."""
    if seen.cog is None or not (square := float(seen.cog @ seen.cog)):
        return None
    lever = load.phi[1:4] / load.phi[0]
    ratio = float(lever @ seen.cog) / square
    aside = float(np.linalg.norm(lever - ratio * seen.cog))
    return ratio if aside < SAME_UNIT * abs(ratio) * np.sqrt(square) else None


def _unlike_stated(seen: Observed, load: Load) -> Finding | None:
    """Finding if the fitted mass shows that forces are in another unit, in counts, or lack a
    payload that the controller subtracts; else None."""
    mass, longer = float(load.phi[0]), _longer(seen, load)
    ratio = mass / seen.mass
    begin = f"the forces are those of {mass:.4g} kg, {ratio:.4g} of the stated {seen.mass:.4g} kg"
    near = {u: abs(ratio / factor - 1.0) for u, factor in _UNITS.items()}
    unit = min(near, key=lambda u: near[u])
    if near[unit] < EXACT_UNIT:
        of_torque = [
            torque for (force, torque), factor in TORQUES.items()
            if longer is not None and force == unit and abs(longer / factor - 1.0) < SAME_UNIT
        ]  # fmt: skip
        torques = f", and {of_torque[0]} with tx ty tz" if of_torque else ""
        return Finding(
            "units", f"{begin}: are they in {unit}? State that unit with fx fy fz{torques}"
        )  # fmt: skip
    if ratio > COUNTS:
        torques = "" if longer is None else f" and per = {longer * ratio:.4g} with tx ty tz"
        return Finding(
            "units",
            f"{begin}: are they counts? State per = {ratio:.4g} with fx fy fz{torques} in the "
            "column map",
        )
    if ratio > SUBTRACTED:
        return None
    return _without_payload(
        seen, load, f" (lbf would be {_UNITS[unit]:.4g} of it)" if near[unit] < NEAR_UNIT else ""
    )


def _without_payload(seen: Observed, load: Load, doubt: str = "") -> Finding:
    """Finding that a controller subtracts a payload from forces; ``doubt`` ends its sentence."""
    mass = float(load.phi[0])
    less = seen.mass - mass
    state = ", or state the tool without it" if mass > 0.0 else " and record again"
    where = ""
    if seen.cog is not None:
        centre = 1e3 * (seen.mass * seen.cog - load.phi[1:4]) / less
        where = f" at ({', '.join(f'{x:.0f}' for x in centre)}) mm"
    return Finding(
        "compensated",
        f"the forces are those of {mass:.4g} kg, the stated tool has {seen.mass:.4g} kg: does the "
        f"controller subtract a payload of {less:.3g} kg{where}? Set its payload to "
        f"zero{state}{doubt}",
    )


def _overcompensated(seen: Observed) -> Finding | None:
    """Finding if forces are minus the stated weight: a controller subtracts too much; else None."""
    load = seen.moments.mended(-np.eye(6)[None])[0]
    if not seen.stated or load.share > CLEAN:
        return None
    mass = float(load.phi[0])
    units = (1.0, *_UNITS.values())
    if any(abs(mass / (factor * seen.mass) - 1.0) < NEAR_UNIT for factor in units):
        return None
    doubt = f" (with the opposite sign the wrench is that of a tool of {mass:.4g} kg)"
    return _without_payload(seen, replace(load, phi=-load.phi), doubt)

"""Blind spots of joint efforts: what a motion could not have shown, and from which size it would.

The sizes are those of `next.blind`: what evidence finds and what adds a gap is reported.
"""

from collections.abc import Iterator

import numpy as np

from wrenchbed.diagnosis.efforts.answer import place
from wrenchbed.diagnosis.efforts.arm_columns import mean_inertia
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.evidence import AMPLITUDE, Evidence
from wrenchbed.diagnosis.efforts.names import known
from wrenchbed.diagnosis.efforts.simulator import added
from wrenchbed.diagnosis.efforts.sizes import scale, sized, unit_of
from wrenchbed.diagnosis.next.blind import NOT_HERE, NOTHING, BlindSpot, reported_from

ABSURD = 30.0
"""Plausible sizes from which a cause has no effect: a link of 30 times its mass is none."""
FITTED = "fitted, since nobody states it"


def blind_spots(d: Dictionary, evidence: Evidence) -> tuple[BlindSpot, ...]:
    """Effects, by joint or link, that these efforts show at no plausible size.

    Args:
        d: columns.
        evidence: of all rows.
    """
    spots = []
    for effect, number in _every(d):
        blocks = [k for k, b in enumerate(d.blocks) if b.key == (effect, number)]
        element = "" if number is None else place((effect, number))[1]
        most, why = _plausible(d, effect, number), NOTHING if blocks else _why(effect)
        shown = min((shows_from(d, evidence, k) for k in blocks), default=np.inf)
        if shown > ABSURD * most:
            spots.append(BlindSpot(effect, element, None, "", why))
        elif shown > most:
            spots.append(BlindSpot(effect, element, shown, unit_of(d, blocks[0])))
    return tuple(spots)


def shows_from(d: Dictionary, evidence: Evidence, block: int) -> float:
    """Size from which 95 % of such recordings report it; of several columns, all of them alike."""
    some, effect = np.array(sized(d, block)), d.blocks[block].effect
    if not d.size[some].any():  # no reversal, or nothing that warms
        return np.inf
    unit = 1.0 / max(float(np.sqrt(np.mean(d.size[some] ** 2))), 1e-12)  # a noise of a row
    one = np.where(np.isin(np.arange(len(d.names)), some), unit, 0.0)
    information = unit**2 * evidence.known[0][np.ix_(some, some)]
    odds = np.array([evidence.prior((block,)) - evidence.prior(())])
    gap = np.array([max(added(d, one, block), 1e-300)])
    times = float(reported_from(information[None], np.array([[AMPLITUDE]]), odds, gap)[0])
    length = len(some) ** 0.5 if known()[effect].size.vector else 1.0
    return abs(scale(d, block, np.zeros(len(one)))) * unit * times * length


def _every(d: Dictionary) -> Iterator[tuple[str, int | None]]:
    """Effects with each joint, or link that weighs something."""
    for effect, about in known().items():
        if d.scene.commanded and effect == "drive.bandwidth":  # a delay stands for it
            continue
        if "{joint}" not in about.title:
            yield effect, None
        elif effect in ("link.mass", "link.cog", "link.inertia"):
            heavy = np.flatnonzero(d.scene.inertias.phi[:, 0] > 0.0)
            yield from ((effect, int(k) + 1) for k in heavy)
        else:
            for j, joint in enumerate(d.scene.robot.joints, start=1):
                if effect != "link.spring" or joint.unit == "rad":  # on a slide there is none
                    yield effect, j


def _why(effect: str) -> str:
    """Why a dictionary has no column of an effect."""
    if effect == "drive.temperature":
        return NOT_HERE
    return NOTHING if effect.startswith("link.") else FITTED


def _plausible(d: Dictionary, effect: str, number: int | None) -> float:
    """Largest size of an effect that a fault in use has."""
    size, scene = known()[effect].size, d.scene
    level = 1.0
    if size.of == "friction" and number is not None:
        level = abs(float(scene.levels[0, number - 1]))
    elif size.of == "mass" and number is None:
        level = float(scene.model.robot.tool(scene.theta).mass)
    elif size.of in ("mass", "inertia") and number is not None:
        phi = scene.inertias.phi[number - 1]
        level = float(phi[0]) if size.of == "mass" else mean_inertia(phi)
    return size.plausible * level

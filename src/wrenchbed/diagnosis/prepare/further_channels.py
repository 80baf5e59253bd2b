"""What a recording holds beside its wrench: further channels join the observations at rest.

The unit of such a channel, a gap of 1, is the noise of one observation: of the scatter of its rows,
of what it keeps back of nuisance and effects, and of its sensor's floor the largest.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from wrenchbed import registry
from wrenchbed.calibration.observations import Observations
from wrenchbed.channels.base import PLACING, Channel, flat
from wrenchbed.channels.own_noise import own_noise
from wrenchbed.channels.response import Response, readings
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import effects
from wrenchbed.effects.scene import Scene


def with_further_channels(prepared: Prepared, data: Observations) -> Prepared:
    """The prepared recording with every other channel that it holds."""
    taken = {c.name for c in prepared.channels}
    for name in registry.names("channels"):
        channel: Channel = registry.load("channels", name)
        if name not in taken and channel.applies(prepared.recording):
            prepared = _with(prepared, channel, data)
    return prepared


def _with(prepared: Prepared, channel: Channel, data: Observations) -> Prepared:
    scene, recording = prepared.scene, prepared.recording
    y = channel.measured(recording, data)
    fitted = channel.fitted(y, scene)
    if fitted is None:
        text = f"the poses are too alike to compare the {channel.name}: its mounting is unknown"
        return replace(prepared, further_notes=(*prepared.further_notes, text))
    expected = readings((fitted,), scene)
    residual = (y - expected[scene.held]).ravel()
    nuisance = flat(fitted.nuisance(scene)[scene.held])
    unexplained = own_noise(residual, nuisance, _of_effects(fitted, scene, expected))
    scatter = _scatter(fitted, prepared, data, y)
    unit = np.maximum(np.maximum(scatter, unexplained), fitted.floor)
    worst, of_unit = float(unit.max()), next(iter(fitted.columns.values()))
    note = f"the {fitted.name} is compared too, with a noise of {worst:.2g} {of_unit} a pose"
    row = None if prepared.row is None else block_diag(prepared.row, np.diag(unit**2))
    return replace(
        prepared,
        channels=(*prepared.channels, fitted),
        y=np.concatenate([prepared.y, y], axis=1),
        covariance=block_diag(prepared.covariance, np.diag(unit**2)),
        noise=np.concatenate([prepared.noise, np.ones(len(unit))]),
        row=row,
        further_notes=(*prepared.further_notes, note),
    )


def _of_effects(channel: Channel, scene: Scene, expected: np.ndarray) -> np.ndarray:
    """Readings (H k, m) of every effect that the channel may see, at its typical size, and of the
    sensor's own imperfections."""
    response = Response(scene, (channel,), expected)
    columns = [flat(channel.imperfections(scene)[scene.held])]
    for effect in effects().values():
        if not effect.acts(scene) or PLACING.isdisjoint(effect.stages):
            continue
        known = {p.name: p for p in effect.parameters(scene.robot)}
        for variant in effect.variants(scene):
            parameters = [known[n] for n in variant.free]
            for _, change in response.changes(effect, parameters, variant.at):
                columns.append(change[scene.held].reshape(-1, 1))
    return np.concatenate(columns, axis=1)


def _scatter(channel: Channel, prepared: Prepared, data: Observations, y: np.ndarray) -> np.ndarray:
    """Standard deviation (k,) of an observation by the scatter of its rows; 0 without repeats."""
    free = len(channel.rows(prepared.recording, data)) - len(y)
    if free <= 0:
        return np.zeros(y.shape[1])
    away = channel.rows(prepared.recording, data) - np.repeat(y, data.count, axis=0)
    return np.sqrt((away**2).sum(axis=0) / free / float(np.mean(data.count)))

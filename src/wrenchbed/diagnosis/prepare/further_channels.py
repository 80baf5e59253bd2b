"""Channels beside the wrench, or instead of it, join the observations at rest.

The unit of such a channel, a gap of 1, is the noise of one observation: the largest of its rows'
scatter, of the residual that no effect explains, and of its sensor's floor; where joints are stuck
in friction, ordinary errors of sensors and links are added. If it is the only channel and has
repeated rows, the unexplained residual is no noise, it remains a gap of unknown cause, and the
sensor's own imperfections are added.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from wrenchbed import registry
from wrenchbed.calibration.observations import Observations
from wrenchbed.channels.base import PLACING, Channel, flat
from wrenchbed.channels.hierarchical_fit import posterior
from wrenchbed.channels.own_noise import own_noise
from wrenchbed.channels.readings_with_effects import Response, readings
from wrenchbed.diagnosis.prepare.prepared import Prepared
from wrenchbed.effects.chain import effects
from wrenchbed.effects.scene import Scene
from wrenchbed.errors import DiagnosisError
from wrenchbed.pages.numbers import rough

_LARGEST = 2.0
"""Largest imperfections of a lone sensor, over their usual size: the worst data sheets of MEMS
accelerometers give 0.5 % of nonlinearity."""


def with_further_channels(prepared: Prepared, data: Observations) -> Prepared:
    """Copy with every other channel that the recording holds; a `DiagnosisError` if no channel can
    be compared."""
    taken = {c.name for c in prepared.channels}
    for name in registry.names("channels"):
        channel: Channel = registry.load("channels", name)
        if name not in taken and channel.applies(prepared.recording):
            prepared = _with(prepared, channel.of(prepared.recording), data)
    if not prepared.channels:
        name, why = prepared.recording.name, "; ".join(prepared.remarks)
        raise DiagnosisError(f"{name}: {why or 'holds nothing that can be diagnosed at rest'}")
    return prepared


def _with(prepared: Prepared, channel: Channel, data: Observations) -> Prepared:
    recording = prepared.recording
    scene = replace(prepared.scene, located=True) if channel.located else prepared.scene
    y = channel.measured(recording, data)
    fitted = channel.fitted(y, scene)
    if fitted is None:
        unit = next(iter(channel.columns.values()))
        text = (
            f"the {channel.name} is not compared: {' '.join(channel.columns)} hold something else "
            f"than {channel.title}, or in another unit than {unit}, or the poses are too alike to "
            "know its mounting"
        )
        return replace(prepared, remarks=(*prepared.remarks, text))
    expected = readings((fitted,), scene)
    residual = (y - expected[scene.held]).ravel()
    noise, source = np.maximum(_scatter(fitted, prepared, data, y), fitted.floor), "repeats"
    ordinary = np.zeros(y.shape[1])
    if fitted.by_pose:
        fitted, unexplained, ordinary = _by_pose(fitted, scene, residual, expected)
        noise, source = np.maximum(noise, unexplained), "residual"
    elif prepared.channels or len(y) == data.count.sum():

        def averaged(x: np.ndarray) -> np.ndarray:  # a motion is judged by averages of its rows
            rows = prepared.averages(x.reshape(len(y), x.size // len(y)))
            return rows.reshape(len(rows) * len(x) // len(y), *x.shape[1:])

        nuisance, *every = (
            averaged(flat(x[scene.held]))
            for x in (fitted.nuisance(scene), fitted.imperfections(scene))
        )
        every += [averaged(columns) for columns in _of_effects(fitted, scene)]
        own = own_noise(averaged(residual), nuisance, np.column_stack(every))
        own *= np.sqrt(prepared.stride)
        noise, source = np.maximum(noise, own), "residual"
    else:
        ordinary = _imperfect(fitted, scene, residual)
    unit = np.hypot(noise, ordinary)
    worst = rough(fitted.name, float(noise.max()), next(iter(fitted.columns.values())))
    too, what = " too" if prepared.channels else "", "row" if scene.moving else "pose"
    note = f"the {fitted.name} is compared{too}, with a noise of {worst} a {what}"
    row = None if prepared.row is None else block_diag(prepared.row, np.diag(unit**2))
    return replace(
        prepared,
        scene=scene,
        channels=(*prepared.channels, fitted),
        y=np.concatenate([prepared.y, y], axis=1),
        covariance=block_diag(prepared.covariance, np.diag(unit**2)),
        noise=np.concatenate([prepared.noise, (noise / unit) ** 2]),
        row=row,
        source=prepared.source or source,
        scatter=prepared.scatter if prepared.channels else np.zeros((len(y), *2 * y.shape[1:])),
        remarks=(*prepared.remarks, note),
    )


def _by_pose(
    channel: Channel, scene: Scene, residual: np.ndarray, expected: np.ndarray
) -> tuple[Channel, np.ndarray, np.ndarray]:
    """Channel with imperfections at fitted sizes (at most the usual ones), std (k,) of what nothing
    explains of the residual (H k,), of H observations of k columns, and rms (k,) of its
    imperfections."""
    width, held = expected.shape[1], scene.held
    sensors, others = ([flat(kind[held]) for kind in kinds] for kinds in channel.kinds(scene))
    free = np.column_stack([flat(channel.nuisance(scene)[held]), *sensors])
    rows, nothing = len(residual) // width, np.zeros((len(residual), 0))
    every = [*others, *_of_effects(channel, scene)]
    fit = posterior(residual, free, every, nothing, np.tile(np.arange(width), rows))
    size = np.minimum(fit.sizes[: len(others)], 1.0)
    sized = channel.with_sizes(size)
    usual = (sized.imperfections(scene)[held] ** 2).sum(axis=2).mean(axis=0)
    return sized, fit.noise, np.sqrt(usual)


def _imperfect(channel: Channel, scene: Scene, residual: np.ndarray) -> np.ndarray:
    """Rms (k,) of a healthy sensor's imperfections in each of k columns, at the size, at most
    `_LARGEST`, that the residual (H k,) of H observations shows beside effects."""
    usual = channel.imperfections(scene)[scene.held]
    if not usual.shape[2]:
        return np.zeros(usual.shape[1])
    free, rows = flat(channel.nuisance(scene)[scene.held]), len(usual)
    every = [flat(usual), *_of_effects(channel, scene)]
    group = np.tile(np.arange(usual.shape[1]), rows)
    fit = posterior(residual, free, every, np.zeros((len(residual), 0)), group)
    return np.asarray(min(fit.sizes[0], _LARGEST) * np.sqrt((usual**2).sum(axis=2).mean(axis=0)))


def _of_effects(channel: Channel, scene: Scene) -> Iterator[np.ndarray]:
    """Yield the readings (H k, m) of each effect that acts on the channel, at typical size."""
    response = Response(scene, (channel,))
    for effect in effects().values():
        if not effect.acts(scene) or PLACING.isdisjoint(effect.stages):
            continue
        known, columns = {p.name: p for p in effect.parameters(scene.robot)}, list[np.ndarray]()
        for variant in effect.variants(scene):
            parameters = [known[n] for n in variant.free]
            for _, change in response.changes(effect, parameters, variant.at):
                columns.append(change[scene.held].ravel())
        if columns:
            yield np.stack(columns, axis=1)


def _scatter(channel: Channel, prepared: Prepared, data: Observations, y: np.ndarray) -> np.ndarray:
    """Std (k,) of observations y (H, k) by the scatter of their rows; 0 if none has several."""
    free = len(channel.rows(prepared.recording, data)) - len(y)
    if free <= 0:
        return np.zeros(y.shape[1])
    away = channel.rows(prepared.recording, data) - np.repeat(y, data.count, axis=0)
    return np.sqrt((away**2).sum(axis=0) / free / float(np.mean(data.count)))

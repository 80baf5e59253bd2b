"""Readings of a twin for a whole recording, or pose by pose while a recording run goes on."""

from dataclasses import replace

import numpy as np

from wrenchbed import registry
from wrenchbed.calibration.observations import smoothed, window_of
from wrenchbed.data.holds import MOVING
from wrenchbed.data.recording import Recording
from wrenchbed.effects.scene import WAY
from wrenchbed.errors import RecordingError
from wrenchbed.physics.noise import NoiseStream, noise_model
from wrenchbed.physics.taylor_jets import Jet
from wrenchbed.physics.wrench import CHANNELS
from wrenchbed.twin.twin import Twin

_BACK = 40
"""Rows before a rest that are simulated again for effects with memory, such as friction."""
_TAKEN = ("t", "segment", "temperature")


def simulate(twin: Twin, recording: Recording, *, noise: str = "off", seed: int = 0) -> Recording:
    """Return a recording with the same motion and the readings of a twin.

    Args:
        noise: ``real``, ``white`` or ``off``, of the robot's sensor.
        seed: of the noise and of the effects' random parts.

    Raises:
        RecordingError: the recording is of another robot, or a motion without an even clock.
        ParameterError: no such noise.
    """
    robot = twin.model.robot
    stream = NoiseStream(noise_model(noise, registry.load("sensors", robot.sensor).noise), seed)
    rows, status = stream.corrupt(recording.t, readings(twin, recording))
    rows = twin.corrupt(rows, recording.t, seed)
    kept = {c: v for c, v in recording.columns.items() if c in _TAKEN or c[0] == "q"}
    columns = kept | dict(zip(CHANNELS, rows.T, strict=True)) | {"status": status}
    return Recording(replace(recording.metadata, source="sim"), columns, "simulation")


def readings(twin: Twin, recording: Recording) -> np.ndarray:
    """Readings (N, 6) [N, N·m] of a twin on a recording's motion, without noise; a `RecordingError`
    if the recording is of another robot, or a motion without an even clock."""
    robot = twin.model.robot
    if recording.metadata.robot != robot.name and recording.joints:
        raise RecordingError(
            f"{recording.name}: is of robot {recording.metadata.robot!r}, "
            f"the twin is a {robot.name!r}"
        )
    robot.check(recording.q, twin.robot_theta, recording.name) if robot.joints else None
    moving = recording.metadata.mode == "dynamic"
    return _in_motion(twin, recording) if moving else _at_rest(twin, recording)


def holds(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Poses (H, J) at which a recording rests, and the index of the pose of each row (N,)."""
    q = recording.q.astype(float)
    new = np.r_[True, np.abs(np.diff(q, axis=0)).max(axis=1) > MOVING]
    first = np.flatnonzero(new)
    poses = np.add.reduceat(q, first) / np.diff(np.append(first, len(q)))[:, None]
    return poses if recording.joints else q[first], np.cumsum(new) - 1


def _warmth(recording: Recording) -> np.ndarray | None:
    temperature = recording.columns.get("temperature")
    return None if temperature is None else temperature.astype(float) - float(temperature[0])


def _in_motion(twin: Twin, recording: Recording) -> np.ndarray:
    t = recording.t.astype(float)
    step = np.diff(t)
    h = float(step.mean()) if len(step) else 1.0
    window = window_of(recording)
    if not recording.joints or len(t) <= window or np.abs(step - h).max() > 0.02 * h:
        raise RecordingError(
            f"{recording.name}: motion needs joints and more than {window} rows on an even clock"
        )
    jets = [smoothed(recording.q.astype(float), window, k, h) for k in range(3)]
    return twin.wrench(twin.scene(Jet(*jets), t, warmth=_warmth(recording)))


def _at_rest(twin: Twin, recording: Recording) -> np.ndarray:
    """Readings (N, 6) of poses at rest; each pose is computed once. Moves between poses are
    simulated too where an effect might have memory."""
    t, warmth = recording.t.astype(float), _warmth(recording)
    poses, hold = holds(recording)
    ways = WAY if twin.model.robot.joints and twin.active else 0
    slot = np.arange(len(t)) + ways * hold  # of each row among rows and ways
    total = len(t) + ways * (len(poses) - 1)
    held = np.zeros(total, dtype=bool)
    held[slot] = True
    knots = np.arange(total)
    pose = np.interp(knots, slot, hold.astype(float))  # 2.25: a quarter of the way to pose 3
    at = np.unique(pose, return_inverse=True)
    below = np.floor(at[0]).astype(int)
    share = (at[0] - below)[:, None]
    above = np.minimum(below + 1, len(poses) - 1)
    spots = poses[below] + share * (poses[above] - poses[below])
    times = np.interp(knots, slot, t)
    warm = None if warmth is None else np.interp(knots, slot, warmth)
    load = twin.load(twin.scene(spots, np.arange(len(spots)) * 1.0))[at[1]]
    scene = twin.scene(spots[at[1]], times, held, warm)
    return twin.reading(scene, load)[slot]


class Playback:
    """Computes a twin's readings pose by pose as a run goes on; earlier poses are remembered."""

    def __init__(self, twin: Twin, seed: int) -> None:
        self.twin, self.seed = twin, seed
        joints = len(twin.model.robot.joints)
        self._q, self._t, self._load = np.empty((0, joints)), np.empty(0), np.empty((0, 6))
        self._ahead, self._ahead_load = np.empty((0, joints)), np.empty((0, 6))
        self._rows, self._times = np.empty((0, 6)), np.empty(0)
        self._plain = Twin(twin.model, twin.theta)

    def expect(self, q: np.ndarray) -> None:
        """Announce all poses (N, J) of a run: hysteresis depends on the range of their loads."""
        self._ahead = q
        self._ahead_load = self.twin.load(self.twin.scene(q, np.arange(len(q)) * 1.0))

    def move(self, t: tuple[float, float], start: np.ndarray, end: np.ndarray) -> None:
        """Remember a move from one pose (J,) to another, between times (from, to) [s]."""
        share = np.arange(0 if not len(self._q) else 1, WAY + 1) / (WAY + 1)
        q = start + share[:, None] * (end - start)
        self._extend(q, t[0] + share * (t[1] - t[0]))

    def rest(self, t: np.ndarray, q: np.ndarray, push: np.ndarray) -> np.ndarray:
        """Readings (n, 6) at times t (n,) [s] at rest at q (J,); ``push`` (6,): further load."""
        self._extend(q[None], t[:1])
        self._load[-1] += push
        last = len(self._q) - 1
        n, ahead = len(t), len(self._ahead)
        rows = np.r_[np.arange(last), np.full(n, last)]
        later = t[-1] + 1.0 + np.arange(ahead)
        scene = self.twin.scene(
            np.concatenate([self._q[rows], self._ahead]), np.concatenate([self._t[:last], t, later])
        )
        load = np.concatenate([self._load[rows], self._ahead_load])
        if n > 1:  # the hold's end: what creeps has crept
            self._q, self._t = self._q[[*range(last + 1), last]], np.append(self._t, t[-1])
            self._load = self._load[[*range(last + 1), last]]
        return self.twin.reading(scene, load)[last : last + n]

    def leave(self, t: float) -> None:
        """Set the time [s] at which the last rest ended, after its last reading."""
        if len(self._t) > 1:
            self._t[-1] = max(t, float(np.nextafter(self._t[-2], np.inf)))

    def forget(self, rows: int) -> None:
        """Drop all but the last ``rows`` of the remembered rows (poses and moves)."""
        if len(self._q) > rows:
            self._q, self._t, self._load = self._q[-rows:], self._t[-rows:], self._load[-rows:]

    def motion(self, t: np.ndarray, q: np.ndarray, qd: np.ndarray, load: np.ndarray) -> np.ndarray:
        """Readings (N, 6) of a motion at times (N,), q and speeds qd (N, J); ``load`` (N, 6) is
        that on the sensor without effects."""
        h = float(np.mean(np.diff(t)))
        jets = Jet(q, qd, np.gradient(qd, h, axis=0))
        scene = self.twin.scene(jets, t)
        return self.twin.reading(scene, load + self.twin.load(scene) - self._plain.load(scene))

    def corrupt(self, t: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Add the effects' random parts to rows (n, 6) at t (n,) [s], continuing earlier calls."""
        self._rows, self._times = np.concatenate([self._rows, rows]), np.append(self._times, t)
        return self.twin.corrupt(self._rows, self._times, self.seed)[-len(rows) :]

    def _extend(self, q: np.ndarray, t: np.ndarray) -> None:
        """Append poses (n, J) at times (n,) [s] to the remembered ones."""
        before = len(self._q)
        self._q, self._t = np.concatenate([self._q, q]), np.append(self._t, t)
        first = max(0, before - _BACK)
        load = self.twin.load(self.twin.scene(self._q, self._t), first)
        self._load = np.concatenate([self._load, load[before - first :]])

"""Diagnose joint torques or motor currents: which joint, which effect, how far the gap shrinks."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wrenchbed.data.recording import Recording
from wrenchbed.diagnosis.decision.decide import conclude, decide, widened
from wrenchbed.diagnosis.efforts import json_entries
from wrenchbed.diagnosis.efforts.dictionary import Dictionary
from wrenchbed.diagnosis.efforts.fitted_causes import (
    Simulator,
    Simulators,
    as_good,
    blocks,
    displacement,
    facts_of,
    outside,
    weighed,
)
from wrenchbed.diagnosis.efforts.residual_anomalies import signs
from wrenchbed.diagnosis.efforts.scene import effort_scene
from wrenchbed.diagnosis.efforts.search import Evidence, Structure, search
from wrenchbed.diagnosis.efforts.stated_drives import as_efforts, stated_drives, with_tool
from wrenchbed.diagnosis.explain.reliability import UNLEARNT, set90
from wrenchbed.diagnosis.explain.verdict import Verdict
from wrenchbed.diagnosis.json_entries import cannot_tell
from wrenchbed.diagnosis.prepare.prepared import Material
from wrenchbed.diagnosis.prepare.scenes import notes, stretch
from wrenchbed.diagnosis.result import Diagnosis, plain
from wrenchbed.drives.identify import arm_of
from wrenchbed.errors import DiagnosisError
from wrenchbed.files import write_json
from wrenchbed.jobs.workers import one_thread
from wrenchbed.robots.chain import SerialChain
from wrenchbed.twin.twin import Twin

Progress = Callable[[str], None]
_PASSES, _DAMPING, _DISPLACED_M, _REACH_M = 4, 0.6, 0.01, 0.5
"""Times at most that the columns of the tool's centre of gravity are made again, share of a step
that is taken (whole steps overshoot by 0.6 of themselves: tuned on
``tests/diagnosis/efforts/test_loads.py``), step [m] below which they are good enough, and distance
[m] beyond which a moment is not that of the tool: three times the largest of the sealed cases.
"""
STEPS = 4
"""Number of steps of a diagnosis of efforts reported by ``progress`` (bar of cli/diagnose.py)."""


@dataclass(frozen=True, eq=False)
class EffortFindings:
    """A diagnosis of joint efforts with the fits behind it.

    Attributes:
        diagnosis: the answers, as written to ``diagnosis.json``.
        d: change of the efforts per unit of each parameter, and their noise.
        verdict: decision; a cause is an effect with the number of its joint.
        simulators: cache of fitted simulators, by the causes that each has.
        outside: cause, no effect of the library, that the gap resembles most, in words, or empty.
        seed: random seed of the bootstrap over blocks of rows.
    """

    diagnosis: Diagnosis
    d: Dictionary
    verdict: Verdict[Structure]
    simulators: Simulators
    outside: str = ""
    seed: int = 0

    @property
    def fit(self) -> Simulator:
        """Simulator with the claimed causes."""
        return self.simulators.of(blocks(self.verdict.causes))

    def write(self, folder: str | Path) -> None:
        """Write ``diagnosis.json``, ``twin.json`` and ``drives.json``."""
        self.diagnosis.write(folder)
        values = json_entries.corrected(self.d, self.fit.x, self.diagnosis.which)
        write_json(Path(folder) / "drives.json", plain(values))


@one_thread
def diagnose_efforts(
    recording: Recording,
    *,
    drives: str | Path | None = None,
    seed: int = 0,
    wrench: bool = False,
    material: Material | None = None,
    progress: Progress = lambda _: None,
) -> EffortFindings:
    """Diagnose an arm's motion from joint torques, motor currents or commands.

    Args:
        recording: an arm's motion with ``tau1…`` or ``i1…``, or with commands ``q_target1…`` alone.
        drives: output of ``wrenchbed calibrate`` on a healthy recording of this robot, if any.
        seed: random seed of the bootstrap over held-out blocks.
        wrench: whether to use the recording's wrench as evidence too.
        material: residual of a torque and of a force that counts as a gap of 1; None: row noise.
        progress: called with the step that begins.

    Raises:
        RecordingError, CalibrationError, NotFoundError, DiagnosisError: these data allow no answer.
    """
    begun = time.perf_counter()
    progress("motion and stated robot")
    if not isinstance(arm_of(recording), SerialChain):
        raise DiagnosisError(
            f"{recording.name}: robot {recording.metadata.robot!r} has closed loops: of drive "
            "faults recorded over CAN diagnoses of its joint efforts find too few yet, so none is "
            "given; calibrate --channels effort fits them"
        )
    known = stated_drives(recording, drives)
    recording = with_tool(recording, known)
    given = recording
    if recording.only_commanded:
        recording, known = as_efforts(recording, known)
    recording = stretch(recording)
    scene = effort_scene(recording, known, wrench=wrench)
    progress("effects and noise")
    d = as_stated = Dictionary(scene, material)
    for _ in range(_PASSES):
        fitted = displacement(d)
        further = fitted - d.scene.displaced
        if np.abs(further).max() < _DISPLACED_M:
            break
        if np.abs(fitted).max() > _REACH_M:
            d = as_stated
            break
        d = Dictionary(replace(scene, displaced=d.scene.displaced + _DAMPING * further), material)
    progress("structures and their evidence")
    evidence, simulators = Evidence(d), Simulators(d)
    likely = weighed(search(evidence), simulators)
    progress("held-out rows")
    unnamed = outside(simulators, likely[0])
    seen = () if scene.commanded else signs(d)  # counts of encoders are no ordinary noise
    decision = decide(facts_of(simulators, likely, seed))
    alike = as_good(simulators, decision.verdict, seed)
    decision = replace(decision, verdict=widened(decision.verdict, alike))
    joints = [c.part.joint for c in decision.verdict.causes]
    elsewhere = [text for j, text in seen if j + 1 not in joints]
    final = conclude(decision, [{} for _ in joints], elsewhere)
    gap, fit = decision.gap, simulators.of(blocks(final.causes))
    theta = np.asarray(scene.model.configured(scene.recording.metadata))
    twin = Twin(scene.model, theta, (), recording.name)
    which = json_entries.which(simulators, final, gap)
    diagnosis = Diagnosis(
        recording.name, recording.metadata.robot, final.word, gap,
        json_entries.where(d, final, gap, seen), which, dict(final.probabilities),
        cannot_tell(which, final.alike), json_entries.next_steps(final, seen), twin,
        time.perf_counter() - begun,
        (*notes(given, recording, recording), *json_entries.notes(fit, final, gap, seen, unnamed)),
        set90=set90(final, UNLEARNT),
        minor=json_entries.minor(simulators, likely, final),
        fitted=json_entries.fitted(fit),
        scale=json_entries.scales(d), blind=json_entries.blind_spots(evidence),
        familiar="the probabilities were chosen on simulated arms of six and seven joints",
    )  # fmt: skip
    return EffortFindings(diagnosis, d, final, simulators, unnamed, seed)

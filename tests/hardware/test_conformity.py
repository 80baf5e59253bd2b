"""The checks of a CANopen drive: none fails on the emulator's, and wrong drives are found."""

import pytest

from can_drives import DEFECTS, FURTHER, NODE, SimulatedBus
from wrenchbed.errors import LinkError
from wrenchbed.hardware.conformity.bench import BenchSettings
from wrenchbed.hardware.conformity.checks import Level, Verdict
from wrenchbed.hardware.conformity.suite import check_drive

SETTINGS = BenchSettings(NODE, distance=20_000, speed=80_000)


def test_nothing_is_found_on_the_emulators_drive():
    found = check_drive(SimulatedBus(), SETTINGS, Level.MOVE)
    assert [(f.check.name, f.why) for f in found.failed] == []


@pytest.mark.parametrize("defect", DEFECTS | FURTHER)
def test_a_wrong_drive_is_found(defect):
    found = check_drive(SimulatedBus((DEFECTS | FURTHER)[defect]), SETTINGS, Level.MOVE)
    assert found.failed


class Watched(SimulatedBus):
    """Remembers what was sent to the drive."""

    def __init__(self):
        self.requests = []
        super().__init__()

    def send(self, can_id, data, remote=False):
        self.requests.append((can_id, bytes(data)))
        super().send(can_id, data, remote)


def test_reading_writes_nothing():
    bus = Watched()
    before = {key: bus.drive.objects.entry(key).value for key in bus.drive.objects}
    found = check_drive(bus, SETTINGS)
    assert {can_id for can_id, _ in bus.requests} == {0x600 + NODE}
    uploads = {2, 3, 4, 5, 7}  # reads, segments of reads, aborts, block reads, an unknown command
    assert {data[0] >> 5 for _, data in bus.requests} <= uploads
    moving = (0x6041, 0x6064, 0x1003)
    after = {key: bus.drive.objects.entry(key).value for key in bus.drive.objects}
    assert {k: v for k, v in after.items() if k[0] not in moving} == {
        k: v for k, v in before.items() if k[0] not in moving
    }
    assert found.count(Verdict.NOT_ASKED) > 100 and not found.failed


def settings_of(drive):
    """What a drive keeps, without entries of mappings beyond their number."""
    objects = drive.objects
    return {
        (index, sub): value
        for (index, sub), value in objects.kept().items()
        if not (0x1600 <= index < 0x1C00 and index & 0x200 and sub > objects[index, 0])
    }


def test_writing_enables_nothing_and_sets_everything_back():
    bus = Watched()
    kept = settings_of(bus.drive)
    enabled = []
    enter = bus.drive.axis._change
    bus.drive.axis._change = lambda state: enabled.append(state.name) or enter(state)
    check_drive(bus, SETTINGS, Level.WRITE)
    words = [int.from_bytes(d[4:6], "little") for i, d in bus.requests
             if i == 0x600 + NODE and d[0] >> 5 == 1 and d[1:3] == b"\x40\x60"]  # fmt: skip
    assert words and not any(word & 0x01 for word in words)
    assert "SWITCHED_ON" not in enabled and "ENABLED" not in enabled
    assert settings_of(bus.drive) == kept


def test_the_axis_stays_within_the_distance():
    bus = SimulatedBus()
    positions = []
    track = bus.drive.track

    def watched(t, seconds, actual, speed, effort):
        positions.append(actual)
        return track(t, seconds, actual, speed, effort)

    bus.drive.track = watched
    check_drive(bus, BenchSettings(NODE), Level.MOVE)
    assert max(map(abs, positions)) == 0.0
    check_drive(bus, SETTINGS, Level.MOVE)
    assert 0.9 * SETTINGS.distance < max(map(abs, positions)) <= 1.05 * SETTINGS.distance
    assert abs(positions[-1]) <= 0.05 * SETTINGS.distance


def test_nobody_there_is_an_error_in_words():
    class Silent(SimulatedBus):
        def send(self, can_id, data, remote=False):
            pass

    with pytest.raises(LinkError, match="node 5 does not answer"):
        check_drive(Silent(), SETTINGS)

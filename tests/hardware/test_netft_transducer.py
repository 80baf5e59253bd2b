"""The transducer against a box: values, ages, losses, and each fault by its name."""

import time

import numpy as np
import pytest

from netft_scene import boxed, client, until
from wrenchbed.errors import DriverError, LinkError, ParameterError
from wrenchbed.hardware import device_base
from wrenchbed.hardware.transducers.netft import NetftOptions, NetftTransducer
from wrenchbed.hardware.transducers.netft import transducer as reading

pytestmark = pytest.mark.wire


@pytest.fixture(scope="module")
def scene():
    with boxed("127.0.3.40", rate=1000) as found:
        yield found


@pytest.fixture
def transducer(scene):
    with client(scene) as found:
        time.sleep(0.03)
        yield found


def counters(transducer):
    return transducer.health().counters


@pytest.mark.parametrize(
    "units",
    [
        {"force_unit": "lbf", "torque_unit": "lbf-in", "counts_per_force": 2e5},
        {"torque_unit": "lbf-ft", "counts_per_torque": 7e6},
    ],
)
def test_readings_are_si_whatever_the_box_counts_in(units):
    with boxed("127.0.3.41", noise=1e-4, **units) as scene, client(scene) as transducer:
        sample = transducer.read()
        assert sample.wrench == pytest.approx(scene.body.base, abs=1e-3)
        assert (sample.status, sample.saturated, sample.faults) == (0, 0, ())
        assert transducer.health().ok


def test_the_newest_record_is_read_not_the_next_in_the_queue():
    with boxed("127.0.3.42", rate=7000) as scene, client(scene) as transducer:
        time.sleep(0.1)
        ages, sequences = [], []
        for _ in range(40):
            time.sleep(0.008)
            sample = transducer.read()
            ages.append(sample.age)
            sequences.append(sample.sequence)
            assert sample.fresh or sample.age > 0.007
        assert np.median(ages) < 0.005
        assert 40 < np.median(np.diff(sequences)) < 80
        assert not transducer.read().fresh or transducer.read().age < 0.01


def test_a_wrench_at_a_time_is_interpolated(scene, transducer):
    scene.body.slope = np.array([0.0, 0.0, 5.0, 0.0, 0.0, 0.0])
    try:
        time.sleep(0.4)
        now = time.monotonic()
        for back in (0.02, 0.1, 0.3):
            shown = transducer.at(now - back)
            late = now - back - 0.0095 - scene.body.begun
            assert shown.wrench[2] == pytest.approx(scene.body.load(late)[2], abs=0.06)
        assert transducer.at(now - 30.0) is None
        assert transducer.at(now + 1.0) is None
    finally:
        scene.body.slope = np.zeros(6)


def test_lost_records_are_counted_exactly(scene, transducer):
    before, told = scene.box.counters.copy(), counters(transducer)
    for kind in ("drop", "duplicate", "swap"):
        scene.fault("rdt", kind, 0.15, share=0.3)
        time.sleep(0.2)
    now = counters(transducer)
    sent = {name: scene.box.counters[name] - before[name] for name in scene.box.counters}
    assert min(sent["dropped"], sent["duplicated"], sent["swapped"]) > 20
    assert now["lost"] - told["lost"] == sent["dropped"] + sent["swapped"]
    assert now["disordered"] - told["disordered"] == sent["duplicated"] + sent["swapped"]
    assert transducer.read().lost == now["lost"]
    assert transducer.health().ok


def test_silence_is_named_within_100_ms_and_ended(scene, transducer):
    before = scene.box.counters["silent"]
    scene.fault("rdt", "stall", 1.2)
    assert until(lambda: transducer.health().state == "stale") < 0.1
    assert "no fresh reading" in transducer.health().detail
    aged = transducer.read().age
    assert aged > 0.05
    assert until(lambda: transducer.health().state == "lost") < 1.0
    until(lambda: transducer.health().ok)
    time.sleep(0.1)
    assert transducer.read().lost == scene.box.counters["silent"] - before
    assert counters(transducer)["requests"] >= 3


def test_a_box_that_restarts_is_asked_again_and_has_a_new_zero(scene, transducer):
    time.sleep(0.3)
    scene.fault("rdt", "restart")
    until(lambda: transducer.health().state == "stale")
    until(lambda: transducer.health().ok)
    sample = transducer.read()
    assert counters(transducer)["restarts"] == 1 and sample.bias_id == 1
    assert sample.wrench[2] == pytest.approx(30.0, abs=0.1)
    assert sample.device_time < 5.0


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        ("freeze", {}, "frozen"),
        ("status", {"bits": 0x80000010}, "no data from the transducer"),
        ("wrong_counts", {"factor": 10.0}, "check counts"),  # beyond full scale
    ],
)
def test_what_is_wrong_in_the_box_is_a_fault_in_words(scene, transducer, kind, values, words):
    scene.fault("rdt", kind, 0.4, **values)
    assert until(lambda: transducer.health().state == "fault") < 0.2
    assert words in transducer.health().detail
    until(lambda: transducer.health().ok)


def test_saturation_names_its_channel(scene, transducer):
    scene.fault("rdt", "saturate", 0.2, channel=2)
    until(lambda: transducer.read().saturated == 0b100)
    assert "saturated" in transducer.read().faults[0]
    assert transducer.health().ok and "saturated" in transducer.health().detail
    time.sleep(0.25)
    transducer.read()
    assert until(lambda: transducer.read().saturated == 0) < 0.1


def test_what_is_no_record_of_this_box_is_left_out(scene, transducer):
    before = counters(transducer)
    for kind in ("short", "foreign", "garbage", "buffered"):
        scene.fault("rdt", kind, 0.15)
    time.sleep(0.25)
    now = counters(transducer)
    for kind in ("misshapen", "foreign", "implausible"):
        assert now[kind] - before[kind] > 20
    assert now["lost"] == before["lost"] and transducer.health().ok
    assert transducer.read().wrench == pytest.approx(scene.body.base, abs=0.02)


def test_a_clock_that_runs_wrong_is_named(scene, transducer, monkeypatch):
    monkeypatch.setattr(device_base, "LEAST_S", 0.6)  # the box's clock is wrong by far more than ms
    scene.fault("rdt", "skew", 4.0, factor=1.01)
    until(lambda: any("clock runs +" in f for f in transducer.read().faults), 4.0)
    scene.fault("rdt", "skew", 0.001, factor=1.0)


@pytest.mark.parametrize(
    ("link", "kind", "error", "words"),
    [("http", "unlisten", LinkError, "refused"),
     ("http", "stall", LinkError, "no answer within 0.4 s"),
     ("http", "garbage", DriverError, "malformed"),
     ("http", "missing_field", DriverError, "has no <cfgcpf>"),
     ("rdt", "stall", LinkError, "sends no RDT")],
)  # fmt: skip
def test_a_page_that_fails_or_has_no_stream_is_named(monkeypatch, link, kind, error, words):
    monkeypatch.setattr(reading, "PAGE_S", 0.4)
    monkeypatch.setattr(reading, "_FIRST_S", 0.4)
    with boxed("127.0.3.43") as scene:
        scene.fault(link, kind, 3.0)
        time.sleep(0.1)
        begun = time.monotonic()
        with pytest.raises(error, match=words), client(scene):
            pass
        assert time.monotonic() - begun < 3.0


def test_a_box_with_rdt_off_is_named(scene):
    scene.box._pace.on = False
    try:
        with pytest.raises(DriverError, match="RDT is off"), client(scene):
            pass
    finally:
        scene.box._pace.on = True


def test_nobody_there_is_named():
    with pytest.raises(LinkError, match=r"127\.0\.3\.99:8080"):
        NetftTransducer(NetftOptions("127.0.3.99")).connect()
    with pytest.raises(LinkError, match="no such address"):
        NetftTransducer(NetftOptions("no-such-host.invalid")).connect()


@pytest.mark.parametrize("bad", [{"port": 0}, {"http_port": -1}])
def test_impossible_options_are_refused(bad):
    with pytest.raises(ParameterError, match=next(iter(bad))):
        NetftOptions("127.0.0.1", **bad)


def test_a_zero_that_was_lost_while_nobody_looked_changes_its_id():
    with boxed("127.0.3.45", rate=1000) as scene:
        port = int(scene.addresses["http"].split(":")[1])
        transducer = NetftTransducer(NetftOptions("127.0.3.45", http_port=port))
        with transducer:
            assert transducer.read().bias_id == 0
            until(lambda: transducer.read().sequence > 7000)  # a new start soon counts fewer
        scene.fault("rdt", "restart")
        with transducer:
            assert transducer.read().bias_id == 1

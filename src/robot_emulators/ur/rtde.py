"""The RTDE server: a session per client, the stream of data packets and its faults; and what
clients write: input registers with their owners, and the control box's outputs."""

import struct
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from robot_emulators.errors import EmulatorError
from robot_emulators.ur import rtde_packets as wire
from robot_emulators.ur.network import Conversation, Peer
from robot_emulators.ur.rtde_packets import Recipe, Values, zero

IN_USE, NOT_FOUND = "IN_USE", "NOT_FOUND"
_CONFIGURABLE, _TOOL = 8, 16
"""First bit of the configurable and of the tool's outputs in actual_digital_output_bits."""
_MOST_RECIPES = 255
_MOST_HELD = 1 << 22
"""Most bytes that the fault ``burst`` holds back."""


class Inputs:
    """Holds the inputs of a UR controller that clients write over RTDE, by field name. A value
    stays until it is written again. An input belongs to the client whose accepted recipe (list)
    first named it, until that client disconnects. ``written`` is called with the values of each
    packet."""

    def __init__(
        self, fields: Mapping[str, str], written: Callable[[dict[str, Values]], None]
    ) -> None:
        self.fields = fields
        self.values: dict[str, Values] = {name: zero(kind) for name, kind in fields.items()}
        self.at: dict[str, float] = {}
        self._written = written
        self._owners: dict[str, Hashable] = {}

    def claim(self, owner: Hashable, names: Sequence[str]) -> list[str]:
        """Reserve inputs for an RTDE client ``owner``, all or none; return for each of ``names``
        its type, `IN_USE` if another client has it, or `NOT_FOUND`."""
        types = [self._type(owner, name) for name in names]
        if IN_USE not in types and NOT_FOUND not in types:
            self._owners.update(dict.fromkeys(names, owner))
        return types

    def release(self, owner: Hashable) -> None:
        """Free the inputs that a client has reserved."""
        self._owners = {name: held for name, held in self._owners.items() if held != owner}

    def write(self, values: dict[str, Values], now: float) -> None:
        """Set inputs to the ``values`` by name of an RTDE packet, received at time ``now`` [s]."""
        self.values.update(values)
        self.at.update(dict.fromkeys(values, now))
        self._written(values)

    def clear(self) -> None:
        """Set all inputs to zero, as after power-up."""
        self.values = {name: zero(kind) for name, kind in self.fields.items()}
        self.at.clear()

    def _type(self, owner: Hashable, name: str) -> str:
        if name not in self.fields:
            return NOT_FOUND
        return self.fields[name] if self._owners.get(name, owner) == owner else IN_USE


class Terminals:
    """States of the digital and analog outputs of the control box.

    Attributes:
        bits: digital outputs: 8 standard, 8 configurable, 2 of the tool.
        analog: two analog outputs [fraction 0 … 1 of the range].
        analog_types: bit of each analog output, set for a voltage, else a current.
        slider: speed slider, 0 … 1.
    """

    def __init__(self) -> None:
        self.bits = 0
        self.analog = [0.0, 0.0]
        self.analog_types = 0
        self.slider = 1.0

    @property
    def analog_values(self) -> tuple[float, float]:
        """Readings of the analog outputs: 0 … 10 V or, of currents, 0.004 … 0.02 A (UR's RTDE
        guide, ``standard_analog_output0`` [A or V])."""
        first, second = (
            10.0 * x if self.analog_types >> k & 1 else 0.004 + 0.016 * x
            for k, x in enumerate(self.analog)
        )
        return first, second

    def take(self, written: dict[str, Values]) -> None:
        """Set the outputs that the values of one RTDE packet, by input field, select."""
        groups = (("standard", 0, 0xFF), ("configurable", _CONFIGURABLE, 0xFF), ("tool", _TOOL, 3))
        for name, first, most in groups:
            mask = written.get(f"{name}_digital_output_mask", (0,))[0] & most
            if mask:
                value = written.get(f"{name}_digital_output", (0,))[0]
                self.bits = self.bits & ~(mask << first) | (value & mask) << first
        mask = written.get("standard_analog_output_mask", (0,))[0]
        for k in range(2):
            if mask >> k & 1:
                self.analog[k] = written.get(f"standard_analog_output_{k}", (0.0,))[0]
                types = written.get("standard_analog_output_type", (0,))[0]
                self.analog_types = self.analog_types & ~(1 << k) | types & 1 << k
        if written.get("speed_slider_mask", (0,))[0]:
            fraction = written.get("speed_slider_fraction", (1.0,))[0]
            self.slider = min(max(fraction, 0.0), 1.0) if fraction == fraction else self.slider


@dataclass(frozen=True)
class Offer:
    """Outputs and inputs of a UR controller that a session of its data link RTDE may use.

    Attributes:
        version: software version of the controller.
        rate: rate of the control cycle [Hz].
        outputs: name → type of each output field.
        inputs: input fields and their owners.
        fault: kind of lasting fault → its values while active, else None.
    """

    version: tuple[int, int, int, int]
    rate: float
    outputs: Mapping[str, str]
    inputs: Inputs
    fault: Callable[[str], Mapping[str, Any] | None] = lambda kind: None


class RtdeSession(Conversation):
    """Session of one RTDE client: answers its packets and streams the fields of its recipe (list).

    Attributes:
        burst: bytes of data packets that the fault ``burst`` holds back.
    """

    def __init__(self, offer: Offer, send: Callable[[bytes], None]) -> None:
        self.burst = bytearray()
        self.protocol = 1
        self.started = False
        self.inputs: dict[int, Recipe] = {}
        self.output: Recipe | None = None
        self._offer, self._send = offer, send
        self.splitter = wire.Splitter()
        self._share, self._phase = 1.0, 0.0
        self._now = 0.0
        self._handlers = {
            wire.VERSION: self._version, wire.CONTROLLER: self._controller,
            wire.OUTPUTS: self._outputs, wire.INPUTS: self._inputs,
            wire.START: self._start, wire.PAUSE: self._pause, wire.DATA: self._data,
        }  # fmt: skip

    def receive(self, data: bytes, now: float) -> bool:
        self._now = now
        try:
            complete = self.splitter.feed(data)
        except EmulatorError:
            return False
        for kind, payload in complete:
            handler = self._handlers.get(kind)
            if handler is not None:
                handler(payload)
        return True

    def due(self) -> bool:
        """Count one control cycle; return whether this RTDE client gets a data packet in it."""
        if not self.started or self.output is None:
            return False
        self._phase += self._share
        if self._phase < 1.0 - 1e-9:
            return False
        self._phase -= 1.0
        return True

    def data(self, values: Mapping[str, Values]) -> bytes:
        """Return an RTDE data packet: the fields that this client asked for, from ``values``."""
        return b"" if self.output is None else self.output.pack(values)

    def end(self) -> None:
        self.started = False
        self._offer.inputs.release(id(self))

    def _answer(self, kind: int, payload: bytes) -> None:
        self._send(wire.packet(kind, payload))

    def _version(self, payload: bytes) -> None:
        asked = int.from_bytes(payload[:2], "big")
        if asked in (1, 2):
            self.protocol = asked
        self._answer(wire.VERSION, bytes([asked in (1, 2)]))

    def _controller(self, payload: bytes) -> None:
        self._answer(wire.CONTROLLER, struct.pack(">4I", *self._offer.version))

    def _outputs(self, payload: bytes) -> None:
        frequency = self._offer.rate
        if self.protocol == 2:
            if len(payload) < 8:
                return
            frequency = struct.unpack_from(">d", payload)[0]
            payload = payload[8:]
        asked = wire.names(payload)
        known, missing = self._offer.outputs, self._offer.fault("not_found")
        if missing is not None:
            known = {name: kind for name, kind in known.items() if name != missing["field"]}
        types = [NOT_FOUND] if asked is None else [known.get(name, NOT_FOUND) for name in asked]
        good = asked is not None and NOT_FOUND not in types
        number = 1 if self.protocol == 2 else None
        self.output = Recipe(number, list(zip(asked or [], types, strict=True))) if good else None
        rate_fraction = frequency / self._offer.rate
        self._share = rate_fraction if 0.0 < rate_fraction < 1.0 else 1.0
        self._phase = 1.0 - self._share
        head = bytes([good]) if self.protocol == 2 else b""
        self._answer(wire.OUTPUTS, head + ",".join(types).encode())

    def _inputs(self, payload: bytes) -> None:
        asked = wire.names(payload)
        if asked is None or len(self.inputs) >= _MOST_RECIPES:
            self._answer(wire.INPUTS, bytes([0]) + NOT_FOUND.encode())
            return
        if self._offer.fault("in_use") is not None:
            types = [IN_USE] * len(asked)
        else:
            types = self._offer.inputs.claim(id(self), asked)
        number = 0
        if IN_USE not in types and NOT_FOUND not in types:
            number = len(self.inputs) + 1
            self.inputs[number] = Recipe(number, list(zip(asked, types, strict=True)))
        self._answer(wire.INPUTS, bytes([number]) + ",".join(types).encode())

    def _start(self, payload: bytes) -> None:
        accepted = self._offer.fault("refuse_start") is None
        self.started = self.started or accepted
        self._answer(wire.START, bytes([accepted]))

    def _pause(self, payload: bytes) -> None:
        self.started = False
        self._answer(wire.PAUSE, bytes([1]))

    def _data(self, payload: bytes) -> None:
        """Write the inputs that a client sent; a short payload is dropped, excess is ignored."""
        recipe = self.inputs.get(payload[0]) if payload else None
        values = None if recipe is None else recipe.unpack(payload[1:])
        if values is not None:
            self._offer.inputs.write(values, self._now)


class Rtde:
    """Server of a UR controller's data link RTDE: one session for each client of its port."""

    def __init__(self, offer: Offer) -> None:
        self._offer = offer
        self._frozen: dict[str, Values] | None = None
        self._sessions: dict[Peer, RtdeSession] = {}

    def answer(self, peer: Peer) -> RtdeSession:
        """Make the RTDE session of a new client."""
        self._sessions[peer] = session = RtdeSession(self._offer, peer.send)
        return session

    @property
    def wanted(self) -> set[str]:
        """Names of the output fields that at least one RTDE client receives."""
        recipes = [session.output for session in self._sessions.values() if session.started]
        return {name for recipe in recipes if recipe is not None for name in recipe.names}

    def stream(self, values: Mapping[str, Values]) -> None:
        """Send its data packet, from output values by name, to each RTDE client that is due one."""
        self._sessions = {p: s for p, s in self._sessions.items() if not p.closed}
        if self._offer.fault("freeze") is None:
            self._frozen = None
        elif self._frozen is None:
            self._frozen = dict(values)
        held = self._offer.fault("burst") is not None
        silent = self._offer.fault("drop") is not None or self._offer.fault("stall") is not None
        for peer, session in self._sessions.items():
            if session.burst and not held:
                peer.send(bytes(session.burst), _MOST_HELD)
                session.burst.clear()
            if session.due() and not silent:
                data = session.data(values if self._frozen is None else self._frozen)
                if not held:
                    peer.send_or_skip(data)
                elif len(session.burst) + len(data) <= _MOST_HELD:
                    session.burst += data

    def hang_up(self, reset: bool) -> None:
        """Close the connections of clients that write inputs; ``reset``: by a TCP reset."""
        for peer, session in self._sessions.items():
            if session.inputs:
                peer.close(reset)

    def inject(self, data: bytes) -> None:
        """Insert raw bytes into the RTDE stream of every client that receives data."""
        for peer, session in self._sessions.items():
            if session.started:
                peer.send(data)

    def say(self, message: str, level: int) -> None:
        """Send every client an RTDE text message of a level, 0: exception, 1: error, 2: warning."""
        for peer, session in self._sessions.items():
            peer.send(wire.text(message, "twin", level, session.protocol))

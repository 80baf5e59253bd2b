"""How much of the wire one cycle needs, before anything is sent.

A classic frame has 47 bits and 8 a data byte, intermission included, and at most one stuff bit
for every four of the 34 + 8 n bits that can be stuffed, the first excepted.
"""

from collections.abc import Iterable
from dataclasses import dataclass

MOST = 0.9
"""Largest share of the wire that the cyclic exchange may need in the worst case."""
_SYNC, _POLL, _EVEN, _ODD, _RPDO, _HEARTBEAT = 0, 0, 8, 6, 6, 1


@dataclass(frozen=True)
class Load:
    """Bits of one cycle and the share of the wire that they use.

    Attributes:
        least: without any stuff bit.
        worst: with as many as there can be.
        share: of the wire, in the worst case.
    """

    least: int
    worst: int
    share: float


def least_bits(length: int) -> int:
    """Bits of a frame of some data bytes (11-bit id), without stuff bits."""
    return 47 + 8 * length


def worst_bits(length: int) -> int:
    """Most bits of a frame of some data bytes (11-bit id)."""
    return least_bits(length) + (33 + 8 * length) // 4


def frame_bits(can_id: int, data: bytes) -> int:
    """Bits of this very frame (11-bit id), stuff bits counted one by one."""
    text = f"0{can_id:011b}000{len(data):04b}" + "".join(f"{byte:08b}" for byte in data)
    register = 0
    for bit in text:
        feedback = (register >> 14) ^ int(bit)
        register = (register << 1) & 0x7FFF
        if feedback:
            register ^= 0x4599
    text += f"{register:015b}"
    stuffed, run, last = 0, 0, ""
    for bit in text:
        run = run + 1 if bit == last else 1
        last = bit
        if run == 5:
            stuffed, run, last = stuffed + 1, 1, "10"[int(bit)]
    return len(text) + stuffed + 13


def cycle_bits(frames: Iterable[tuple[int, bytes]]) -> int:
    """Bits of a list of frames (id, data)."""
    return sum(frame_bits(can_id, data) for can_id, data in frames)


def modelled(
    nodes: int, rate: float, bitrate: int, torque: bool, heartbeat: float, masters: int = 0
) -> Load:
    """Load of the cyclic exchange.

    Args:
        nodes: drives; each gets an RPDO of 6 bytes and answers a TPDO of 6, or 8 with torque.
        rate: of the cycles [Hz].
        bitrate: [bit/s].
        torque: whether drives tell it.
        heartbeat: period of each drive's and master's [s].
        masters: how many send a heartbeat beside the drives.
    """
    lengths = [_SYNC, _POLL, _EVEN, _ODD] + nodes * [_RPDO, 8 if torque else 6]
    least, worst = (sum(bits(n) for n in lengths) for bits in (least_bits, worst_bits))
    beats = (nodes + masters) / heartbeat * worst_bits(_HEARTBEAT)
    return Load(least, worst, (worst * rate + beats) / bitrate)

"""Monitor conditions: 16 thresholds that the box compares with every sample, and their latch.

Source: ATI 9620-05 Net F/T manual, thresholding: condition k is ``mce`` on or off, ``mcx`` channel
0 … 5 or −1, ``mcc`` 1 above or −1 below, ``mcv`` counts, ``mco`` output code; a condition that
holds sets bit 16 of the status until the latch is reset.
"""

from dataclasses import dataclass, field

import numpy as np

MOST = 16
LATCHED = 1 << 31 | 1 << 16
"""Status bits of a latched condition."""
_RANGES = {"mce": (0, 1), "mcx": (-1, 5), "mcv": (-(2**31), 2**31 - 1), "mco": (0, 255)}


@dataclass
class Conditions:
    """The thresholds and what they found.

    Attributes:
        on: whether any is compared.
        values: settings (16,) by the name of their variable.
        breached: bit k is set where condition k held since the last reset.
        output: codes of those conditions, or-ed.
    """

    on: bool = False
    values: dict[str, np.ndarray] = field(default_factory=dict)
    breached: int = 0
    output: int = 0

    def __post_init__(self) -> None:
        start = {"mce": 0, "mcx": -1, "mcc": 1, "mcv": 0, "mco": 0}
        self.values = {name: np.full(MOST, value, dtype=np.int64) for name, value in start.items()}

    def set(self, name: str, number: int) -> bool:
        """Take a variable such as mcv3; False where it is none, or the number impossible."""
        kind, k = name[:3], name[3:]
        if kind not in self.values or not k.isdecimal() or int(k) >= MOST:
            return False
        low, high = _RANGES.get(kind, (-1, 1))
        if not low <= number <= high or (kind == "mcc" and number == 0):
            return False
        self.values[kind][int(k)] = number
        return True

    def reset(self) -> None:
        """Reset the latch."""
        self.breached = self.output = 0

    def look(self, counts: np.ndarray) -> int:
        """Compare counts (n, 6); the status bits that the latch sets from here on."""
        if not self.on:
            return 0
        v = self.values
        for k in np.flatnonzero((v["mce"] == 1) & (v["mcx"] >= 0)):
            beyond = v["mcc"][k] * (counts[:, v["mcx"][k]] - v["mcv"][k]) > 0
            if beyond.any():
                self.breached |= 1 << int(k)
                self.output |= int(v["mco"][k])
        return LATCHED if self.breached else 0

"""Cyclic redundancy checks of serial protocols, by tables.

Sources: Modbus over Serial Line 1.02, section 6.2.2 (CRC-16/MODBUS); ITU-T X.25, section 2.2.7.4
(CRC-16/X-25). Their published values for the text "123456789" are 0x4B37 and 0x906E.
"""

_MODBUS, _X25 = 0xA001, 0x8408
"""Polynomials, lowest bit first; by definition."""
_ALL_ONES = 0xFFFF


def _table(polynomial: int) -> tuple[int, ...]:
    rows = []
    for row in range(256):
        for _ in range(8):
            row = row >> 1 ^ (polynomial if row & 1 else 0)
        rows.append(row)
    return tuple(rows)


_TABLES = {polynomial: _table(polynomial) for polynomial in (_MODBUS, _X25)}


def crc16_modbus(data: bytes) -> int:
    """CRC-16/MODBUS of some bytes, 0 … 0xFFFF; it is sent low byte first."""
    return _crc(data, _TABLES[_MODBUS])


def crc16_x25(data: bytes) -> int:
    """CRC-16/X-25 of some bytes, 0 … 0xFFFF; it is sent low byte first."""
    return _crc(data, _TABLES[_X25]) ^ _ALL_ONES


def _crc(data: bytes, table: tuple[int, ...]) -> int:
    crc = _ALL_ONES
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc

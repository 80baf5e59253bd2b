"""The electronic data sheet of a node, written from its object dictionary.

Source: CiA 306-1 (electronic data sheet). An id of the predefined connection set is written as
``$NODEID+…``.
"""

from collections.abc import Sequence

from robot_emulators.canopen.dictionary import Entry
from robot_emulators.canopen.node import Node

_VAR, _ARRAY, _RECORD = 7, 8, 9
_MANDATORY = (0x1000, 0x1001, 0x1018)


def eds(node: Node, file: str) -> str:
    """The data sheet as text; ``file`` is the name that it states."""
    who, objects = node.identity, node.objects
    indices = sorted(objects.names)
    profile = [i for i in indices if i >= 0x2000 or i not in _MANDATORY]
    baud = "".join(f"BaudRate_{k}={int(k in (125, 250, 500, 1000))}\n" for k in _BAUDS)
    parts = [
        f"[FileInfo]\nFileName={file}\nFileVersion=1\nFileRevision=0\nEDSVersion=4.0\n"
        f"Description={who.name}\nCreationDate=11-23-2026\nCreationTime=12:00AM\n"
        "CreatedBy=wrenchbed\n",
        f"[DeviceInfo]\nVendorName=wrenchbed\nVendorNumber=0x{who.vendor:X}\n"
        f"ProductName={who.name}\nProductNumber=0x{who.product:X}\n"
        f"RevisionNumber=0x{who.revision:X}\nOrderCode={who.name}\n{baud}"
        "SimpleBootUpMaster=0\nSimpleBootUpSlave=1\nGranularity=8\nDynamicChannelsSupported=0\n"
        f"GroupMessaging=0\nNrOfRXPDO={len(node.rpdos)}\nNrOfTXPDO={len(node.tpdos)}\n"
        "LSS_Supported=0\n",
        "[Comments]\nLines=0\n",
        _listed("MandatoryObjects", _MANDATORY),
        _listed("OptionalObjects", [i for i in profile if not 0x2000 <= i < 0x6000]),
        _listed("ManufacturerObjects", [i for i in profile if 0x2000 <= i < 0x6000]),
    ]
    for index in indices:
        parts += _described(node, index)
    return "\n".join(parts)


_BAUDS = (10, 20, 50, 125, 250, 500, 800, 1000)


def _listed(title: str, indices: Sequence[int]) -> str:
    lines = "".join(f"{k}=0x{index:04X}\n" for k, index in enumerate(indices, start=1))
    return f"[{title}]\nSupportedObjects={len(indices)}\n{lines}"


def _described(node: Node, index: int) -> list[str]:
    objects = node.objects
    subs = [sub for i, sub in objects if i == index]
    if subs == [0]:
        return [f"[{index:04X}]\n" + _entry(objects.entry((index, 0)), node.node)]
    kind = _ARRAY if index in objects.arrays else _RECORD
    head = f"[{index:04X}]\nParameterName={objects.names[index]}\nObjectType=0x{kind:X}\n"
    parts = [head + f"SubNumber=0x{len(subs):X}\n"]
    for sub in subs:
        text = _entry(objects.entry((index, sub)), node.node)
        parts.append(f"[{index:04X}sub{sub:X}]\n" + text)
    return parts


def _entry(entry: Entry, node: int) -> str:
    value = entry.default
    if isinstance(value, bytes):
        text = value.decode("ascii")
    elif entry.of_node:
        text = f"$NODEID+0x{value - node:X}"
    else:
        text = str(value) if entry.kind.signed else f"0x{value:X}"
    limits = "".join(
        f"{name}={limit}\n"
        for name, limit in (("LowLimit", entry.low), ("HighLimit", entry.high))
        if limit is not None
    )
    return (
        f"ParameterName={entry.name}\nObjectType=0x{_VAR:X}\nDataType=0x{entry.kind.code:04X}\n"
        f"AccessType={entry.access}\nDefaultValue={text}\nPDOMapping={int(entry.mapped)}\n{limits}"
    )

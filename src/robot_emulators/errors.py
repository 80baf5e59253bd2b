"""Errors and warnings of this package; a message is one line that names the value and the remedy.

EmulatorError           an emulator that cannot serve        (RuntimeError)
├── SettingError        a setting, an option or an address   (ValueError)
└── FaultError          a script of faults, or one fault     (ValueError)

EmulatorWarning         a person should know it; the emulator goes on (UserWarning)
"""


class EmulatorError(RuntimeError):
    """Raised when an emulator cannot serve: port taken, bus missing, or its loop has stopped."""


class SettingError(EmulatorError, ValueError):
    """Raised for a setting that does not exist, or a value that it cannot have."""


class FaultError(EmulatorError, ValueError):
    """Raised for a script of timed faults that cannot be read, or a fault that no link has."""


class EmulatorWarning(UserWarning):
    """A condition that a person should know of; the emulator goes on."""

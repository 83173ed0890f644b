"""The variables that every FMU has, independent of the bus: parameters and diagnostics."""

from __future__ import annotations

from dataclasses import dataclass

from .ir import Category, Enumeration, Item

BUS_FAILURE = Enumeration(
    "BusFailure",
    "What to do without a bus",
    (
        Item("Error", 1, "End with an error"),
        Item("Wait", 2, "Wait, at most for the time 'patience'"),
        Item("Continue", 3, "Go on with values that are not valid"),
    ),
)
BUS_STATE = Enumeration(
    "BusState",
    "State of a bus",
    (
        Item("Missing", 1, "No daemon serves the bus"),
        Item("StandsStill", 2, "The daemon is there, but exchanges nothing"),
        Item("Incomplete", 3, "Not all slaves take part in the exchange"),
        Item("NotOperational", 4, "All slaves take part, but not all of this FMU are in OP"),
        Item("Operational", 5, "All slaves of this FMU are in OP"),
    ),
)
AL_STATE = Enumeration(
    "ALState",
    "State of a slave (ETG.1000.6)",
    (
        Item("NotAvailable", 1, "The slave does not answer, or there is no bus"),
        Item("Init", 2, "INIT: no communication but registers"),
        Item("PreOp", 3, "PREOP: mailbox"),
        Item("Bootstrap", 4, "BOOT: firmware update"),
        Item("SafeOp", 5, "SAFEOP: mailbox and inputs, outputs are safe"),
        Item("Op", 6, "OP: mailbox, inputs and outputs"),
    ),
)
CAN_STATE = Enumeration(
    "CANState",
    "State of a CAN controller",
    (
        Item("Stopped", 1, "The terminal is not in OP, or does not take part in the exchange"),
        Item("ErrorActive", 2, "All is well"),
        Item("Warning", 3, "An error counter has reached 96"),
        Item("ErrorPassive", 4, "An error counter has reached 128"),
        Item("BusOff", 5, "It takes no part in the traffic"),
    ),
)
"""Only of FMUs with CAN messages or bus terminals."""

DRIVE_MODE = Enumeration(
    "DriveMode",
    "Mode of operation of a drive (CiA 402)",
    (
        Item("ProfilePosition", 1, "Target position; the drive makes the way"),
        Item("ProfileVelocity", 2, "Target speed; the drive makes the way"),
        Item("ProfileTorque", 3, "Target torque; the drive makes the way"),
        Item("CyclicPosition", 4, "Positions in each step"),
        Item("CyclicVelocity", 5, "Speeds in each step"),
        Item("CyclicTorque", 6, "Torques in each step"),
    ),
)
DRIVE_STATE = Enumeration(
    "DriveState",
    "State of a drive (CiA 402)",
    (
        Item("NotReadyToSwitchOn", 1, "Not ready to switch on, or not connected"),
        Item("SwitchOnDisabled", 2, "Switch on disabled"),
        Item("ReadyToSwitchOn", 3, "Ready to switch on"),
        Item("SwitchedOn", 4, "Switched on"),
        Item("OperationEnabled", 5, "Operation enabled"),
        Item("QuickStopActive", 6, "Quick stop active"),
        Item("FaultReactionActive", 7, "Fault reaction active"),
        Item("Fault", 8, "Fault"),
    ),
)
"""Only of FMUs with drives in SI units."""

ENUMERATIONS = (BUS_FAILURE, BUS_STATE, AL_STATE)
"""The enumerations of `EtherCAT.Types`, with the same numbers."""

CATEGORIES = (
    Category("logEvents", "The bus comes and goes"),
    Category("logStatusWarning", "The simulation goes on, but look at this"),
    Category("logStatusDiscard", "A value was refused"),
    Category("logStatusError", "The simulation ends"),
    Category("logStatusFatal", "Nothing more can be done in this process"),
)


@dataclass(frozen=True, slots=True)
class Fixed:
    """A variable of every FMU.

    Attributes:
        name: Name, which is also its role in `resources/plant.txt`.
        kind: `Real`, `Boolean`, `String`, `Counter`, or the name of an enumeration.
        description: Description for the user.
        start: Start value of a parameter; None for an output.
        unit: Unit of a Real.
    """

    name: str
    kind: str
    description: str
    start: float | bool | int | None = None
    unit: str = ""


PARAMETERS = (
    Fixed("bus", "String", "Name of the bus, as given to ecatd"),
    Fixed(
        "waitForBus",
        "Boolean",
        "true: each step waits for as many bus cycles as it is long; false: steps do not wait",
        True,
    ),
    Fixed("lease", "Real", "Time without steps after which outputs become safe", 0.1, "s"),
    Fixed("whenMissing", "BusFailure", "What to do when there is no bus at the start", 1),
    Fixed("whenFailed", "BusFailure", "What to do when the bus fails later", 1),
    Fixed("patience", "Real", "Longest time to wait for the bus, with Wait; 0: for ever", 0.0, "s"),
    Fixed("readOnly", "Boolean", "true: nothing is written, whatever the inputs are", False),
    Fixed(
        "requireOperational",
        "Boolean",
        "true: a slave that is not in OP is an error that ends the simulation",
        False,
    ),
)

DIAGNOSTICS = (
    Fixed("connected", "Boolean", "The last step has reached the bus"),
    Fixed("state", "BusState", "State of the bus in the last step"),
    Fixed("cycle", "Counter", "Bus cycle of the values, modulo 2^31"),
    Fixed(
        "age",
        "Real",
        "Time from the exchange of the values to the end of the step, 1e9 before the first one",
        unit="s",
    ),
    Fixed("missed", "Counter", "Bus cycles in addition to those that were waited for"),
    Fixed("workingCounter", "Counter", "Working counter of the last exchange, of all domains"),
    Fixed("workingCounterExpected", "Counter", "Working counter when all slaves take part"),
)

OF_SLAVES = (
    Fixed("valid", "Boolean", "values are of a complete exchange, and it is in OP"),
    Fixed("alState", "ALState", "its state"),
    Fixed("alStatusCode", "Counter", "why it has left a state (AL status code), 0: no error"),
)
"""The diagnostics of each slave."""

OF_TERMINALS = (
    Fixed("canState", "CANState", "state of its CAN controller"),
    Fixed("canSendErrors", "Counter", "error counter of its CAN controller for sending"),
    Fixed("canReceiveErrors", "Counter", "error counter of its CAN controller for receiving"),
)
"""The diagnostics of a slave with CAN messages, or with bus terminals."""

OF_RECEIVED = (
    Fixed("canValid", "Boolean", "is not too old, and the terminal takes part in both buses"),
    Fixed("canAge", "Real", "time since the last frame, 1e9 before the first one", unit="s"),
    Fixed("canCount", "Counter", "frames that were received, modulo 2^31"),
)
OF_SENT = (Fixed("canCount", "Counter", "frames that were handed over, modulo 2^31"),)
"""The diagnostics of each CAN message."""

MEMBERS = {"canValid": "valid", "canAge": "age", "canCount": "count"}
"""What they are called: `terminal.motor.age`."""

OF_DRIVES = (
    ("enable", Fixed("driveEnable", "Boolean", "true: it shall be in operation", False)),
    ("quickStop", Fixed("driveQuickStop", "Boolean", "true: it shall stop quickly", False)),
    ("faultReset", Fixed("driveFaultReset", "Boolean", "false to true resets a fault", False)),
    ("home", Fixed("driveHome", "Boolean", "true: it shall home", False)),
    ("mode", Fixed("driveMode", "DriveMode", "mode of operation", 4)),
    (
        "positionReference",
        Fixed("drivePositionReference", "Real", "position for it", 0.0, "LENGTH"),
    ),
    ("speedReference", Fixed("driveSpeedReference", "Real", "speed for it", 0.0, "LENGTH/s")),
    ("torqueReference", Fixed("driveTorqueReference", "Real", "torque for it", 0.0, "TORQUE")),
    ("position", Fixed("drivePosition", "Real", "its position", unit="LENGTH")),
    ("speed", Fixed("driveSpeed", "Real", "its speed", unit="LENGTH/s")),
    ("torque", Fixed("driveTorque", "Real", "its torque", unit="TORQUE")),
    ("enabled", Fixed("driveEnabled", "Boolean", "it follows its reference")),
    ("homed", Fixed("driveHomed", "Boolean", "it was homed by this FMU")),
    ("reached", Fixed("driveReached", "Boolean", "it has reached its reference")),
    ("state", Fixed("driveState", "DriveState", "its state")),
    ("errorCode", Fixed("driveErrorCode", "Counter", "its error code 0x603F, 0: none")),
)
"""The variables of each drive, by name; inputs have a start value.

LENGTH and TORQUE stand for units of the axis."""

INTERVAL = "interval"
OF_BUS_TERMINALS = (
    Fixed(INTERVAL, "Real", "Time between two ticks of each Tx_Clock", 0.001, "s"),
    Fixed("framesSent", "Counter", "Frames of the ECUs that were sent"),
    Fixed("framesReceived", "Counter", "Frames of other nodes, and of other clients of ecatd"),
    Fixed("operationsRefused", "Counter", "Operations that were answered with Format Error"),
    Fixed("operationsLost", "Counter", "Operations and frames that the importer came too late for"),
)
"""The variables of an FMU with bus terminals. The first one is a parameter."""

BUS_NOTIFICATIONS = "BusNotifications"
BUS_TERMINAL = {
    "Rx_Clock": ("input", "The ECU has sent operations"),
    "Rx_Data": ("input", "Operations of the ECU"),
    "Tx_Clock": ("input", "There may be operations for the ECU"),
    "Tx_Data": ("output", "Operations for the ECU"),
}
"""The variables of a bus terminal, as FMI-LS-BUS names them."""

TX_CLOCKS = ("countdown", "triggered")
"""How the importer learns of something for an ECU: by asking again and again, or at once."""

MAXIMUM = {"Rx": 1 << 16, "Tx": 2048}
MIME_TYPE = 'application/org.fmi-standard.fmi-ls-bus.can; version="1.0.0"'

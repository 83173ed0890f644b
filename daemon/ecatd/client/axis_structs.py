"""The structs and functions of `ecat_drive.h` and `ecat_axis.h`, as ctypes knows them."""

from __future__ import annotations

import ctypes

from .structs import QUICK, WAITING

_I, _U, _D = ctypes.c_int, ctypes.c_uint, ctypes.c_double
_U64, _TEXT, _POINTER = ctypes.c_uint64, ctypes.c_char_p, ctypes.c_void_p

TEXT = 256
"""ECAT_DRIVE_TEXT."""


class Settings(ctypes.Structure):
    """`ecat_drive_settings`."""

    _fields_ = (
        ("name", _TEXT),
        *((name, _I) for name in ("restart", "reference", "entries", "changes_mode")),
        *(
            (name, _D)
            for name in (
                *("position_scale", "velocity_scale", "torque_scale", "current_scale"),
                *("max_torque", "low", "high", "max_speed", "max_following_error"),
                *("approach_speed", "approach_acceleration", "window", "standstill_speed"),
                "max_dropout",
            )
        ),
    )


class Inputs(ctypes.Structure):
    """`ecat_drive_inputs`."""

    _fields_ = (
        ("valid", _I),
        ("losses", _U),
        *(
            (name, _I)
            for name in ("status", "display", "position", "velocity", "torque", "current", "error")
        ),
    )


class Request(ctypes.Structure):
    """`ecat_drive_request`."""

    _fields_ = (
        *(
            (name, _I)
            for name in (
                "mode",
                "ready",
                "enable",
                "quick_stop",
                "halt",
                "fault_reset",
                "hold",
                "home",
            )
        ),
        *((name, _D) for name in ("target", "speed", "acceleration", "interval")),
    )


class Outputs(ctypes.Structure):
    """`ecat_drive_outputs`."""

    _fields_ = tuple(
        (name, _I)
        for name in (
            *("control", "mode", "position", "velocity", "torque", "max_torque"),
            *("profile_velocity", "profile_acceleration"),
        )
    )


class View(ctypes.Structure):
    """`ecat_drive_view`."""

    _fields_ = (
        *((name, _I) for name in ("state", "enabled", "connected")),
        *((name, _D) for name in ("position", "speed", "torque", "current")),
        ("seen", _I),
        *((name, _D) for name in ("seen_at", "increments", "raw_velocity", "raw_torque")),
        ("raw", Inputs),
    )


class Order(ctypes.Structure):
    """`ecat_drive_order`."""

    _fields_ = (
        *((name, _I) for name in ("reached", "limited", "homing")),
        ("waits", _TEXT),
        ("trip", _TEXT),
        ("out", Outputs),
        ("request", Request),
        *((name, _I) for name in ("begun", "met", "armed", "stopping", "reset_pending")),
        *((name, _I) for name in ("following", "arrived")),
        *((name, _D) for name in ("offset", "target", "step")),
        *((name, _D) for name in ("line_from", "line_to", "line_left")),
        *((name, _I) for name in ("strobe", "offered", "home_seen")),
        *((name, _D) for name in ("homing_for", "mode_for")),
    )


class Drive(ctypes.Structure):
    """`ecat_drive`."""

    _fields_ = (
        ("settings", Settings),
        ("stepped", _I),
        ("time", _D),
        ("elapsed", _D),
        ("view", View),
        ("view_before", View),
        ("order", Order),
        ("order_before", Order),
    )


class Axis(ctypes.Structure):
    """The first members of `ecat_axis`."""

    _fields_ = (
        ("drive", Drive),
        ("request", Request),
        ("linear", _I),
        ("torque_unit", _I),
        ("slave", _I),
        ("number", _I),
        ("bus", _POINTER),
        ("name", ctypes.c_char * 48),
        ("signals", _I * 16),
    )


class State(ctypes.Structure):
    """`ecat_axis_state`."""

    _fields_ = (
        ("view", View),
        ("order", Order),
        ("code", _I),
        ("cycle", _U64),
        ("answered", _U64),
    )


_FUNCTIONS: dict[str, tuple[object, tuple[object, ...]]] = {
    "axes_open": (_I, (_POINTER, _TEXT)),
    "axes_error": (_TEXT, (_POINTER,)),
    "axes_add": (_I, (_POINTER, _TEXT, _I)),
    "axes_axis": (_POINTER, (_POINTER, _I)),
    "axes_start": (_I, (_POINTER, _D, _I)),
    "axes_observe": (_I, (_POINTER,)),
    "axes_poll": (_I, (_POINTER, _U, _I)),
    "axes_enable": (_I, (_POINTER, _U, _D)),
    "axes_disable": (_I, (_POINTER, _U, _D)),
    "axes_reset": (_I, (_POINTER, _U, _D)),
    "axes_home": (_I, (_POINTER, _U, _D)),
    "axes_leave_home": (_I, (_POINTER, _U, _D)),
    "axes_move": (_I, (_POINTER, _U, _POINTER, _POINTER, _POINTER, _D)),
    "axes_run": (_I, (_POINTER, _U, _POINTER)),
    "axes_follow": (_I, (_POINTER, _U, _POINTER, _D)),
    "axes_push": (_I, (_POINTER, _U, _POINTER)),
    "axes_stop": (_I, (_POINTER, _U, _D)),
    "axes_request": (_U64, (_POINTER, _POINTER)),
    "axes_state": (_I, (_POINTER, _I, _POINTER)),
    "axes_wait": (_I, (_POINTER, _D)),
    "axes_explain": (_TEXT, (_POINTER, _I, _POINTER)),
    "axes_close": (None, (_POINTER,)),
    "drive_state_text": (_TEXT, (_I,)),
    "drive_mode_text": (_TEXT, (_I,)),
    "drive_error_text": (_TEXT, (_I,)),
}

for _library in (QUICK, WAITING):
    for _name, (_result, _arguments) in _FUNCTIONS.items():
        _function = getattr(_library, f"ecat_{_name}")
        _function.restype = _result
        _function.argtypes = [*_arguments]

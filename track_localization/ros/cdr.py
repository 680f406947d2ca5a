"""The header stamp inside a serialised message, read and moved without decoding the rest."""

from __future__ import annotations

import importlib
import struct
from typing import Any

NANO = 10**9


def message_class(msgtype: str) -> Any | None:
    """Return the class of 'package/msg/Name', or None where it is not installed."""
    package, _, name = msgtype.split('/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name, None)
    except ImportError:
        return None


def has_header(message_type: Any) -> bool:
    """Whether a message type starts with a std_msgs/Header."""
    fields = list(message_type.get_fields_and_field_types().items())
    return bool(fields) and fields[0] == ('header', 'std_msgs/Header')


def header_ns(cdr: bytes) -> int:
    """Return the header stamp [ns] of a message that starts with a header."""
    sec, nanosec = struct.unpack_from(_layout(cdr), cdr, 4)
    return int(sec) * NANO + int(nanosec)


def shifted(cdr: bytes, shift_ns: int) -> bytes:
    """Return the message with its header stamp moved by ``shift_ns``, the rest untouched."""
    stamp = struct.pack(_layout(cdr), *divmod(header_ns(cdr) + shift_ns, NANO))
    return cdr[:4] + stamp + cdr[12:]


def _layout(cdr: bytes) -> str:
    """Return the struct format of a Time: the second byte tells the byte order."""
    return '<iI' if cdr[1] & 1 else '>iI'
